"""The outlines of all that limits the free space, as one set of samples."""

from collections.abc import Sequence

import numpy as np

from tablesetting.irl.arrays import Array, Indices
from tablesetting.reward.footprint import Footprint, stadium_outline

_SPACING = 0.02  # Between samples, in table units, or less.


class Outlines:
    """Closed outlines and samples of them, which stand together for each outline.

    Attributes:
        centers: Center of each outline, shape (K, 2), in table units.
        radius: Radius of each, shape (K,), in table units.
        half_length: Half length of each, shape (K,).
        owner: Outline that each sample belongs to, shape (S,).
        arcs: Arc length of each sample along its outline, shape (S,).
        spacing: Distance along the outline to the next sample, shape (S,).
        following: Index of the next sample on the same outline, shape (S,).
        preceding: Index of the sample before, shape (S,).
    """

    def __init__(self, centers: Array, footprints: Sequence[Footprint]):
        self.centers = centers
        self.radius = np.array([footprint.radius for footprint in footprints])
        self.half_length = np.array([each.half_length for each in footprints])
        sampled = [self._sample(k, footprints) for k in range(len(footprints))]
        counts = np.array([len(arcs) for arcs in sampled], dtype=int)
        self.owner: Indices = np.repeat(np.arange(len(counts)), counts)
        self.arcs: Array = np.concatenate([np.empty(0), *sampled])
        first = np.cumsum(counts) - counts
        rank = np.arange(len(self.owner)) - first[self.owner]
        count = counts[self.owner]
        self.following: Indices = first[self.owner] + (rank + 1) % count
        self.preceding: Indices = first[self.owner] + (rank - 1) % count
        perimeters = np.array([footprint.perimeter for footprint in footprints])
        steps = self.arcs[self.following] - self.arcs
        self.spacing: Array = np.where(
            steps > 0.0, steps, steps + perimeters[self.owner]
        )

    def _sample(self, index: int, footprints: Sequence[Footprint]) -> Array:
        """Return the arc lengths of the samples on one outline, in their order."""
        own = footprints[index]
        # Four extreme points, and those nearest to each other outline, are among the
        # samples: an outline may pass a limit there by less than the spacing.
        num_even = 4 * max(int(np.ceil(own.perimeter / _SPACING / 4)), 2)
        even = np.linspace(0.0, own.perimeter, num_even, endpoint=False)
        towards = np.delete(self.centers, index, axis=0) - self.centers[index]
        reach = np.delete(self.half_length, index) + own.half_length
        along = np.sign(towards[:, 1]) * np.maximum(np.abs(towards[:, 1]) - reach, 0.0)
        angles = np.arctan2(along, towards[:, 0])
        nearest = own.radius * angles + np.where(angles < 0.0, -1, 1) * own.half_length
        return np.unique(np.concatenate([even, np.mod(nearest, own.perimeter)]))

    def points(self, owner: Indices, arcs: Array) -> Array:
        """Return the points at arc lengths along outlines, shape (S, 2)."""
        return self.walk(owner, arcs)[0]

    def walk(self, owner: Indices, arcs: Array) -> tuple[Array, Array, Array]:
        """Return points (S, 2), outward normals (S, 2) and curvatures (S,).

        Args:
            owner: Outline that each arc length is on, shape (S,).
            arcs: Arc lengths, shape (S,), in table units.
        """
        offsets, normals, curvatures = stadium_outline(
            arcs, self.radius[owner], self.half_length[owner]
        )
        return self.centers[owner] + offsets, normals, curvatures
