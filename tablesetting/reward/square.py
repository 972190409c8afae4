"""Optima of many rewards on the unit square: a grid, then Newton's method."""

import math
from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array, Booleans, Indices
from tablesetting.reward import _kernels
from tablesetting.reward.climb import climb
from tablesetting.reward.rbf import TABLE_CENTERS, all_centers, rbf_features

_MIN_INTERVALS = 15  # Of the grid along a side, and
_INTERVALS_PER_REACH = 8.2  # in the root of the least width.


@dataclass(frozen=True)
class Optima:
    """Local optima of several rewards in one layout.

    Attributes:
        points: Where, shape (S, 2), in table units.
        rewards: Reward there, shape (S,).
        sample: Index of the reward, shape (S,).
    """

    points: Array
    rewards: Array
    sample: Indices


def grid_ticks(widths: Array) -> Array:
    """Return the grid's coordinates along a side, closer for narrower RBFs, (T,)."""
    num_intervals = math.ceil(_INTERVALS_PER_REACH / math.sqrt(widths.min()))
    return np.linspace(0.0, 1.0, max(num_intervals, _MIN_INTERVALS) + 1)


def grid_points(widths: Array) -> Array:
    """Return the points that climbs start from, shape (G, 2), in table units."""
    return _lattice(grid_ticks(widths))


def cell_centers(size: int) -> Array:
    """Return the centers of the cells of a square grid, shape (size * size, 2)."""
    return _lattice((np.arange(size) + 0.5) / size)


def _lattice(ticks: Array) -> Array:
    """Pair coordinates with each other, rows from the first on, shape (T * T, 2)."""
    return np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)


def best_on_square(
    weights: Array, layouts: Array, widths: Array, ticks: Array | None = None
) -> Array:
    """Find the global optimum of every reward in every layout.

    Climbs start from the maxima of the grid that are high enough for it. Where two
    optima are closer to each other than the lines of the grid, it may show one alone.

    Args:
        weights: Reward weights, shape (N, D).
        layouts: Object centers, shape (L, K, 2), in table units; D is K + 9.
        widths: Width of each RBF, shape (D,), in squared table units.
        ticks: The grid's coordinates along a side; those of `grid_ticks` if None.

    Returns:
        Points, shape (L, N, 2), in table units.
    """
    num_objects = layouts.shape[1]
    ticks = grid_ticks(widths) if ticks is None else ticks
    on_table = rbf_features(_lattice(ticks), TABLE_CENTERS, widths[num_objects:])
    return _kernels.best_on_square(
        np.ascontiguousarray(weights),
        np.ascontiguousarray(all_centers(layouts).swapaxes(1, 2)),
        1.0 / widths,
        ticks,
        weights[:, num_objects:] @ on_table.T,
        climb_margins(weights, widths, ticks[1]),
    )


def square_optima(weights: Array, centers: Array, widths: Array) -> Optima:
    """Find the local optima in one layout that climbs from the grid's maxima reach.

    Args:
        weights: Reward weights, shape (N, D).
        centers: RBF centers, shape (D, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.

    Returns:
        The optima; the global one of each reward is among them but in rare cases.
    """
    grid = grid_points(widths)
    values = rbf_features(grid, centers, widths) @ weights.T
    point, sample = np.nonzero(_is_grid_maximum(values))
    at_centers = np.broadcast_to(centers, (len(point), *centers.shape))
    points, rewards = climb(grid[point], weights[sample], at_centers, widths)
    return Optima(points, rewards, sample)


def climb_margins(weights: Array, widths: Array, pitch: float) -> Array:
    """Bound twice how far optima are above the nearest point of the grid, shape (N,).

    No second derivative of a reward exceeds twice the L1 norm of its weights over the
    width, and no point is further from the grid than half a diagonal of its cells.
    """
    return np.abs(weights).sum(axis=1) * (pitch**2 / widths.min())


def _is_grid_maximum(values: Array) -> Booleans:
    """Tell which values on the grid, shape (G, N), no neighbour exceeds."""
    size = math.isqrt(len(values))
    grid = values.reshape(size, size, -1)
    is_maximum = np.ones(grid.shape, dtype=bool)
    for axis in (0, 1):
        difference = np.diff(grid, axis=axis)
        padding = [(0, 0)] * 3
        padding[axis] = (0, 1)
        is_maximum &= ~np.pad(difference > 0.0, padding)
        padding[axis] = (1, 0)
        is_maximum &= ~np.pad(difference < 0.0, padding)
    return is_maximum.reshape(values.shape)
