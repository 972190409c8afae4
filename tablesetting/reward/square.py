"""Local optima of many rewards on the unit square: a grid, then Newton's method."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array, Indices
from tablesetting.reward.climb import climb
from tablesetting.reward.rbf import rbf_features

_GRID_SIZE = 14  # Points along a side, the edges included.
_TICKS = np.linspace(0.0, 1.0, _GRID_SIZE)
GRID: Array = np.stack(np.meshgrid(_TICKS, _TICKS), axis=-1).reshape(-1, 2)
"""The points that climbs start from, shape (G, 2), in table units."""


@dataclass(frozen=True)
class Optima:
    """Local optima, each of one reward in one layout.

    Attributes:
        points: Where, shape (S, 2), in table units.
        rewards: Reward there, shape (S,).
        layout: Index of the layout, shape (S,).
        sample: Index of the reward, shape (S,).
    """

    points: Array
    rewards: Array
    layout: Indices
    sample: Indices


def square_optima(
    weights: Array, centers: Array, widths: Array, *, only_best: bool
) -> Optima:
    """Find the local optima on the unit square.

    Args:
        weights: Reward weights, shape (N, D).
        centers: RBF centers in each layout, shape (L, D, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.
        only_best: Whether those that cannot be the global optimum may be left out.

    Returns:
        At least the global optimum of each reward in each layout.
    """
    features = rbf_features(GRID, centers, widths)
    # One product for all layouts: a stack of small ones would not reach BLAS.
    values = features.reshape(-1, features.shape[-1]) @ weights.T
    values = values.reshape(len(centers), len(GRID), len(weights))
    margin = _near_best(weights, widths) if only_best else np.inf
    layout, point, sample = _grid_maxima(values, values.max(axis=1) - margin)
    points, rewards = climb(GRID[point], weights[sample], centers[layout], widths)
    return Optima(points, rewards, layout, sample)


def _near_best(weights: Array, widths: Array) -> Array:
    """Bound twice how far an optimum is above the nearest point of the grid, (N,).

    No second derivative of a reward exceeds 2 |w|_1 / width, and no point is further
    from the grid than half a diagonal of its cells.
    """
    return np.abs(weights).sum(axis=1) * (_TICKS[1] ** 2 / widths.min())


def _grid_maxima(values: Array, floor: Array) -> tuple[Indices, Indices, Indices]:
    """Find points of the grid that no neighbour exceeds, above the floor (L, N).

    Returns:
        Layout, point and reward of each, as indices of shape (S,).
    """
    num_layouts, _, num_samples = values.shape
    grid = values.reshape(num_layouts, _GRID_SIZE, _GRID_SIZE, num_samples)
    is_maximum = grid >= floor[:, None, None]
    for axis in (1, 2):
        lower = [slice(None)] * 4
        upper = [slice(None)] * 4
        lower[axis], upper[axis] = slice(None, -1), slice(1, None)
        is_higher = grid[tuple(lower)] > grid[tuple(upper)]
        is_lower = grid[tuple(lower)] < grid[tuple(upper)]
        is_maximum[tuple(lower)] &= ~is_lower
        is_maximum[tuple(upper)] &= ~is_higher
    layout, row, column, sample = np.nonzero(is_maximum)
    return layout, row * _GRID_SIZE + column, sample
