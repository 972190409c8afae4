"""The best placement under a reward, exact but for a few in a million.

The global optimum on the unit square comes first, for all rewards and layouts at once;
where an object is in its way, the best free placement.
"""

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward.free_placement import best_free_placements
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.rbf import all_centers
from tablesetting.reward.square import best_on_square


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
    best = best_on_square(weights, layouts, widths)
    for index, space in enumerate(free_spaces or []):
        blocked = np.flatnonzero(~space.contains(best[index]))
        if blocked.size:
            best[index, blocked] = best_free_placements(
                weights[blocked], all_centers(layouts[index]), widths, space
            )
    return best
