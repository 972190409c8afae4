"""The outlines of all obstacles in a layout, as one set of samples."""

from collections.abc import Sequence

import numpy as np

from tablesetting.irl.arrays import Array, Indices
from tablesetting.reward.footprint import Footprint, stadium_outline

_SPACING = 0.02  # Between samples, in table units.
_LEAST_SAMPLES = 8


class Outlines:
    """Closed outlines, sampled evenly; samples of one outline stand together.

    Attributes:
        radius: Radius of each obstacle, shape (K,), in table units.
        half_length: Half length of each obstacle, shape (K,).
        owner: Obstacle that each sample belongs to, shape (S,).
        arcs: Arc length of each sample along its outline, shape (S,).
        spacing: Distance along the outline to the next sample, shape (S,).
        following: Index of the next sample on the same outline, shape (S,).
        preceding: Index of the sample before, shape (S,).
    """

    def __init__(self, centers: Array, obstacles: Sequence[Footprint]):
        self._centers = centers
        self.radius = np.array([obstacle.radius for obstacle in obstacles])
        self.half_length = np.array([obstacle.half_length for obstacle in obstacles])
        perimeters = np.array([obstacle.perimeter for obstacle in obstacles])
        counts = np.ceil(perimeters / _SPACING).astype(int)
        counts = np.maximum(counts, _LEAST_SAMPLES)
        first = np.cumsum(counts) - counts
        self.owner: Indices = np.repeat(np.arange(len(obstacles)), counts)
        rank = np.arange(len(self.owner)) - first[self.owner]
        self.spacing: Array = (perimeters / counts)[self.owner]
        self.arcs: Array = rank * self.spacing
        count = counts[self.owner]
        self.following: Indices = first[self.owner] + (rank + 1) % count
        self.preceding: Indices = first[self.owner] + (rank - 1) % count

    def points(self, owner: Indices, arcs: Array) -> Array:
        """Return the points at arc lengths along outlines, shape (S, 2)."""
        return self.walk(owner, arcs)[0]

    def walk(self, owner: Indices, arcs: Array) -> tuple[Array, Array, Array]:
        """Return points (S, 2), outward normals (S, 2) and curvatures (S,).

        Args:
            owner: Obstacle whose outline each arc length is on, shape (S,).
            arcs: Arc lengths, shape (S,), in table units.
        """
        offsets, normals, curvatures = stadium_outline(
            arcs, self.radius[owner], self.half_length[owner]
        )
        return self._centers[owner] + offsets, normals, curvatures
