"""Samples of the reward given the demonstrations."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array, normalize_l1
from tablesetting.irl.diagnostics import effective_sample_size, split_rhat
from tablesetting.irl.sampler import (
    LogLikelihood,
    McmcConfig,
    run_chains,
    sample_uniform_weights,
)

_MAP_BATCH = 64  # Proposals tried at once on the way to the MAP.
_MAP_STEP = 0.03
_MAP_GROWTH, _MAP_SHRINKAGE = 1.2, 0.7  # After a step that was better, or not.


@dataclass(frozen=True)
class Posterior:
    """Samples from P(R | D), one reward hypothesis per row.

    Attributes:
        weights: Reward weights, shape (N, D); every row has unit L1 norm.
        log_posts: Unnormalised log posterior of each row, shape (N,).
        map_weights: The most probable weights that were found, shape (D,).
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
        start = normalize_l1(center + config.step_std * noise)
    else:
        start = sample_uniform_weights(config.num_chains, dim, rng=rng)
    chains = run_chains(log_likelihood, start, config, rng=rng)
    map_weights = climb_to_map(
        log_likelihood, chains.best_weights, config.num_map_steps, rng=rng
    )
    thinned = slice(config.thin - 1, None, config.thin)
    return Posterior(
        weights=chains.weights[:, thinned].reshape(-1, dim),
        log_posts=chains.log_posts[:, thinned].ravel(),
        map_weights=map_weights,
        acceptance_rate=chains.acceptance_rate,
        ess=effective_sample_size(chains.weights),
        rhat=split_rhat(chains.weights),
    )


def climb_to_map(
    log_likelihood: LogLikelihood,
    start: Array,
    num_steps: int,
    *,
    rng: np.random.Generator,
) -> Array:
    """Climb from a good sample to the most probable weights by a random search.

    The best of many samples in a dozen dimensions is still well below the mode. Each
    step takes the best of a batch of proposals of mixed sizes; the sizes grow after a
    step that was better and shrink where none is. No derivatives are needed, nor does
    the search mind the edges of the L1 sphere, where sparse rewards lie.

    Args:
        log_likelihood: Log likelihood of a batch of weights; the prior is uniform.
        start: Where to begin, shape (D,), of unit L1 norm.
        num_steps: Batches to try.
        rng: Source of the proposals.

    Returns:
        Weights at least as probable as the start, shape (D,).
    """
    best, best_value, step = start, log_likelihood(start[None])[0], _MAP_STEP
    for _ in range(num_steps):
        sizes = step * rng.lognormal(-0.5, 1.0, size=(_MAP_BATCH, 1))
        noise = rng.standard_normal((_MAP_BATCH, len(start)))
        proposals = normalize_l1(best + sizes * noise)
        values = log_likelihood(proposals)
        index = int(values.argmax())
        if values[index] > best_value:
            best, best_value = proposals[index], values[index]
            step *= _MAP_GROWTH
        else:
            step *= _MAP_SHRINKAGE
    return best
