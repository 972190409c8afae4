"""The array types of the package, and two helpers that numpy lacks."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Booleans = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]


_BLOCK_ELEMENTS = 2**20


def normalize_l1(vectors: Array) -> Array:
    """Scale vectors to unit L1 norm.

    Args:
        vectors: Vectors, none of them zero, shape (..., D).

    Returns:
        The same directions on the L1 unit sphere, shape (..., D).
    """
    return vectors / np.abs(vectors).sum(axis=-1, keepdims=True)


def row_blocks(num_rows: int, row_size: int) -> Iterator[slice]:
    """Cut rows into blocks of about a million elements, to bound the memory of work.

    Args:
        num_rows: How many rows there are.
        row_size: Elements that one row takes.

    Yields:
        Consecutive slices, of one row at least.
    """
    step = max(_BLOCK_ELEMENTS // max(row_size, 1), 1)
    for first in range(0, num_rows, step):
        yield slice(first, min(first + step, num_rows))
