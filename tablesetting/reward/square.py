"""Optima of many rewards on the unit square: a grid, then Newton's method."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array, Booleans, Indices
from tablesetting.reward import _kernels
from tablesetting.reward.climb import climb
from tablesetting.reward.rbf import TABLE_CENTERS, all_centers, rbf_features

_GRID_SIZE = 14  # Points along a side, the edges included.
_TICKS = np.linspace(0.0, 1.0, _GRID_SIZE)
GRID: Array = np.stack(np.meshgrid(_TICKS, _TICKS), axis=-1).reshape(-1, 2)
"""The points that climbs start from, shape (G, 2), in table units."""


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


def best_on_square(weights: Array, layouts: Array, widths: Array) -> Array:
    """Find the global optimum of every reward in every layout.

    Climbs start from the maxima of the grid that are high enough for it.

    Args:
        weights: Reward weights, shape (N, D).
        layouts: Object centers, shape (L, K, 2), in table units; D is K + 9.
        widths: Width of each RBF, shape (D,), in squared table units.

    Returns:
        Points, shape (L, N, 2), in table units.
    """
    num_objects = layouts.shape[1]
    on_table = rbf_features(GRID, TABLE_CENTERS, widths[num_objects:])
    return _kernels.best_on_square(
        np.ascontiguousarray(weights),
        np.ascontiguousarray(all_centers(layouts).swapaxes(1, 2)),
        1.0 / widths,
        _TICKS,
        weights[:, num_objects:] @ on_table.T,
        _near_best(weights, widths),
    )


def square_optima(weights: Array, centers: Array, widths: Array) -> Optima:
    """Find the local optima in one layout that climbs from the grid's maxima reach.

    Args:
        weights: Reward weights, shape (N, D).
        centers: RBF centers, shape (D, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.

    Returns:
        The optima, the global one of each reward among them.
    """
    values = rbf_features(GRID, centers, widths) @ weights.T
    point, sample = np.nonzero(_is_grid_maximum(values))
    at_centers = np.broadcast_to(centers, (len(point), *centers.shape))
    points, rewards = climb(GRID[point], weights[sample], at_centers, widths)
    return Optima(points, rewards, sample)


def _near_best(weights: Array, widths: Array) -> Array:
    """Bound twice how far an optimum is above the nearest point of the grid, (N,).

    No second derivative of a reward exceeds 2 |w|_1 / width, and no point is further
    from the grid than half a diagonal of its cells.
    """
    return np.abs(weights).sum(axis=1) * (_TICKS[1] ** 2 / widths.min())


def _is_grid_maximum(values: Array) -> Booleans:
    """Tell which values on the grid, shape (G, N), no neighbour exceeds."""
    grid = values.reshape(_GRID_SIZE, _GRID_SIZE, -1)
    is_maximum = np.ones(grid.shape, dtype=bool)
    for axis in (0, 1):
        difference = np.diff(grid, axis=axis)
        padding = [(0, 0)] * 3
        padding[axis] = (0, 1)
        is_maximum &= ~np.pad(difference > 0.0, padding)
        padding[axis] = (1, 0)
        is_maximum &= ~np.pad(difference < 0.0, padding)
    return is_maximum.reshape(values.shape)
