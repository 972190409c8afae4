"""The paper's table experiment: every strategy learns the same trials of each task."""

from dataclasses import dataclass
from itertools import islice

import numpy as np

from tablesetting.experiments.config import StrategyName, TaskName
from tablesetting.experiments.rows import learning_cells, rounded, seconds_cells
from tablesetting.experiments.setup import RunSetup
from tablesetting.experiments.study_config import PlacementStudyConfig
from tablesetting.irl.active import STRATEGIES, Round, run_active
from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import value_at_risk
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.tasks import TASKS


@dataclass(frozen=True)
class Trial:
    """A repetition of one task.

    Attributes:
        task: The task.
        index: Which repetition, from 0.
    """

    task: TaskName
    index: int

    def seeds(self, seed: int) -> np.random.SeedSequence:
        """Return the source of its randomness, whatever else the study does."""
        return np.random.SeedSequence(
            seed, spawn_key=(list(TASKS).index(self.task), self.index)
        )


def all_trials(config: PlacementStudyConfig) -> list[Trial]:
    """List the trials of a study, those of other shards as well, task by task."""
    return [
        Trial(task, index)
        for task in config.tasks
        for index in range(config.num_trials)
    ]


def shard_trials(config: PlacementStudyConfig) -> list[Trial]:
    """List the trials of the study's own shard."""
    index, num_shards = config.shard_of
    return all_trials(config)[index::num_shards]


def columns(config: PlacementStudyConfig) -> list[str]:
    """List the columns of rounds.csv."""
    test_bound = ("test_var_bound", "test_bound_held") if config.test_bound else ()
    return [
        *("task", "strategy", "trial", "num_demos"),
        *("mean_placement_error", "max_placement_error", "var_bound"),
        *("ess", "rhat", "acceptance_rate", "bound_held", *test_bound),
        *("inference_seconds", "query_seconds"),
    ]


def run_trial(config: PlacementStudyConfig, trial: Trial) -> list[dict[str, object]]:
    """Let every strategy learn from the same start, tested in the same layouts.

    Args:
        config: The study.
        trial: Which trial.

    Returns:
        Rows of rounds.csv: for each strategy one for each number of demonstrations.
    """
    return [
        row for strategy in config.strategies for row in _learn(config, trial, strategy)
    ]


def _learn(
    config: PlacementStudyConfig, trial: Trial, strategy: StrategyName
) -> list[dict[str, object]]:
    run_config = config.run_config(trial.task, strategy)
    setup = RunSetup.of_config(run_config, trial.seeds(config.seed))
    problem = setup.problem
    rounds = run_active(
        problem,
        [problem.demonstrate(setup.first_layout)],
        STRATEGIES[strategy],
        problem.config.risk,
        rng=setup.rng,
    )
    return [
        _row(config, trial, strategy, setup, latest)
        for latest in islice(rounds, config.num_queries + 1)
    ]


def _row(
    config: PlacementStudyConfig,
    trial: Trial,
    strategy: StrategyName,
    setup: RunSetup,
    latest: Round[Array, Demonstration],
) -> dict[str, object]:
    """Return the row of rounds.csv; a bound has held if no test error is above it."""
    errors = setup.validation.placement_errors(latest.posterior.map_weights)
    row: dict[str, object] = {
        "task": trial.task,
        "strategy": strategy,
        "trial": trial.index,
        **learning_cells(latest, errors),
        "bound_held": int(latest.var_bound >= errors.max()),
    }
    if config.test_bound:
        bound = _test_bound(setup, latest.posterior)
        row["test_var_bound"] = bound
        row["test_bound_held"] = int(bound >= errors.max())
    return rounded(row | seconds_cells(latest))


def _test_bound(setup: RunSetup, posterior: Posterior) -> float:
    """Return the largest value at risk over the test layouts."""
    risk = setup.problem.config.risk
    losses = setup.problem.policy_losses(list(setup.validation.layouts), posterior)
    var = value_at_risk(losses, risk.alpha, rank_offset=risk.rank_offset)
    return float(var.max())
