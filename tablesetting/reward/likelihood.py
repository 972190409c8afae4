"""How likely a demonstration is under a reward."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.sampler import Proposals, Walk
from tablesetting.reward import _kernels
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
    """Integrate over square cells, or sum over a lattice of points that includes the
    edges of the square, as the authors' released code does."""
    resolution: int = 32
    """Cells or lattice points along each side."""

    def __post_init__(self) -> None:
        if not self.beta > 0.0:
            raise ValueError(f"`beta` must be positive; got {self.beta}")
        if self.resolution < 2:
            raise ValueError(f"`resolution` must be at least 2; got {self.resolution}")

    def nodes(self) -> Array:
        """Return the points of the normaliser's sum, shape (G, 2), of equal weight."""
        ticks = np.linspace(0.0, 1.0, self.resolution)
        if self.quadrature == "cells":
            ticks = (np.arange(self.resolution) + 0.5) / self.resolution
        return np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)


class BoltzmannLikelihood:
    r"""A demonstrator who prefers good placements to the degree :math:`\beta`.

    .. math:: P(x \mid C, w) = e^{\beta R_w(x; C)} / \int e^{\beta R_w(y; C)} dy

    over the unit square (Bayesian IRL, Ramachandran and Amir 2007, for one placement).
    Features of demonstrations and normalisers are computed once.
    """

    def __init__(
        self, demos: Sequence[Demonstration], widths: Array, config: BoltzmannConfig
    ):
        centers = all_centers(np.stack([demo.layout for demo in demos]))
        placements = np.stack([demo.placement for demo in demos])
        shown = rbf_features(placements[:, None], centers, widths)[:, 0].sum(axis=0)
        nodes = rbf_features(config.nodes(), centers, widths).swapaxes(1, 2)
        num_objects = demos[0].layout.shape[0]
        self._features = _kernels.ChoiceFeatures(
            config.beta,
            shown,
            table=np.ascontiguousarray(nodes[0, num_objects:]),
            objects=np.ascontiguousarray(nodes[:, :num_objects]),
        )

    def __call__(self, weights: Array) -> Array:
        """Evaluate the log likelihood of weights, shape (C, F), as shape (C,)."""
        return _kernels.log_likelihoods(np.ascontiguousarray(weights), self._features)

    def walk(self, start: Array, log_posts: Array, proposals: Proposals) -> Walk:
        """Take Metropolis-Hastings steps; the same as `irl.sampler.walk`, compiled."""
        steps = _kernels.walk(
            np.ascontiguousarray(start),
            np.ascontiguousarray(log_posts),
            proposals.steps,
            proposals.squared_noise,
            proposals.log_uniforms,
            proposals.is_prior_uniform,
            self._features,
        )
        return Walk(*steps)
