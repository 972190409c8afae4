"""Many small maximisations at once, by a damped Newton method."""

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward import _kernels


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
    return _kernels.climb(
        np.ascontiguousarray(starts),
        np.ascontiguousarray(weights),
        np.ascontiguousarray(centers.swapaxes(1, 2)),
        1.0 / widths,
        max_step,
    )
