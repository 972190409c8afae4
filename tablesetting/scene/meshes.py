"""Closed triangle meshes for the looks of the props, computed instead of stored."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tablesetting.irl.arrays import Array

Faces = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface whose triangles turn counter-clockwise seen from outside.

    Attributes:
        vertices: Positions in the frame of the prop, shape (V, 3), in [m].
        faces: Vertices of each triangle, shape (F, 3).
    """

    vertices: Array
    faces: Faces

    def to_stl(self) -> bytes:
        """Return the mesh as a binary STL file."""
        record = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")]
        triangles = np.zeros(len(self.faces), dtype=record)
        triangles["corners"] = self.vertices[self.faces]
        return bytes(80) + np.uint32(len(triangles)).tobytes() + triangles.tobytes()


def smooth(points: npt.ArrayLike, rounds: int = 1) -> Array:
    """Round the corners of an open polyline with Chaikin's corner cutting.

    A point given twice stays a corner; the two ends stay where they are.

    Args:
        points: Polyline, shape (S, C).
        rounds: How often every corner is cut; each round doubles the points.

    Returns:
        The rounded polyline, shape (about 2**rounds * S, C).
    """
    line = np.asarray(points, dtype=np.float64)
    for _ in range(rounds):
        cuts = np.stack(
            [0.75 * line[:-1] + 0.25 * line[1:], 0.25 * line[:-1] + 0.75 * line[1:]],
            axis=1,
        ).reshape(-1, line.shape[1])
        line = np.concatenate([line[:1], cuts, line[-1:]])
    return line


def loft(rings: Array) -> Mesh:
    """Span a surface over rings of equal size and close both ends with a fan.

    Args:
        rings: Points around each ring, shape (S, P, 3), in [m].

    Returns:
        The closed mesh with S * P + 2 vertices.
    """
    num_rings, num_points, _ = rings.shape
    index = np.arange(num_rings * num_points).reshape(num_rings, num_points)
    a, b = index[:-1], index[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    first, last = np.full(num_points, index.size), np.full(num_points, index.size + 1)
    triangles = [
        (a, a_next, b_next),
        (a, b_next, b),
        (first, np.roll(index[0], -1), index[0]),
        (last, index[-1], np.roll(index[-1], -1)),
    ]
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in triangles])
    ends = rings[[0, -1]].mean(axis=1)
    return _face_outwards(Mesh(np.concatenate([rings.reshape(-1, 3), ends]), faces))


def lathe(
    profile: npt.ArrayLike,
    num_segments: int = 48,
    center: tuple[float, float] = (0.0, 0.0),
) -> Mesh:
    """Turn a profile about the vertical axis.

    Args:
        profile: (radius, height) along the surface, shape (S, 2), in [m]; the two ends
            are closed towards the axis.
        num_segments: Corners of each turned circle.
        center: Where the axis stands in the frame of the prop, in [m].

    Returns:
        The turned mesh.
    """
    radii, heights = np.asarray(profile, dtype=np.float64).T
    circle = _unit_circle(num_segments)
    rings = np.empty((len(radii), num_segments, 3))
    rings[..., :2] = radii[:, None, None] * circle + np.asarray(center)
    rings[..., 2] = heights[:, None]
    return loft(rings)


def strap(
    path: npt.ArrayLike, half_width: float, half_thickness: float, num_points: int = 12
) -> Mesh:
    """Bend a strap of elliptic section along a path in the x-z plane.

    Args:
        path: (x, z) along the middle of the strap, shape (S, 2), in [m].
        half_width: Half the extent along y, in [m].
        half_thickness: Half the extent across the path, in [m].
        num_points: Corners of each section.

    Returns:
        The bent mesh.
    """
    middle = np.asarray(path, dtype=np.float64)
    tangents = np.gradient(middle, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    normals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
    across, sideways = _unit_circle(num_points).T
    section = middle[:, None] + half_thickness * across[:, None] * normals[:, None]
    y = np.broadcast_to(half_width * sideways, section.shape[:2])
    return loft(np.stack([section[..., 0], y, section[..., 1]], axis=-1))


def bar(stations: npt.ArrayLike, num_points: int = 24) -> Mesh:
    """Forge a flat bar along y, such as a handle, a tine or the bowl of a spoon.

    Args:
        stations: Rows of (y, x, half width, z, half thickness, dish), shape (S, 6), in
            [m]; x and z are the middle, `dish` is how far the rims rise above it.
        num_points: Corners of each section.

    Returns:
        The forged mesh.
    """
    y, x, half_width, z, half_thickness, dish = (
        column[:, None] for column in np.asarray(stations, dtype=np.float64).T
    )
    # The root rounds the section less than an ellipse would.
    circle = _unit_circle(num_points)
    across, up = (np.sign(circle) * np.sqrt(np.abs(circle))).T
    heights = z + half_thickness * up + dish * np.square(across)
    breadth = x + half_width * across
    return loft(np.stack([breadth, np.broadcast_to(y, breadth.shape), heights], -1))


def _unit_circle(num_points: int) -> Array:
    angles = 2.0 * np.pi * np.arange(num_points) / num_points
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _face_outwards(mesh: Mesh) -> Mesh:
    """Turn all triangles over if the mesh encloses a negative volume."""
    corners = mesh.vertices[mesh.faces]
    volume = np.linalg.det(corners - mesh.vertices.mean(axis=0)).sum()
    return mesh if volume > 0.0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])
