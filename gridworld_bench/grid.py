"""Cells in rows and columns, and the steps from each to the next."""

import numpy as np

from tablesetting.irl.arrays import Indices

ACTIONS = ("up", "down", "left", "right")
"""Names of the actions; one that leads off the grid stays where it is."""

_MOVES = ((-1, 0), (1, 0), (0, -1), (0, 1))  # Rows and columns.


def grid_successors(num_rows: int, num_columns: int) -> Indices:
    """Return where each action leads, row by row, shape (S, A, 1)."""
    rows, columns = np.divmod(np.arange(num_rows * num_columns), num_columns)
    moved = [
        np.clip(rows + down, 0, num_rows - 1) * num_columns
        + np.clip(columns + right, 0, num_columns - 1)
        for down, right in _MOVES
    ]
    return np.stack(moved, axis=1)[..., None]
