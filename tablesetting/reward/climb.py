"""Many small maximisations at once, by a damped Newton method."""

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward.rbf import reward_derivatives

_MAX_STEP = 0.1  # [table units]
_MAX_ITERATIONS = 60
_STEP_TOL = 1e-11  # [table units]


def climb(
    starts: Array, weights: Array, centers: Array, widths: Array
) -> tuple[Array, Array]:
    """Climb to the local maximum on the unit square by a damped Newton method.

    The Hessian is shifted until it is negative definite (Levenberg and Marquardt) and
    the shift grows after a step that did not climb. A coordinate at the edge stays
    there while the gradient points outward.

    Args:
        starts: Where each climb begins, shape (S, 2), in table units.
        weights: Reward weights of each climb, shape (S, D).
        centers: RBF centers of each climb, shape (S, D, 2), in table units.
        widths: Width of each RBF, shape (D,), in squared table units.

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
        trial = np.clip(points[active] + steps, 0.0, 1.0)
        moved = np.abs(trial - points[active]).max(axis=1) > _STEP_TOL
        active, trial = active[moved], trial[moved]
        if not active.size:
            break
        values, slopes, curvatures = reward_derivatives(
            trial, weights[active], centers[active], widths
        )
        is_up = values >= rewards[active]
        damping[active] = np.where(
            is_up, np.maximum(damping[active] / 10, 1e-9), damping[active] * 10
        )
        up = active[is_up]
        points[up], rewards[up] = trial[is_up], values[is_up]
        gradients[up], hessians[up] = slopes[is_up], curvatures[is_up]
    return points, rewards


def _newton_steps(
    points: Array, gradients: Array, hessians: Array, damping: Array
) -> Array:
    """Solve the shifted 2 x 2 systems, shape (S, 2), within the largest step."""
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
    steps /= np.maximum(determinant, 1e-300)[:, None]
    length = np.abs(steps).max(axis=1, keepdims=True)
    return steps * np.minimum(1.0, _MAX_STEP / np.maximum(length, 1e-300))
