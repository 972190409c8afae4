"""The best placement where objects are in the way of the best one on the square.

It is one of: a local optimum of the square that is free, a point of the outline of an
obstacle or a receptacle where the reward is stationary along it, or a corner of the
free space.
"""

import numpy as np

from tablesetting.irl.arrays import Array, Indices
from tablesetting.reward.climb import climb
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.rbf import rbf_features, reward_derivatives
from tablesetting.reward.square import grid_points, square_optima

_MAX_ITERATIONS = 60
_STEP_TOL = 1e-11  # [table units]
_SMALL_STEP = 0.01  # [table units], so as not to leap over a small optimum.
_PROBE = 1e-6  # [table units]

_Found = tuple[Array, Array, Indices]
"""Points (S, 2), their rewards (S,) and the rewards' indices (S,)."""


def best_free_placements(
    weights: Array, centers: Array, widths: Array, space: FreeSpace
) -> Array:
    """Find the best free placement of every reward in one layout.

    Args:
        weights: Reward weights, shape (N, D).
        centers: RBF centers, shape (D, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.
        space: Where the item may be.

    Returns:
        Placements, shape (N, 2), in table units; NaN where no point is free.
    """
    optima = square_optima(weights, centers, widths)
    found = [
        _free_of((optima.points, optima.rewards, optima.sample), space),
        _free_of(_outline_optima(weights, centers, widths, space), space),
        _pair_with_all(space.corners, weights, centers, widths),
        _best_free_samples(weights, centers, widths, space),
    ]
    found.append(
        _climb_where_open(_best_of_each(found), weights, centers, widths, space)
    )
    points, _, samples = _best_of_each(found)
    best = np.full((len(weights), 2), np.nan)
    best[samples] = points
    return best


def _climb_where_open(
    found: _Found, weights: Array, centers: Array, widths: Array, space: FreeSpace
) -> _Found:
    """Climb on from points whose gradient leads into the free space.

    There the reward has a small optimum nearby, which the grid did not show.
    """
    points, _, samples = found
    at_centers = np.broadcast_to(centers, (len(points), *centers.shape))
    _, gradients, _ = reward_derivatives(points, weights[samples], at_centers, widths)
    length = np.linalg.norm(gradients, axis=1, keepdims=True)
    ahead = np.clip(points + _PROBE * gradients / np.maximum(length, _PROBE), 0.0, 1.0)
    is_open = space.contains(ahead) & (np.abs(ahead - points).max(axis=1) > _STEP_TOL)
    points, samples = points[is_open], samples[is_open]
    points, rewards = climb(
        points, weights[samples], at_centers[is_open], widths, max_step=_SMALL_STEP
    )
    return _free_of((points, rewards, samples), space)


def _free_of(found: _Found, space: FreeSpace) -> _Found:
    """Keep what is free."""
    points, rewards, samples = found
    is_free = space.contains(points)
    return points[is_free], rewards[is_free], samples[is_free]


def _best_of_each(found: list[_Found]) -> _Found:
    """Keep the best for each reward; a reward without any is left out."""
    points, rewards, samples = (
        np.concatenate(parts) for parts in zip(*found, strict=True)
    )
    order = np.lexsort((-rewards, samples))
    first = order[np.unique(samples[order], return_index=True)[1]]
    return points[first], rewards[first], samples[first]


def _pair_with_all(
    points: Array, weights: Array, centers: Array, widths: Array
) -> _Found:
    """Pair every point with every reward."""
    values = rbf_features(points, centers, widths) @ weights.T  # (V, N)
    samples = np.tile(np.arange(len(weights)), len(points))
    return np.repeat(points, len(weights), axis=0), values.ravel(), samples


def _best_free_samples(
    weights: Array, centers: Array, widths: Array, space: FreeSpace
) -> _Found:
    """Take the best free sample of grid and outlines, lest a tiny free spot is lost."""
    outlines = space.outlines
    points = np.concatenate(
        [grid_points(widths), outlines.points(outlines.owner, outlines.arcs)]
    )
    points = points[space.contains(points)]
    values = rbf_features(points, centers, widths) @ weights.T
    if not len(points):
        return points, np.empty(0), np.empty(0, dtype=int)
    best = values.argmax(axis=0)
    return points[best], values.max(axis=0), np.arange(len(weights))


def _outline_optima(
    weights: Array, centers: Array, widths: Array, space: FreeSpace
) -> _Found:
    """Climb along the outlines, free or not, from their sampled maxima.

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
    low = arc - outlines.spacing[outlines.preceding[rows]]
    high = arc + outlines.spacing[rows]
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
    rewards = (rbf_features(points, centers, widths) * weights[samples]).sum(axis=1)
    return points, rewards, samples
