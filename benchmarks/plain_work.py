"""The plain loops, put to the work that they are compared on."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import plain
from cases import (
    NUM_CANDIDATES,
    NUM_REWARDS,
    NUM_ROUNDS,
    NUM_TEST_LAYOUTS,
    demonstrations,
    make_rng,
    posterior_rewards,
)
from figure import Plain

from tablesetting.irl.arrays import Array
from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.likelihood import BoltzmannLikelihood, Demonstration
from tablesetting.reward.problem import PlacementProblem


def plain_placements(weights: Array, layouts: Array, widths: Array) -> Array:
    """Do what `best_placements` does on the square, one by one."""
    rng = make_rng()
    best = np.empty((len(layouts), len(weights), 2))
    for i, layout in enumerate(layouts):
        for j, sample in enumerate(weights):
            rbfs = plain.make_rbfs(sample, layout, widths)
            best[i, j] = plain.best_placement(rbfs, rng=rng)
    return best


def plain_free_placements(
    problem: PlacementProblem, weights: Array, layouts: Array
) -> Array:
    """Place for one reward, shape (D,), in every layout; return shape (L, 2)."""
    best = np.empty((len(layouts), 2))
    for i, layout in enumerate(layouts):
        rbfs = plain.make_rbfs(weights, layout, problem.widths)
        space = problem.space.free_space(layout)
        best[i] = plain.best_free_placement(rbfs, space)
    return best


def plain_inference(
    problem: PlacementProblem, demos: Sequence[Demonstration], num_steps: int
) -> Plain:
    """Prepare a few steps of a plain chain with the same likelihood.

    The climb to the MAP and the adaptation of the proposal are left out.
    """
    config, mcmc = problem.config.boltzmann, problem.config.mcmc
    nodes = [tuple(node) for node in config.nodes().tolist()]
    log_post = partial(
        plain.log_likelihood,
        demos=demos,
        nodes=nodes,
        widths=problem.widths,
        beta=config.beta,
    )
    start = sample_uniform_weights(1, len(problem.widths), rng=make_rng())
    fast = BoltzmannLikelihood(demos, problem.widths, config)
    np.testing.assert_allclose(log_post(start[0]), fast(start)[0], rtol=1e-9)
    chain = partial(plain.run_chain, log_post, start[0], num_steps, mcmc.step_std)
    return Plain(
        lambda: chain(rng=make_rng()),
        share=num_steps / (mcmc.num_chains * mcmc.num_steps),
    )


def plain_trial(problem: PlacementProblem) -> Plain:
    """Prepare the mean round of a trial in part: six demonstrations are the mean.

    A round takes one chain, and placements for the MAP and 100 samples in 50 layouts and
    for the MAP in 200 more; each part is done to the same share.
    """
    share = 0.01
    num_placements = (NUM_REWARDS + 1) * NUM_CANDIDATES + NUM_TEST_LAYOUTS
    demos = demonstrations(problem, (NUM_ROUNDS + 1) // 2)
    chain = plain_inference(
        problem, demos, num_steps=round(share * problem.config.mcmc.num_steps)
    )
    layouts = problem.space.sample(round(share * num_placements), rng=make_rng())
    weights = posterior_rewards(problem.task)[-1:]

    def work() -> None:
        chain.work()
        plain_placements(weights, layouts, problem.widths)

    return Plain(work, share=share / NUM_ROUNDS)
