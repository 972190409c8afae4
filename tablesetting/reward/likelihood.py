"""How likely a demonstration is under a reward."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tablesetting.irl.arrays import Array, log_sum_exp
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.rbf import all_centers, rbf_features


@dataclass(frozen=True)
class Demonstration:
    """One answer of the demonstrator.

    Attributes:
        layout: Object centers, shape (K, 2), in table units.
        placement: Where the item was put, shape (2,), in table units.
    """

    layout: Array
    placement: Array


@dataclass(frozen=True)
class BoltzmannConfig:
    """How rational the demonstrator is, and how the normaliser is computed."""

    beta: float = 100.0
    """Rationality of the demonstrator."""
    quadrature: Literal["cells", "lattice"] = "cells"
    """Integrate over square cells of the free space, or sum over a lattice of points
    that includes the edges of the square, as the authors' released code does."""
    resolution: int = 48
    """Cells or lattice points along each side."""

    def __post_init__(self) -> None:
        if not self.beta > 0.0:
            raise ValueError(f"`beta` must be positive; got {self.beta}")
        if self.resolution < 2:
            raise ValueError(f"`resolution` must be at least 2; got {self.resolution}")

    def nodes(self, space: FreeSpace) -> tuple[Array, Array]:
        """Return the points (G, 2) and weights (G,) of the normaliser's sum."""
        if self.quadrature == "cells":
            return space.quadrature(self.resolution)
        ticks = np.linspace(0.0, 1.0, self.resolution)
        points = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
        return points, np.full(len(points), 1.0 / len(points))


class BoltzmannLikelihood:
    r"""A demonstrator who prefers good placements to the degree :math:`\beta`.

    .. math:: P(x \mid C, w) = e^{\beta R_w(x; C)} / \int_F e^{\beta R_w(y; C)} dy

    over the free space F of the layout C (Bayesian IRL, Ramachandran and Amir 2007, for
    one placement). Features of demonstrations and normalisers are computed once.
    """

    def __init__(
        self,
        demos: Sequence[Demonstration],
        free_spaces: Sequence[FreeSpace],
        widths: Array,
        config: BoltzmannConfig,
    ):
        self._beta = config.beta
        centers = all_centers(np.stack([demo.layout for demo in demos]))
        placements = np.stack([demo.placement for demo in demos])
        self._shown = rbf_features(placements[:, None], centers, widths)[:, 0].sum(0)
        points, areas = _stack_nodes([config.nodes(space) for space in free_spaces])
        features = rbf_features(points, centers, widths)  # (D, G, F)
        self._features = features.reshape(-1, features.shape[-1]).T
        with np.errstate(divide="ignore"):
            self._log_areas = np.log(areas)

    def __call__(self, weights: Array) -> Array:
        """Evaluate the log likelihood of weights, shape (C, F), as shape (C,)."""
        rewards = (weights @ self._features).reshape(-1, *self._log_areas.shape)
        normalisers = log_sum_exp(self._beta * rewards + self._log_areas)
        return self._beta * (weights @ self._shown) - normalisers.sum(axis=-1)


def _stack_nodes(nodes: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Stack the nodes of all demonstrations, as few of no area as the shape allows.

    Returns:
        Points, shape (D, G, 2), and areas, shape (D, G).
    """
    points = np.stack([points for points, _ in nodes])
    areas = np.stack([areas for _, areas in nodes])
    most = int(np.count_nonzero(areas, axis=1).max())
    order = np.argsort(areas == 0.0, axis=1, kind="stable")[:, :most]
    points = np.take_along_axis(points, order[..., None], axis=1)
    return points, np.take_along_axis(areas, order, axis=1)
