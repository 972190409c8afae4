"""The best placement under a reward: a grid, then Newton's method, exact.

The global optimum on the unit square comes first, for all rewards and layouts at once.
Where an object is in its way, the optimum over the free space is one of: a local
optimum of the square that is free, a point of an obstacle's outline where the reward
is stationary along it, or a corner of the free space.
"""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array, Indices
from tablesetting.reward.climb import climb
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.rbf import (
    all_centers,
    rbf_features,
    reward_derivatives,
)

_GRID_SIZE = 14  # Points along a side, the edges included.
_NEAR_BEST = 0.02  # No optimum is this much above the nearest point of the grid.
_MAX_ITERATIONS = 60
_STEP_TOL = 1e-11  # [table units]

_TICKS = np.linspace(0.0, 1.0, _GRID_SIZE)
_GRID = np.stack(np.meshgrid(_TICKS, _TICKS), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class _Starts:
    """Points to climb from; each belongs to one (layout, reward) pair."""

    points: Array
    layout: Indices
    sample: Indices


def best_placements(
    weights: Array,
    layouts: Array,
    widths: Array,
    free_spaces: list[FreeSpace] | None = None,
) -> Array:
    """Find the best placement of every reward in every layout.

    Args:
        weights: Reward weights, shape (N, D).
        layouts: Object centers, shape (L, K, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.
        free_spaces: Where the item may be in each layout; None for the unit square.

    Returns:
        Placements, shape (L, N, 2), in table units; NaN where no point is free.
    """
    centers = all_centers(layouts)
    features = rbf_features(_GRID, centers, widths)
    # One product for all layouts: a stack of small ones would not reach BLAS.
    values = features.reshape(-1, features.shape[-1]) @ weights.T
    values = values.reshape(len(layouts), len(_GRID), len(weights))
    starts = _grid_maxima(values, values.max(axis=1) - _NEAR_BEST)
    points, rewards = _climb(starts, weights, centers, widths)
    best = np.empty((len(layouts), len(weights), 2))
    # Later entries win, so the best of each pair is written last.
    order = np.argsort(rewards)
    best[starts.layout[order], starts.sample[order]] = points[order]
    for index, space in enumerate(free_spaces or []):
        blocked = np.flatnonzero(~space.contains(best[index]))
        if blocked.size:
            best[index, blocked] = _best_in_free_space(
                weights[blocked], centers[index], widths, space
            )
    return best


def _grid_maxima(values: Array, floor: Array) -> _Starts:
    """Return the grid points that no neighbour exceeds, above the floor (L, N)."""
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
    return _Starts(_GRID[row * _GRID_SIZE + column], layout, sample)


def _climb(
    starts: _Starts, weights: Array, centers: Array, widths: Array
) -> tuple[Array, Array]:
    """Climb from every start under its own reward and layout."""
    return climb(starts.points, weights[starts.sample], centers[starts.layout], widths)


def _best_in_free_space(
    weights: Array, centers: Array, widths: Array, space: FreeSpace
) -> Array:
    """Find the best free placement of each reward in one layout, shape (N, 2)."""
    values = (rbf_features(_GRID, centers, widths) @ weights.T)[None]
    starts = _grid_maxima(values, np.full((1, len(weights)), -np.inf))
    starts = _add_free_starts(starts, values[0], space)
    points, rewards = _climb(starts, weights, centers[None], widths)
    is_free = space.contains(points)
    found = [(points[is_free], rewards[is_free], starts.sample[is_free])]
    found.append(_outline_optima(weights, centers, widths, space))
    found.append(_corner_values(weights, centers, widths, space))
    points, rewards, samples = (
        np.concatenate(parts) for parts in zip(*found, strict=True)
    )
    best = np.full((len(weights), 2), np.nan)
    order = np.argsort(rewards)
    best[samples[order]] = points[order]
    return best


def _add_free_starts(starts: _Starts, values: Array, space: FreeSpace) -> _Starts:
    """Add the best free point of the grid for each reward: a maximum may hide there."""
    free = np.flatnonzero(space.contains(_GRID))
    if not free.size:
        return starts
    num_samples = values.shape[1]
    return _Starts(
        np.concatenate([starts.points, _GRID[free[values[free].argmax(axis=0)]]]),
        np.concatenate([starts.layout, np.zeros(num_samples, dtype=int)]),
        np.concatenate([starts.sample, np.arange(num_samples)]),
    )


def _corner_values(
    weights: Array, centers: Array, widths: Array, space: FreeSpace
) -> tuple[Array, Array, Indices]:
    """Pair every corner of the free space with every reward."""
    corners = space.corners
    values = rbf_features(corners, centers, widths) @ weights.T  # (V, N)
    points = np.repeat(corners, len(weights), axis=0)
    return points, values.ravel(), np.tile(np.arange(len(weights)), len(corners))


def _outline_optima(
    weights: Array, centers: Array, widths: Array, space: FreeSpace
) -> tuple[Array, Array, Indices]:
    """Climb along the outlines from their sampled maxima to those that are free.

    With the arc length s, outward normal n and curvature k of the outline,
    dR/ds = g . t and d2R/ds2 = t' H t - k g . n.
    """
    outlines = space.outlines
    points = outlines.points(outlines.owner, outlines.arcs)
    values = rbf_features(points, centers, widths) @ weights.T  # (S, N)
    is_maximum = values >= values[outlines.preceding]
    is_maximum &= values >= values[outlines.following]
    rows, samples = np.nonzero(is_maximum)
    owner, arc = outlines.owner[rows], outlines.arcs[rows]
    low, high = arc - outlines.spacing[rows], arc + outlines.spacing[rows]
    at_centers = np.broadcast_to(centers, (len(arc), *centers.shape))
    for _ in range(_MAX_ITERATIONS):
        points, normals, curvatures = outlines.walk(owner, arc)
        _, gradients, hessians = reward_derivatives(
            points, weights[samples], at_centers, widths
        )
        tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
        slope = (gradients * tangents).sum(axis=1)
        bend = np.einsum("si,sij,sj->s", tangents, hessians, tangents)
        bend -= curvatures * (gradients * normals).sum(axis=1)
        # Newton inside a shrinking bracket, bisection where it would leave it.
        low, high = np.where(slope > 0.0, arc, low), np.where(slope > 0.0, high, arc)
        target = arc - slope / np.where(bend < 0.0, bend, -1e-300)
        is_inside = (bend < 0.0) & (target >= low) & (target <= high)
        target = np.where(is_inside, target, 0.5 * (low + high))
        step = np.abs(target - arc).max(initial=0.0)
        arc = target
        if step < _STEP_TOL:
            break
    points = outlines.points(owner, arc)
    is_free = space.contains(points)
    points, samples = points[is_free], samples[is_free]
    rewards = (rbf_features(points, centers, widths) * weights[samples]).sum(axis=1)
    return points, rewards, samples
