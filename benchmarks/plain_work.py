"""Plain numpy, put to the work that it is compared on."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import plain
from cases import (
    NUM_CANDIDATES,
    NUM_ROUNDS,
    NUM_TEST_LAYOUTS,
    demonstrations,
    make_rng,
    posterior_rewards,
)
from figure import Plain

from tablesetting.irl.arrays import Array
from tablesetting.irl.random_walk import RandomWalk
from tablesetting.irl.sampler import McmcConfig, run_chains, sample_uniform_weights
from tablesetting.reward.likelihood import (
    BoltzmannConfig,
    BoltzmannLikelihood,
    Demonstration,
)
from tablesetting.reward.problem import PlacementProblem

_MAX_STEPS = 2500  # Of a chain: all of the paper's.


def plain_placements(weights: Array, layouts: Array, widths: Array) -> Array:
    """Do what `best_placements` does on the square."""
    return plain.best_placements(weights, layouts, widths, rng=make_rng())


def plain_free_placements(
    problem: PlacementProblem, weights: Array, layouts: Array
) -> Array:
    """Place for one reward, shape (D,), in every layout; return shape (L, 2)."""
    best = np.empty((len(layouts), 2))
    for i, layout in enumerate(layouts):
        space = problem.space.free_space(layout, problem.task.receptacles)
        best[i] = plain.best_free_placement(weights, layout, problem.widths, space)
    return best


def plain_inference(problem: PlacementProblem, demos: Sequence[Demonstration]) -> Plain:
    """Prepare the chains of a problem's inference."""
    config = problem.config
    return plain_chain(demos, problem.widths, config.boltzmann, config.mcmc)


def plain_chain(
    demos: Sequence[Demonstration],
    widths: Array,
    config: BoltzmannConfig,
    mcmc: McmcConfig,
) -> Plain:
    """Prepare the steps of the chains, or the first of them, with the same likelihood.

    The adaptation of the proposal, the climb to the MAP and the diagnostics are left out.
    """
    log_likelihood = plain.LogLikelihood(demos, widths, config)
    dim = len(widths)
    start = sample_uniform_weights(mcmc.num_chains, dim, rng=make_rng())
    fast = BoltzmannLikelihood(demos, widths, config)
    np.testing.assert_allclose(log_likelihood(start), fast(start), rtol=1e-9)
    num_steps = min(mcmc.num_steps, _MAX_STEPS)
    short = replace(mcmc, num_steps=num_steps, burn_in=0, target_ess=None)
    mover = RandomWalk(log_likelihood, dim, short)
    return Plain(
        lambda: run_chains(mover, short, start=start, rng=make_rng()),
        share=num_steps / mcmc.num_steps,
    )


def plain_trial(problem: PlacementProblem) -> Plain:
    """Prepare one round of a trial, that with six demonstrations: the mean round.

    A round takes one chain, and placements for the MAP and 100 samples in 50 layouts and
    for the MAP in 200 more.
    """
    chain = plain_inference(problem, demonstrations(problem, (NUM_ROUNDS + 1) // 2))
    samples = posterior_rewards(problem.task)
    weights = np.vstack([samples[-1:], samples])
    candidates = problem.space.sample(NUM_CANDIDATES, rng=make_rng())
    tests = problem.space.sample(NUM_TEST_LAYOUTS, rng=make_rng())
    ascend = partial(plain_placements, widths=problem.widths)

    def work() -> None:
        chain.work()
        ascend(weights, candidates)
        ascend(weights[:1], tests)

    return Plain(work, share=1.0 / NUM_ROUNDS)
