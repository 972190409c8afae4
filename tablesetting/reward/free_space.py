"""Where on the table an item can stand, among the objects or in some of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
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
        receptacles: Centers of discs that are free on the square, whatever stands
            there, shape (R, 2).
        receptacle_radius: Their radius, in table units.
    """

    centers: Array
    obstacles: tuple[Footprint, ...]
    receptacles: Array = field(default_factory=lambda: np.empty((0, 2)))
    receptacle_radius: float = 0.0

    @classmethod
    def around(
        cls,
        centers: Array,
        footprints: Sequence[Footprint],
        item: Footprint,
        clearance: float,
        receptacles: Sequence[int] = (),
        receptacle_radius: float = 0.0,
    ) -> "FreeSpace":
        """Keep an item at a clearance from objects; points leave all space free.

        Args:
            centers: Object centers, shape (K, 2), in table units.
            footprints: What each object covers.
            item: What the item covers.
            clearance: Room around the item, in table units.
            receptacles: Rows of the objects that the item may be put into.
            receptacle_radius: How far from their centers, in table units.
        """
        solid = [k for k, footprint in enumerate(footprints) if footprint != POINT]
        grown = tuple(footprints[k].grow(item, clearance) for k in solid)
        return cls(centers[solid], grown, centers[list(receptacles)], receptacle_radius)

    def contains(self, points: Array) -> Booleans:
        """Tell which points, shape (..., 2), are free, shape (...,)."""
        free: Booleans = np.ones(points.shape[:-1], dtype=bool)
        for center, obstacle in zip(self.centers, self.obstacles, strict=True):
            free &= obstacle.distance(points - center) >= -_TOL
        free |= self.in_receptacle(points)
        free &= ((points >= -_TOL) & (points <= 1.0 + _TOL)).all(axis=-1)
        return free

    def in_receptacle(self, points: Array) -> Booleans:
        """Tell which points, shape (..., 2), are in a receptacle, shape (...,)."""
        offsets = points[..., None, :] - self.receptacles
        distances = Footprint(self.receptacle_radius).distance(offsets)
        is_inside: Booleans = np.any(distances <= _TOL, axis=-1)
        return is_inside

    @cached_property
    def outlines(self) -> Outlines:
        """Samples of the outlines of all obstacles, then of the receptacles."""
        discs = (Footprint(self.receptacle_radius),) * len(self.receptacles)
        centers = np.concatenate([self.centers, self.receptacles])
        return Outlines(centers, self.obstacles + discs)

    @cached_property
    def corners(self) -> Array:
        """Where outlines meet each other or the edge of the square, shape (V, 2)."""
        outlines = self.outlines
        points = outlines.points(outlines.owner, outlines.arcs)
        is_outside = self._margins(points) >= 0.0  # (S, K + R + 4)
        # Each limit apart: a free stretch may be shorter than the spacing.
        change = is_outside != is_outside[outlines.following]
        # On its own outline a point is inside or outside by rounding alone.
        change[np.arange(len(change)), outlines.owner] = False
        sample, limit = np.nonzero(change)
        is_leaving = is_outside[sample, limit]
        found = self._crossings(sample, limit, is_leaving)
        return found[self.contains(found)]

    def _margins(self, points: Array) -> Array:
        """Return how far points, (S, 2), are within each limit, (S, K + R + 4)."""
        outlines = self.outlines
        offsets = points[:, None] - outlines.centers
        distances = stadium_distance(offsets, outlines.radius, outlines.half_length)
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
                *cuts.shape, len(outlines.centers) + 4
            )
            is_past = (margins[rows, :, limit] >= 0.0) != is_leaving[:, None]
            is_past[:, 0], is_past[:, -1] = False, True
            start = cuts[rows, is_past.argmax(axis=1) - 1]
            spacing = spacing * _SECTIONS[1]
        return outlines.points(owner, start)
