"""The paper's table experiment: every strategy learns the same trials of each task."""

from itertools import islice

from tablesetting.experiments.learning import LearningRound, learn
from tablesetting.experiments.rows import learning_cells, rounded, seconds_cells
from tablesetting.experiments.setup import RunSetup
from tablesetting.experiments.study_config import PlacementStudyConfig
from tablesetting.experiments.trials import Trial
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import value_at_risk


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
        row for strategy in config.compared for row in _learn(config, trial, strategy)
    ]


def _learn(
    config: PlacementStudyConfig, trial: Trial, strategy: str
) -> list[dict[str, object]]:
    run_config = config.run_config(trial.task, strategy)
    setup = RunSetup.of_config(run_config, trial.seeds(config.seed))
    rounds = learn(setup, strategy)
    return [
        _row(config, trial, strategy, setup, latest)
        for latest in islice(rounds, config.num_queries + 1)
    ]


def _row(
    config: PlacementStudyConfig,
    trial: Trial,
    strategy: str,
    setup: RunSetup,
    latest: LearningRound,
) -> dict[str, object]:
    """Return the row of rounds.csv; a bound has held if no test error is above it."""
    learning, worst = latest.learning, float(latest.errors.max())
    row: dict[str, object] = {
        "task": trial.task,
        "strategy": strategy,
        "trial": trial.index,
        **learning_cells(latest),
        "bound_held": int(learning.var_bound >= worst),
    }
    if config.test_bound:
        bound = _test_bound(setup, learning.posterior)
        row["test_var_bound"] = bound
        row["test_bound_held"] = int(bound >= worst)
    return rounded(row | seconds_cells(learning))


def _test_bound(setup: RunSetup, posterior: Posterior) -> float:
    """Return the largest value at risk over the test layouts."""
    risk = setup.problem.config.risk
    losses = setup.problem.policy_losses(list(setup.validation.layouts), posterior)
    var = value_at_risk(losses, risk.alpha, rank_offset=risk.rank_offset)
    return float(var.max())
