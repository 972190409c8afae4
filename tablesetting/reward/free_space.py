"""Where on the table an item can stand among the objects."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tablesetting.irl.arrays import Array, Booleans, Indices
from tablesetting.reward.footprint import POINT, Footprint

_OUTLINE_SPACING = 0.02  # Between samples of an outline, in table units.
_SECTIONS = np.linspace(0.0, 1.0, 17)  # Cuts of a bracket; nine rounds: 0.02 / 7e10.
_SUBCELLS = 8  # Per side of a quadrature cell, to find how much of it is free.
_TOL = 1e-9  # Points on an outline count as free.


@dataclass(frozen=True)
class FreeSpace:
    """The part of the unit square where the item's center may be.

    Attributes:
        centers: Obstacle centers, shape (K, 2), in table units.
        obstacles: Each object grown by the item and the clearance; where the item's
            center may not be.
    """

    centers: Array
    obstacles: tuple[Footprint, ...]

    @classmethod
    def around(
        cls,
        centers: Array,
        footprints: Sequence[Footprint],
        item: Footprint,
        clearance: float,
    ) -> "FreeSpace":
        """Keep an item at a clearance from objects; points leave all space free."""
        solid = [k for k, footprint in enumerate(footprints) if footprint != POINT]
        grown = tuple(footprints[k].grow(item, clearance) for k in solid)
        return cls(centers[solid], grown)

    def contains(self, points: Array) -> Booleans:
        """Tell which points, shape (..., 2), are free, shape (...,)."""
        free: Booleans = np.all((points >= -_TOL) & (points <= 1.0 + _TOL), axis=-1)
        for center, obstacle in zip(self.centers, self.obstacles, strict=True):
            free &= obstacle.distance(points - center) >= -_TOL
        return free

    @cached_property
    def corners(self) -> Array:
        """Where outlines meet each other or the edge of the square, shape (V, 2)."""
        found = [np.empty((0, 2))]
        for index in range(len(self.obstacles)):
            arcs = self.outline_arcs(index)
            is_outside = self._margins(self.outline_points(index, arcs)) >= 0.0
            # Each constraint apart: a free stretch may be shorter than the spacing.
            margin, change = np.nonzero(is_outside != np.roll(is_outside, -1, axis=1))
            is_leaving = is_outside[margin, change]
            found.append(self._crossings(index, arcs[change], margin, is_leaving))
        points = np.concatenate(found)
        return points[self.contains(points)]

    def outline_arcs(self, index: int) -> Array:
        """Sample the outline of an obstacle evenly, arc lengths of shape (S,)."""
        perimeter = self.obstacles[index].perimeter
        num_samples = max(int(np.ceil(perimeter / _OUTLINE_SPACING)), 8)
        return np.linspace(0.0, perimeter, num_samples, endpoint=False)

    def outline_points(self, index: int, arcs: Array) -> Array:
        """Return the points at arc lengths along an obstacle's outline, (S, 2)."""
        return self.centers[index] + self.obstacles[index].outline(arcs)[0]

    def _margins(self, points: Array) -> Array:
        """Return how far points, shape (S, 2), are from each limit, (K + 4, S)."""
        outlines = zip(self.centers, self.obstacles, strict=True)
        distances = [
            obstacle.distance(points - center) for center, obstacle in outlines
        ]
        return np.stack([*distances, *points.T, *(1.0 - points.T)])

    def _crossings(
        self, index: int, arcs: Array, margin: Indices, is_leaving: Booleans
    ) -> Array:
        """Find where an outline crosses the limits `margin` just after `arcs`."""
        spacing = self.outline_arcs(index)[1]
        rows = np.arange(len(arcs))
        for _ in range(9):
            cuts = arcs[:, None] + spacing * _SECTIONS
            margins = self._margins(self.outline_points(index, cuts.ravel()))
            own = margins.reshape(-1, *cuts.shape)[margin, rows]
            is_past = (own >= 0.0) != is_leaving[:, None]
            is_past[:, 0], is_past[:, -1] = False, True
            arcs = cuts[rows, is_past.argmax(axis=1) - 1]
            spacing = spacing * _SECTIONS[1]
        return self.outline_points(index, arcs)

    def quadrature(self, num_cells: int) -> tuple[Array, Array]:
        """Cut the free space into square cells for an integral over it.

        Args:
            num_cells: Cells along each side of the unit square.

        Returns:
            The centroid of the free part of each cell (G, 2), in table units, and its
            area (G,), 0 for a cell that is not free at all; G = num_cells squared.
        """
        fine = num_cells * _SUBCELLS
        ticks = (np.arange(fine) + 0.5) / fine
        points = np.stack(np.meshgrid(ticks, ticks), axis=-1)
        blocks = (num_cells, _SUBCELLS, num_cells, _SUBCELLS)
        is_free = self.contains(points).astype(float)
        counts = is_free.reshape(blocks).sum(axis=(1, 3))
        moments = (is_free[..., None] * points).reshape(*blocks, 2).sum(axis=(1, 3))
        centers = points.reshape(*blocks, 2).mean(axis=(1, 3))
        shared = np.maximum(counts, 1.0)[..., None]
        centroids = np.where(counts[..., None] > 0, moments / shared, centers)
        return centroids.reshape(-1, 2), counts.ravel() / fine**2
