"""The array types of the package, and two helpers that numpy lacks."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Booleans = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]


def log_sum_exp(values: Array) -> Array:
    r"""Evaluate :math:`\log \sum_i e^{v_i}` without overflow.

    Args:
        values: Exponents, shape (..., N); minus infinity marks an absent term.

    Returns:
        The logarithm of the sum over the last axis, shape (...,).
    """
    peak = values.max(axis=-1, keepdims=True)
    return np.log(np.exp(values - peak).sum(axis=-1)) + peak[..., 0]


def normalize_l1(vectors: Array) -> Array:
    """Scale vectors to unit L1 norm.

    Args:
        vectors: Vectors, none of them zero, shape (..., D).

    Returns:
        The same directions on the L1 unit sphere, shape (..., D).
    """
    return vectors / np.abs(vectors).sum(axis=-1, keepdims=True)
