"""Demonstrations, and how likely they are of a noisily rational person."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import softmax

from tablesetting.irl.arrays import Array
from tablesetting.irl.random_walk import Proposals, RandomWalk
from tablesetting.irl.sampler import LogNormal, McmcConfig, Walk
from tablesetting.reward import _kernels
from tablesetting.reward.rbf import all_centers, rbf_features

_NODES_PER_REACH = 1.1  # Along a side, in the root of width / beta.
_MIN_NODES = 12


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
    """Rationality of the demonstrator; the median of its prior where it is sampled."""
    beta_spread: float = 0.0
    """Prior standard deviation of its logarithm; 0 fixes it."""
    quadrature: Literal["gauss", "lattice"] = "gauss"
    """Integrate by Gauss and Legendre's nodes, or sum over a lattice of points that
    includes the edges of the square, as the authors' released code does."""
    resolution: int | None = None
    """Nodes along each side; None takes enough for the widths and beta."""

    def __post_init__(self) -> None:
        if not 0.0 < self.beta < math.inf:
            raise ValueError(f"`beta` must be positive; got {self.beta}")
        if not 0.0 <= self.beta_spread < math.inf:
            raise ValueError(f"`beta_spread` must be 0 or more; got {self.beta_spread}")
        if self.resolution is not None and self.resolution < 2:
            raise ValueError(f"`resolution` must be at least 2; got {self.resolution}")

    @property
    def beta_prior(self) -> LogNormal | None:
        """The prior of beta; None where it is fixed."""
        spread = self.beta_spread
        return LogNormal(self.beta, spread) if spread > 0.0 else None

    def nodes(self, width: float) -> tuple[Array, Array]:
        """Return where the reward is evaluated for the normaliser.

        Args:
            width: Least width of an RBF, in squared table units.

        Returns:
            Points, shape (G, 2), in table units, and each one's share of the square,
            shape (G,).
        """
        size = self.resolution or self._enough(width)
        if self.quadrature == "lattice":
            ticks, shares = np.linspace(0.0, 1.0, size), np.full(size, 1.0 / size)
        else:
            ticks, shares = np.polynomial.legendre.leggauss(size)
            ticks, shares = 0.5 * (ticks + 1.0), 0.5 * shares
        points = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
        return points, (shares[:, None] * shares).ravel()

    def _enough(self, width: float) -> int:
        """Return how many nodes along a side resolve the sharpest peak."""
        sharpest = self.beta * math.exp(2.0 * self.beta_spread)
        return max(
            math.ceil(_NODES_PER_REACH * math.sqrt(sharpest / width)), _MIN_NODES
        )


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
        points, shares = config.nodes(widths.min())
        nodes = rbf_features(points, centers, widths).swapaxes(1, 2)
        num_objects = demos[0].layout.shape[0]
        self._beta_prior = config.beta_prior
        self._features = _kernels.ChoiceFeatures(
            config.beta,
            config.beta_spread,
            np.log(shares),
            shown,
            table=np.ascontiguousarray(nodes[0, num_objects:]),
            objects=np.ascontiguousarray(nodes[:, :num_objects]),
        )

    def __call__(self, states: Array) -> Array:
        """Evaluate log likelihoods.

        Args:
            states: Weights, then the logarithm of beta where it is sampled, shape
                (C, D + E).

        Returns:
            Log densities over the unit square, shape (C,).
        """
        return _kernels.log_likelihoods(np.ascontiguousarray(states), self._features)

    def concave_gradient(self, state: Array) -> Array:
        r"""Differentiate the log likelihood by the weights.

        .. math:: \nabla_w = \beta \sum_d (\phi(x_d) - E_w[\phi(x) \mid C_d])

        The likelihood is concave in the weights, as that of any log-linear model.

        Args:
            state: Weights of any norm, then the logarithm of beta where it is sampled,
                shape (D + E,).

        Returns:
            The gradient, shape (D,).
        """
        features = self._features
        dim, num_objects = len(features.shown), features.objects.shape[1]
        beta = math.exp(state[dim]) if self._beta_prior else features.beta
        of_objects, of_table = state[:num_objects], state[num_objects:dim]
        rewards = of_objects @ features.objects + of_table @ features.table
        chances = softmax(beta * rewards + features.log_shares, axis=1)
        expected = np.concatenate(
            [
                np.einsum("dg,dkg->k", chances, features.objects),
                features.table @ chances.sum(axis=0),
            ]
        )
        return beta * (features.shown - expected)

    def mover(self, config: McmcConfig) -> RandomWalk:
        """Return what takes the steps."""
        return RandomWalk(self, len(self._features.shown), config, self._beta_prior)

    def walk(self, start: Array, log_likelihoods: Array, proposals: Proposals) -> Walk:
        """Take the steps of `irl.random_walk.walk`, compiled."""
        steps = _kernels.walk(
            np.ascontiguousarray(start),
            np.ascontiguousarray(log_likelihoods),
            proposals.steps,
            proposals.squared_noise,
            proposals.log_uniforms,
            proposals.is_prior_uniform,
            proposals.power,
            self._features,
        )
        return Walk(*steps)
