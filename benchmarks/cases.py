"""What the figures of learning are measured on."""

from collections.abc import Sequence
from functools import cache

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import value_at_risk
from tablesetting.reward.config import PAPER
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import SPOON, VASE, PlacementTask

TASKS = (VASE, SPOON)
NUM_CANDIDATES = PAPER.num_candidates
NUM_REWARDS = PAPER.mcmc.num_samples
NUM_TEST_LAYOUTS = 200
NUM_ROUNDS = 11  # The first demonstration and ten queries.


def make_rng() -> np.random.Generator:
    """Start the stream of random numbers that candidates, chains and restarts draw from."""
    return np.random.default_rng(0)


def demonstrations(problem: PlacementProblem, num_demos: int) -> list[Demonstration]:
    # Of a stream of their own, so that no candidate or test layout is among them.
    layouts = problem.space.sample(num_demos, rng=np.random.default_rng(1))
    return [problem.demonstrate(layout, rng=make_rng()) for layout in layouts]


def weigh_queries(
    problem: PlacementProblem, demos: Sequence[Demonstration], posterior: Posterior
) -> Array:
    """Draw the candidate queries and find the value at risk of each, shape (Q,)."""
    risk = problem.config.risk
    queries = problem.propose_queries(demos, rng=make_rng())
    losses = problem.policy_losses(queries, posterior)
    return value_at_risk(losses, risk.alpha, rank_offset=risk.rank_offset)


@cache
def posterior_rewards(task: PlacementTask) -> Array:
    """Return 100 rewards as they are possible after one demonstration, shape (100, D).

    Ten in a row are from one posterior; there are ten demonstrations, each by itself.
    """
    problem = PlacementProblem(task, PAPER)
    posteriors = [
        problem.infer([demo], None, rng=make_rng())
        for demo in demonstrations(problem, 10)
    ]
    return np.concatenate([posterior.weights[9::10] for posterior in posteriors])
