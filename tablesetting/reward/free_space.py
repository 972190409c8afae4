"""Where on the table an item can stand among the objects."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tablesetting.irl.arrays import Array, Booleans, Indices
from tablesetting.reward.footprint import POINT, Footprint, stadium_distance
from tablesetting.reward.outlines import Outlines

_SECTIONS = np.linspace(0.0, 1.0, 17)  # Cuts of a bracket around a crossing,
_NUM_CUTS = 9  # made so often that 0.02 becomes 3e-13.
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
    def outlines(self) -> Outlines:
        """Samples of the outlines of all obstacles."""
        return Outlines(self.centers, self.obstacles)

    @cached_property
    def corners(self) -> Array:
        """Where outlines meet each other or the edge of the square, shape (V, 2)."""
        outlines = self.outlines
        points = outlines.points(outlines.owner, outlines.arcs)
        is_outside = self._margins(points) >= 0.0  # (S, K + 4)
        # Each limit apart: a free stretch may be shorter than the spacing.
        change = is_outside != is_outside[outlines.following]
        # On its own outline a point is inside or outside by rounding alone.
        change[np.arange(len(change)), outlines.owner] = False
        sample, limit = np.nonzero(change)
        is_leaving = is_outside[sample, limit]
        found = self._crossings(sample, limit, is_leaving)
        return found[self.contains(found)]

    def _margins(self, points: Array) -> Array:
        """Return how far points, shape (S, 2), are within each limit, (S, K + 4)."""
        offsets = points[:, None] - self.centers
        radius, half_length = self.outlines.radius, self.outlines.half_length
        distances = stadium_distance(offsets, radius, half_length)
        return np.concatenate([distances, points, 1.0 - points], axis=1)

    def _crossings(
        self, sample: Indices, limit: Indices, is_leaving: Booleans
    ) -> Array:
        """Find where outlines cross limits just after samples, by ever finer cuts."""
        outlines, rows = self.outlines, np.arange(len(sample))
        owner, start = outlines.owner[sample], outlines.arcs[sample]
        spacing = outlines.spacing[sample]
        for _ in range(_NUM_CUTS):
            cuts = start[:, None] + spacing[:, None] * _SECTIONS
            points = outlines.points(np.repeat(owner, len(_SECTIONS)), cuts.ravel())
            margins = self._margins(points).reshape(
                *cuts.shape, len(self.obstacles) + 4
            )
            is_past = (margins[rows, :, limit] >= 0.0) != is_leaving[:, None]
            is_past[:, 0], is_past[:, -1] = False, True
            start = cuts[rows, is_past.argmax(axis=1) - 1]
            spacing = spacing * _SECTIONS[1]
        return outlines.points(owner, start)
