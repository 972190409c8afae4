"""How much of the table an object covers, and how far apart two of them are."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array


@dataclass(frozen=True)
class Footprint:
    """All points within a radius of a segment along y: a disc, or a stadium.

    Attributes:
        radius: Distance of the outline from the segment, in table units.
        half_length: Half the length of the segment, in table units; 0 for a disc.
    """

    radius: float = 0.0
    half_length: float = 0.0

    def grow(self, other: "Footprint", margin: float) -> "Footprint":
        """Return where the center of `other` comes within `margin` of this one.

        The Minkowski sum of two stadiums along the same axis is again one.
        """
        return Footprint(
            self.radius + other.radius + margin, self.half_length + other.half_length
        )

    def distance(self, offsets: Array) -> Array:
        """Return the signed distance to the outline, negative inside.

        Args:
            offsets: Points relative to the center, shape (..., 2), in table units.

        Returns:
            Distances, shape (...,), in table units.
        """
        return stadium_distance(offsets, self.radius, self.half_length)

    @property
    def perimeter(self) -> float:
        """Length of the outline, in table units."""
        return 2.0 * np.pi * self.radius + 4.0 * self.half_length

    def outline(self, arc: Array) -> tuple[Array, Array, Array]:
        """Walk along the outline, counter-clockwise from the point at +x.

        Args:
            arc: Arc lengths, shape (S,), in table units; taken modulo the perimeter.

        Returns:
            Offsets from the center (S, 2), outward unit normals (S, 2) and curvatures
            (S,), which are 0 along the straight sides.
        """
        radius, half_length = np.full(
            (2, len(arc)), [[self.radius], [self.half_length]]
        )
        return stadium_outline(arc, radius, half_length)


def stadium_distance(
    offsets: Array, radius: Array | float, half_length: Array | float
) -> Array:
    """Return the signed distance to outlines, negative inside; see `Footprint`.

    Args:
        offsets: Points relative to the centers, shape (..., 2).
        radius: Radii that broadcast with the points, shape (...,).
        half_length: Half lengths, likewise.

    Returns:
        Distances, shape (...,), in table units.
    """
    along = np.maximum(np.abs(offsets[..., 1]) - half_length, 0.0)
    return np.hypot(offsets[..., 0], along) - radius


def stadium_outline(
    arc: Array, radius: Array, half_length: Array
) -> tuple[Array, Array, Array]:
    """Walk along outlines, one for each arc length; see `Footprint.outline`.

    Args:
        arc: Arc lengths, shape (S,), in table units.
        radius: Radius of the outline that each belongs to, shape (S,).
        half_length: Its half length, shape (S,).

    Returns:
        Offsets (S, 2), outward unit normals (S, 2) and curvatures (S,).
    """
    half_perimeter = np.pi * radius + 2.0 * half_length
    arc = np.mod(arc + half_length, 2.0 * half_perimeter)
    is_second_half = arc >= half_perimeter
    arc = np.where(is_second_half, arc - half_perimeter, arc)
    rise = np.minimum(arc, 2.0 * half_length)  # Up the straight side at +x.
    angle = (arc - rise) / radius
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    offsets = radius[:, None] * normals
    offsets[:, 1] += rise - half_length
    sign = np.where(is_second_half, -1.0, 1.0)[:, None]
    curvatures = np.where(arc >= 2.0 * half_length, 1.0 / radius, 0.0)
    return sign * offsets, sign * normals, curvatures


POINT = Footprint()
"""The footprint of objects that are points, as in the paper's experiment."""
