"""How likely demonstrations are of a person who means the best place, and nearly hits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.sampler import LogNormal, McmcConfig, SpherePrior, Walk
from tablesetting.reward import _kernels
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import TABLE_CENTERS, all_centers, rbf_features
from tablesetting.reward.square import climb_margins, grid_points, grid_ticks

_SHARE_LOCAL, _SHARE_ISOTROPIC = 0.9, 0.05  # Of the steps; the rest move one weight.
_LOCAL_SIZE = 2.0  # In the root of the number of weights,
_LOCAL_SCALES = (1.0, 0.4, 0.15)  # times one of these,
_SCALE_SHARES = (0.7, 0.2, 0.1)  # this often.
_LEAST_STEP, _LARGEST_STEP = 1e-4, 0.3  # Of a weight, where the metric is not used.
_NOISE_STEP = 0.5  # Of the logarithm of the noise.


@dataclass(frozen=True)
class NoiseConfig:
    """How exactly the demonstrator puts the item where it is wanted most."""

    noise_std: float = 0.01
    """Standard deviation of placements along each axis, in table units; the median of
    its prior where it is sampled."""
    noise_spread: float = 0.0
    """Prior standard deviation of its logarithm; 0 fixes it."""

    def __post_init__(self) -> None:
        if not 1e-3 <= self.noise_std < math.inf:
            raise ValueError(
                f"`noise_std` must be at least 0.001 table units; got {self.noise_std}"
            )
        if not 0.0 <= self.noise_spread <= 2.0:
            raise ValueError(
                f"`noise_spread` must be in [0, 2]; got {self.noise_spread}"
            )

    @property
    def noise_prior(self) -> LogNormal | None:
        """The prior of the noise; None where it is fixed."""
        spread = self.noise_spread
        return LogNormal(self.noise_std, spread) if spread > 0.0 else None


class PlacementLikelihood:
    r"""A demonstrator who means the best placement :math:`x^*_w` and nearly hits it.

    .. math:: P(x \mid C, w) \propto \exp(-\lVert x - x^*_w(C) \rVert^2 / 2 s^2)

    It is normalised as a density around the placement that was shown, cut off at the
    edges of the unit square: a constant, which matters for evidence alone.
    """

    def __init__(
        self, demos: Sequence[Demonstration], widths: Array, config: NoiseConfig
    ):
        layouts = np.stack([demo.layout for demo in demos])
        placements = np.stack([demo.placement for demo in demos])
        centers = all_centers(layouts)
        ticks = grid_ticks(widths)
        nodes = rbf_features(grid_points(widths), centers, widths).swapaxes(1, 2)
        num_objects = layouts.shape[1]
        self._prior = SpherePrior(num_objects + len(TABLE_CENTERS), config.noise_prior)
        self._features = _kernels.AnswerFeatures(
            config.noise_std,
            config.noise_spread,
            _log_constant(placements, config.noise_std),
            placements,
            np.ascontiguousarray(centers.swapaxes(1, 2)),
            1.0 / widths,
            ticks,
            table=np.ascontiguousarray(nodes[0, num_objects:]),
            objects=np.ascontiguousarray(nodes[:, :num_objects]),
            margin=float(climb_margins(np.ones((1, 1)), widths, ticks[1])[0]),
        )

    def __call__(self, states: Array) -> Array:
        """Evaluate log likelihoods.

        Args:
            states: Weights of unit L1 norm, then the logarithm of the noise where it is
                sampled, shape (C, D + E).

        Returns:
            Log densities, shape (C,).
        """
        return _kernels.answer_log_likelihoods(
            np.ascontiguousarray(states), self._features
        )

    def mover(self, config: McmcConfig) -> "LocalWalk":
        """Return what takes the steps."""
        return LocalWalk(self, self._prior)

    def walk(
        self, start: Array, proposals: _kernels.LocalProposals, power: float
    ) -> Walk:
        """Take steps on the ridges of the likelihood."""
        states = np.ascontiguousarray(start)
        return Walk(*_kernels.walk_locally(states, proposals, self._features, power))


class LocalWalk:
    r"""Metropolis-adjusted Langevin steps in the metric of the best placement.

    A demonstration fixes two directions of the weights to within the noise and leaves
    the others free, so that the posterior is a bundle of curved ridges. With
    :math:`J_d = \partial x^*_d / \partial w = -H^{-1} \partial \nabla R / \partial w`, a
    step is drawn from

    .. math:: \delta \sim N(\tfrac{c^2}{2} A^{-1} g,\; c^2 A^{-1}), \quad
        A = \tfrac{1}{s^2} \sum_d J_d^T J_d + \tfrac{D^2}{2} I, \quad
        g = \tfrac{1}{s^2} \sum_d J_d^T (x_d - x^*_d)

    (the simplified manifold MALA of Girolami and Calderhead 2011, with the Gauss-Newton
    metric), and scaled back to the sphere as in `irl.random_walk`. At an edge of the
    table a placement moves along that alone. Some steps are isotropic or move one
    weight: they cross from ridge to ridge. Implements `irl.sampler.Mover`.
    """

    def __init__(self, likelihood: PlacementLikelihood, prior: SpherePrior):
        self.log_likelihood = likelihood
        self.prior = prior

    def take_steps(
        self,
        start: Array,
        log_likelihoods: Array,
        num_steps: int,
        power: float,
        *,
        rng: np.random.Generator,
    ) -> Walk:
        """Take steps from states of known likelihood, which a power flattens."""
        proposals = self._propose(num_steps, len(start), rng=rng)
        return self.log_likelihood.walk(start, proposals, power)

    def adapt(self, walked: Walk, *, is_annealing: bool) -> None:
        """Do nothing: the metric is known."""

    def _propose(
        self, num_steps: int, num_chains: int, *, rng: np.random.Generator
    ) -> _kernels.LocalProposals:
        dim, shape = self.prior.dim, (num_steps, num_chains)
        choice, moved = rng.random(shape), rng.integers(dim, size=shape)
        is_local = choice < _SHARE_LOCAL
        is_isotropic = ~is_local & (choice < _SHARE_LOCAL + _SHARE_ISOTROPIC)
        sizes = rng.choice(_LOCAL_SCALES, size=shape, p=_SCALE_SHARES)
        least, largest = math.log(_LEAST_STEP), math.log(_LARGEST_STEP)
        return _kernels.LocalProposals(
            noise=rng.standard_normal((*shape, dim)),
            kinds=np.select(
                [is_local, is_isotropic], [_kernels.LOCAL, _kernels.ISOTROPIC], moved
            ),
            scales=np.where(
                is_local,
                _LOCAL_SIZE / math.sqrt(dim) * sizes,
                np.exp(rng.uniform(least, largest, size=shape)),
            ),
            log_uniforms=-rng.standard_exponential(shape),
            std_noise=_NOISE_STEP * rng.standard_normal(shape),
            std_log_uniforms=-rng.standard_exponential(shape),
        )


def _log_constant(placements: Array, noise_std: float) -> float:
    """Normalise the density of each placement within the unit square, in sum."""
    edges = np.stack([placements, placements - 1.0]) / (noise_std * math.sqrt(2.0))
    shares = [
        0.5 * (math.erf(low) - math.erf(high))
        for low, high in zip(edges[0].ravel(), edges[1].ravel(), strict=True)
    ]
    # Placements far off the square, as in simulations without a table, have none there.
    log_shares = np.log(np.maximum(shares, 0.5))
    return -len(placements) * math.log(2.0 * math.pi) - float(log_shares.sum())
