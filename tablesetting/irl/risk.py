"""Value at risk, once for the whole project."""

import math

import numpy as np

from tablesetting.irl.arrays import Array, row_blocks


def value_at_risk(losses: Array, alpha: float, *, rank_offset: int = 0) -> Array:
    r"""Estimate the :math:`\alpha`-VaR of a loss from posterior samples.

    The estimate is the :math:`\lceil \alpha N \rceil`-th smallest loss: the smallest
    sample that at least a fraction :math:`\alpha` of all samples do not exceed. The
    authors' released code takes the next larger one, `rank_offset=1`.

    Args:
        losses: Policy loss under each sampled reward, shape (..., N).
        alpha: Quantile of the worst case, in (0, 1); the paper uses 0.95.
        rank_offset: Added to the rank of the order statistic.

    Returns:
        The alpha-quantile over the last axis, shape (...,), in the unit of `losses`.

    Raises:
        ValueError: If alpha is outside (0, 1) or there are no samples.
    """
    num_samples = losses.shape[-1]
    if not 0.0 < alpha < 1.0:
        raise ValueError(f"`alpha` must be in (0, 1); got {alpha}")
    if num_samples == 0:
        raise ValueError("`losses` holds no samples; draw at least one")
    # Rounding: 0.55 * 100 is a little over 55 in floating point.
    rank = math.ceil(round(alpha * num_samples, 9)) + rank_offset
    index = min(max(rank, 1), num_samples) - 1
    rows = losses.reshape(-1, num_samples)
    var = np.empty(len(rows))
    for block in row_blocks(len(rows), num_samples):
        var[block] = np.partition(rows[block], index, axis=-1)[:, index]
    return var.reshape(losses.shape[:-1])
