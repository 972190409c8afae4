"""One strategy in one world, as rows."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np

from gridworld_bench.experiments.config import StudyConfig
from gridworld_bench.gridworlds import random_world
from gridworld_bench.mdp import Mdp
from gridworld_bench.posterior import CoordinateChain
from gridworld_bench.problem import MdpConfig, MdpProblem
from gridworld_bench.strategies import ACTION_METHODS, CRITIQUE_METHODS, Method
from tablesetting.irl.active import run_active
from tablesetting.irl.arrays import Array
from tablesetting.irl.risk import RiskConfig
from tablesetting.irl.sampler import McmcConfig

COLUMNS = (
    *("world", "strategy", "trial", "num_queries", "policy_loss", "max_policy_loss"),
    *("var", "query", "query_seconds", "inference_seconds"),
)
"""Columns of rounds.csv."""

_NUM_SHOWN = 2  # Best actions that are known at first.
_DIGITS = 9


@dataclass(frozen=True)
class Trial:
    """A strategy in a world; all strategies meet the same worlds.

    Attributes:
        strategy: Who asks.
        index: Which world, from 0.
    """

    strategy: str
    index: int


def all_trials(config: StudyConfig) -> list[Trial]:
    """List the trials of a study, world by world."""
    return [
        Trial(strategy, index)
        for index in range(config.num_trials)
        for strategy in config.strategies
    ]


def run_trial(config: StudyConfig, trial: Trial) -> list[dict[str, Any]]:
    """Learn in one world with one strategy.

    Returns:
        A row for each number of queries; only seconds depend on the machine.
    """
    return list(islice(_rounds(config, trial), config.num_queries + 1))


def _rounds(config: StudyConfig, trial: Trial) -> Iterator[dict[str, Any]]:
    seeds = np.random.SeedSequence(config.seed, spawn_key=(trial.index,))
    world_rng, teacher_rng, loop_rng = map(np.random.default_rng, seeds.spawn(3))
    method = method_of(config, trial.strategy)
    mdp, true_weights = make_world(config, rng=world_rng)
    problem = MdpProblem(mdp, true_weights, mdp_config(config), method.propose)
    first = problem.demonstrate_first(_NUM_SHOWN, rng=teacher_rng)
    rounds = run_active(problem, [first], method.score, RiskConfig(), rng=loop_rng)
    for num_queries, latest in enumerate(rounds):
        losses = problem.policy_losses(latest.posterior)
        row = {
            "world": config.name,
            "strategy": trial.strategy,
            "trial": trial.index,
            "num_queries": num_queries,
            "policy_loss": float(losses.mean()),
            "max_policy_loss": float(losses.max()),
            "var": latest.var_bound,
            "query": latest.query.start,
            "query_seconds": latest.query_seconds,
            "inference_seconds": latest.inference_seconds,
        }
        yield {
            name: round(value, _DIGITS) + 0.0 if isinstance(value, float) else value
            for name, value in row.items()
        }


def make_world(config: StudyConfig, *, rng: np.random.Generator) -> tuple[Mdp, Array]:
    """Draw the world of a trial, and what is wanted there."""
    size, num_features = getattr(config, "size", 8), getattr(config, "num_features", 48)
    return random_world(size, num_features, rng=rng)


def method_of(config: StudyConfig, strategy: str) -> Method:
    """Return how a strategy asks in a study."""
    methods = CRITIQUE_METHODS if config.name == "critique-queries" else ACTION_METHODS
    return methods[strategy]


def mdp_config(config: StudyConfig) -> MdpConfig:
    """Return how a reward is learned under a preset."""
    if config.preset == "paper":
        return MdpConfig(CoordinateChain())
    return MdpConfig(McmcConfig())


def load_kernels() -> None:
    """Compile what is not compiled yet, or load it."""
    mdp, true_weights = random_world(2, 2, rng=np.random.default_rng(0))
    for chain in (CoordinateChain(num_samples=2), McmcConfig(num_steps=1500)):
        problem = MdpProblem(mdp, true_weights, MdpConfig(chain))
        first = problem.demonstrate_first(1, rng=np.random.default_rng(0))
        problem.infer([first], None, rng=np.random.default_rng(0))
