"""Samples of the reward given the demonstrations."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.diagnostics import effective_sample_size, split_rhat
from tablesetting.irl.sampler import (
    LogLikelihood,
    McmcConfig,
    run_chains,
    sample_uniform_weights,
)


@dataclass(frozen=True)
class Posterior:
    """Samples from P(R | D), one reward hypothesis per row.

    Attributes:
        weights: Reward weights, shape (N, D); every row has unit L1 norm.
        log_posts: Unnormalised log posterior of each row, shape (N,).
        map_weights: The most probable weights that the chains visited, shape (D,).
        acceptance_rate: Fraction of proposals accepted, in [0, 1].
        ess: Effective sample size of the worst weight.
        rhat: Split R-hat of the worst weight.
    """

    weights: Array
    log_posts: Array
    map_weights: Array
    acceptance_rate: float
    ess: float
    rhat: float


def infer_posterior(
    log_likelihood: LogLikelihood,
    dim: int,
    config: McmcConfig,
    *,
    previous_map: Array | None,
    rng: np.random.Generator,
) -> Posterior:
    """Sample the posterior of the weights under a uniform prior.

    Args:
        log_likelihood: Log likelihood of a batch of weights.
        dim: Number of weights, D.
        config: Chains, steps and thinning.
        previous_map: MAP of the posterior before the last demonstration, shape (D,),
            or None at the first.
        rng: Source of the start and the proposals.

    Returns:
        The thinned samples and what the full chains say of their quality.
    """
    if config.starts_at_map:
        center = np.zeros(dim) if previous_map is None else previous_map
        noise = rng.standard_normal((config.num_chains, dim))
        start = center + config.step_std * noise
        start /= np.abs(start).sum(axis=1, keepdims=True)
    else:
        start = sample_uniform_weights(config.num_chains, dim, rng=rng)
    chains = run_chains(log_likelihood, start, config, rng=rng)
    thinned = slice(config.thin - 1, None, config.thin)
    return Posterior(
        weights=chains.weights[:, thinned].reshape(-1, dim),
        log_posts=chains.log_posts[:, thinned].ravel(),
        map_weights=chains.best_weights,
        acceptance_rate=chains.acceptance_rate,
        ess=effective_sample_size(chains.weights),
        rhat=split_rhat(chains.weights),
    )
