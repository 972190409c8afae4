"""The reward of a placement: Gaussian RBFs on the objects and on the table."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array

TABLE_CENTERS: Array = np.array(
    [[x, y] for y in (1.0, 0.5, 0.0) for x in (0.0, 0.5, 1.0)]
)
"""Centers of the nine RBFs that are fixed on the table, shape (9, 2): rows from y = 1
to y = 0, x from 0 to 1 in each."""

_MIN_WIDTH, _MAX_WIDTH = 0.05, 100.0  # [table units squared]


@dataclass(frozen=True)
class RbfWidths:
    r"""The widths :math:`\sigma^2` of the RBFs, in squared table units."""

    object_width: float = 0.3
    """Of the RBFs on the objects."""
    table_width: float = 0.3
    """Of the RBFs that are fixed on the table."""

    def __post_init__(self) -> None:
        for name in ("object_width", "table_width"):
            if not _MIN_WIDTH <= getattr(self, name) <= _MAX_WIDTH:
                raise ValueError(
                    f"`{name}` must be at least {_MIN_WIDTH}, so that the grid that "
                    "placements start from sees every peak, and at most "
                    f"{_MAX_WIDTH:g}; got {getattr(self, name)}"
                )

    def per_center(self, num_objects: int) -> Array:
        """Return one width for each center, objects first, shape (D,)."""
        return np.repeat(
            [self.object_width, self.table_width], [num_objects, len(TABLE_CENTERS)]
        )


def all_centers(layouts: Array) -> Array:
    """Append the table's fixed centers to the objects'.

    Args:
        layouts: Object centers, shape (..., K, 2), in table units.

    Returns:
        Centers, shape (..., D, 2) with D = K + 9.
    """
    fixed = np.broadcast_to(TABLE_CENTERS, (*layouts.shape[:-2], *TABLE_CENTERS.shape))
    return np.concatenate([layouts, fixed], axis=-2)


def rbf_features(points: Array, centers: Array, widths: Array) -> Array:
    r"""Evaluate :math:`\exp(-\lVert x - c \rVert^2 / \sigma^2)` at every point.

    Args:
        points: Positions on the table, shape (..., G, 2), in table units.
        centers: RBF centers, shape (..., D, 2), in table units.
        widths: :math:`\sigma^2` of each center, shape (D,), in squared table units.

    Returns:
        Features, shape (..., G, D), each in (0, 1].
    """
    squared = (points[..., :, None, 0] - centers[..., None, :, 0]) ** 2
    squared += (points[..., :, None, 1] - centers[..., None, :, 1]) ** 2
    return np.exp(-squared / widths)


def reward_derivatives(
    points: Array, weights: Array, centers: Array, widths: Array
) -> tuple[Array, Array, Array]:
    r"""Evaluate :math:`R(x) = \sum_i w_i e^{-\lVert x - c_i \rVert^2 / \sigma_i^2}`.

    Every point has its own reward, so that many placements can be optimised at once.

    Args:
        points: Positions, shape (S, 2), in table units.
        weights: Reward weights at each point, shape (S, D).
        centers: RBF centers at each point, shape (S, D, 2), in table units.
        widths: :math:`\sigma^2` of each center, shape (D,), in squared table units.

    Returns:
        Rewards (S,), gradients (S, 2) and Hessians (S, 2, 2) with respect to x.
    """
    dx = points[:, 0, None] - centers[..., 0]
    dy = points[:, 1, None] - centers[..., 1]
    terms = weights * np.exp(-(dx * dx + dy * dy) / widths)
    scaled = -2.0 * terms / widths
    curved = -2.0 * scaled / widths
    gradients = np.stack([(scaled * dx).sum(axis=1), (scaled * dy).sum(axis=1)], axis=1)
    isotropic = scaled.sum(axis=1)
    hessians = np.empty((len(points), 2, 2))
    hessians[:, 0, 0] = isotropic + (curved * dx * dx).sum(axis=1)
    hessians[:, 1, 1] = isotropic + (curved * dy * dy).sum(axis=1)
    hessians[:, 0, 1] = hessians[:, 1, 0] = (curved * dx * dy).sum(axis=1)
    return terms.sum(axis=1), gradients, hessians
