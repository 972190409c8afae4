"""Bayesian inverse reinforcement learning on an MDP."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from gridworld_bench.likelihood import Evidence, MdpLikelihood
from gridworld_bench.mdp import Mdp
from tablesetting.irl.arrays import Array, Indices
from tablesetting.irl.posterior import Posterior, infer_posterior
from tablesetting.irl.sampler import Diagnosis, McmcConfig

BETA = 100.0
"""Rationality of the demonstrator."""


@dataclass(frozen=True)
class CoordinateChain:
    """The paper's chain: it steps along some coordinates, clips and renormalises.

    It accepts by the likelihood alone, so that its prior is not uniform.
    """

    num_samples: int = 10_000
    """Samples kept."""
    thinning: int = 5
    """Proposals for each."""
    num_coordinates: int = 5
    """Coordinates that a proposal changes, at most all there are,"""
    step: float = 0.05
    """each by as much, up or down."""


ChainConfig = CoordinateChain | McmcConfig
"""The paper's chain, or the sound one."""


@dataclass(frozen=True)
class MdpPosterior(Posterior):
    """Samples of the reward of an MDP.

    Attributes:
        optimal_values: Optimal value of each state under each sample, shape (N, S).
        evidence: What the demonstrator has said.
        beta: Rationality that the demonstrator was thought to have.
    """

    optimal_values: Array = field(kw_only=True)
    evidence: Evidence = field(kw_only=True)
    beta: float = field(kw_only=True)

    @cached_property
    def distinct_rows(self) -> tuple[Indices, Indices]:
        """Samples that differ from the one before, and for how long each stays."""
        is_new = np.r_[True, (self.weights[1:] != self.weights[:-1]).any(axis=1)]
        rows = np.flatnonzero(is_new)
        return rows, np.diff(np.r_[rows, len(self.weights)])


def infer(
    mdp: Mdp,
    demos: Sequence[Evidence],
    config: ChainConfig,
    *,
    beta: float = BETA,
    rng: np.random.Generator,
) -> MdpPosterior:
    """Sample the posterior of reward weights.

    Args:
        mdp: The world.
        demos: What the demonstrator has said, at least one pair.
        config: Which chain.
        beta: Rationality of the demonstrator.
        rng: Source of start and proposals.

    Returns:
        The samples, with the optimal values of each.
    """
    likelihood = MdpLikelihood(mdp, Evidence.join(demos), beta)
    if isinstance(config, CoordinateChain):
        return _walk_coordinates(likelihood, config, rng=rng)
    found = infer_posterior(likelihood, mdp.num_features, config, rng=rng)
    known = {each.name: getattr(found, each.name) for each in fields(found)}
    return MdpPosterior(
        **known,
        optimal_values=likelihood.weigh(found.weights)[1],
        evidence=likelihood.evidence,
        beta=likelihood.beta,
    )


def _walk_coordinates(
    likelihood: MdpLikelihood, config: CoordinateChain, *, rng: np.random.Generator
) -> MdpPosterior:
    dim = likelihood.mdp.num_features
    num_moved = min(config.num_coordinates, dim)
    shape = (config.num_samples * config.thinning, num_moved)
    # Nobody knows better at first than that everything is bad.
    start = -rng.dirichlet(np.ones(dim))
    weights, values, log_posts, best, _, num_accepted = likelihood.walk_coordinates(
        start,
        _choose_distinct(shape, dim, rng=rng),
        np.where(rng.integers(2, size=shape, dtype=bool), config.step, -config.step),
        -rng.standard_exponential(shape[0]),
        config.thinning,
    )
    mean = weights.mean(axis=0)
    norm = np.abs(mean).sum()
    return MdpPosterior(
        weights=weights,
        log_posts=log_posts,
        scales=None,
        map_weights=best,
        mean_weights=mean / norm if norm > 0.0 else best,
        guess="map",
        num_chains=1,
        acceptance_rate=num_accepted / shape[0],
        diagnosis=Diagnosis.of_chains(weights[:, None]),
        is_sound=False,  # Its prior depends on how it steps.
        log_evidence=math.nan,
        optimal_values=values,
        evidence=likelihood.evidence,
        beta=likelihood.beta,
    )


def _choose_distinct(
    shape: tuple[int, int], num: int, *, rng: np.random.Generator
) -> Indices:
    """Draw distinct numbers below `num` for each row (Floyd & Bentley 1987)."""
    num_rows, num_chosen = shape
    chosen = np.empty(shape, dtype=np.intp)
    for k, most in enumerate(range(num - num_chosen, num)):
        drawn = rng.integers(most + 1, size=num_rows)
        is_taken = (chosen[:, :k] == drawn[:, None]).any(axis=1)
        chosen[:, k] = np.where(is_taken, most, drawn)
    return chosen
