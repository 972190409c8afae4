"""Many small maximisations at once, by a damped Newton method."""

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward.rbf import reward_derivatives

_MAX_ITERATIONS = 60
_STEP_TOL = 1e-11  # [table units]
_ROUNDING = 1e-15  # Of a reward.


def climb(
    starts: Array,
    weights: Array,
    centers: Array,
    widths: Array,
    *,
    max_step: float = 0.1,
) -> tuple[Array, Array]:
    """Climb to the local maximum on the unit square by a damped Newton method.

    The Hessian is shifted until it is negative definite (Levenberg and Marquardt) and
    the shift follows how well the quadratic model foretold the last step. A coordinate
    at the edge stays there while the gradient points outward.

    Args:
        starts: Where each climb begins, shape (S, 2), in table units.
        weights: Reward weights of each climb, shape (S, D).
        centers: RBF centers of each climb, shape (S, D, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.
        max_step: Largest change of a coordinate in one step, in table units.

    Returns:
        Points, shape (S, 2), and their rewards, shape (S,).
    """
    points = starts.copy()
    rewards, gradients, hessians = reward_derivatives(points, weights, centers, widths)
    damping = np.full(len(points), 1e-6)
    active = np.arange(len(points))
    for _ in range(_MAX_ITERATIONS):
        steps = _newton_steps(
            points[active], gradients[active], hessians[active], damping[active]
        )
        length = np.abs(steps).max(axis=1, keepdims=True)
        steps *= np.minimum(1.0, max_step / np.maximum(length, _STEP_TOL))
        trial = np.clip(points[active] + steps, 0.0, 1.0)
        moved = np.abs(trial - points[active]).max(axis=1) > _STEP_TOL
        active, trial = active[moved], trial[moved]
        if not active.size:
            break
        values, slopes, curvatures = reward_derivatives(
            trial, weights[active], centers[active], widths
        )
        gain = values - rewards[active]
        expected = _expected_gain(
            trial - points[active], gradients[active], hessians[active]
        )
        damping[active] = _next_damping(damping[active], gain, expected)
        is_up = gain >= -_ROUNDING
        up = active[is_up]
        points[up], rewards[up] = trial[is_up], values[is_up]
        gradients[up], hessians[up] = slopes[is_up], curvatures[is_up]
    return points, rewards


def _expected_gain(steps: Array, gradients: Array, hessians: Array) -> Array:
    """Return what steps, shape (S, 2), gain under the quadratic model, shape (S,)."""
    bend = np.einsum("si,sij,sj->s", steps, hessians, steps)
    return (steps * gradients).sum(axis=1) + 0.5 * bend


def _next_damping(damping: Array, gain: Array, expected: Array) -> Array:
    """Trust the model more where it foretold the gain well, less where badly."""
    is_good = gain > 0.75 * expected - _ROUNDING
    is_bad = gain < 0.25 * expected - _ROUNDING
    less = np.maximum(damping / 10, 1e-9)
    more = np.maximum(damping * 10, 1e-3)
    return np.where(is_bad, more, np.where(is_good, less, damping))


def _newton_steps(
    points: Array, gradients: Array, hessians: Array, damping: Array
) -> Array:
    """Solve the shifted 2 x 2 systems, shape (S, 2)."""
    is_held = ((points <= 0.0) & (gradients < 0.0)) | (
        (points >= 1.0) & (gradients > 0.0)
    )
    gradients = np.where(is_held, 0.0, gradients)
    cross = np.where(is_held.any(axis=1), 0.0, hessians[:, 0, 1])
    first = np.where(is_held[:, 0], -1.0, hessians[:, 0, 0])
    second = np.where(is_held[:, 1], -1.0, hessians[:, 1, 1])
    middle, spread = 0.5 * (first + second), 0.5 * (first - second)
    largest = middle + np.hypot(spread, cross)
    shift = np.maximum(largest, 0.0) + damping
    first, second = shift - first, shift - second
    determinant = first * second - cross * cross
    steps = np.stack(
        [
            second * gradients[:, 0] + cross * gradients[:, 1],
            cross * gradients[:, 0] + first * gradients[:, 1],
        ],
        axis=1,
    )
    return steps / np.maximum(determinant, 1e-300)[:, None]
