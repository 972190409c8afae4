"""How often the bound holds, for people of every kind whose preference is drawn anew."""

from itertools import islice

import numpy as np

from tablesetting.experiments.learning import LearningRound, learn
from tablesetting.experiments.rows import rounded
from tablesetting.experiments.setup import RunSetup
from tablesetting.experiments.study_config import CalibrationStudyConfig
from tablesetting.experiments.trials import Trial
from tablesetting.irl.risk import var_upper_bound

_COLUMNS = (
    *("task", "teacher", "trial", "num_demos"),
    *("mean_placement_error", "max_placement_error", "bound"),
    *("one_covered", "share_covered", "all_covered"),
    *("fit", "explained", "ess", "kept_ess", "rhat", "has_mixed", "inference_seconds"),
)


def columns(config: CalibrationStudyConfig) -> list[str]:
    """List the columns of rounds.csv."""
    return list(_COLUMNS)


def run_trial(config: CalibrationStudyConfig, trial: Trial) -> list[dict[str, object]]:
    """Let people of every kind, who want the same, teach the robot.

    Args:
        config: The study.
        trial: Which trial.

    Returns:
        Rows of rounds.csv: for each kind one for each number of demonstrations.
    """
    return [
        row for teacher in config.teachers for row in _learn(config, trial, teacher)
    ]


def _learn(
    config: CalibrationStudyConfig, trial: Trial, teacher: str
) -> list[dict[str, object]]:
    setup = RunSetup.of_config(
        config.run_config(trial.task, teacher), trial.seeds(config.seed)
    )
    rounds = islice(learn(setup, "random"), config.num_queries + 1)
    key = {"task": trial.task, "teacher": teacher, "trial": trial.index}
    return [rounded(key | _cells(setup, latest)) for latest in rounds]


def _cells(setup: RunSetup, latest: LearningRound) -> dict[str, object]:
    """Compare what was lost in the test layouts with what was promised there.

    The confidence bound on the VaR is that of a run at this look. In a test layout it
    is covered if the error is not above the layout's own bound; in all of them, if the
    largest error is not above the largest bound, which is what a run goes by.
    """
    learning, posterior = latest.learning, latest.learning.posterior
    losses = setup.problem.policy_losses(list(setup.validation.layouts), posterior)
    alpha, delta = latest.bound.alpha, latest.bound.delta
    bounds = var_upper_bound(losses, alpha, delta, ess=posterior.kept_ess)
    is_covered = latest.errors <= bounds
    return {
        "num_demos": latest.num_demos,
        "mean_placement_error": float(latest.errors.mean()),
        "max_placement_error": float(latest.errors.max()),
        "bound": float(bounds.max()),
        "one_covered": int(is_covered[0]),  # Layouts of one trial are not independent.
        "share_covered": float(np.mean(is_covered)),
        "all_covered": int(latest.errors.max() <= bounds.max()),
        "fit": latest.fit.p_value,
        "explained": latest.fit.explained,
        "ess": posterior.ess,
        "kept_ess": posterior.kept_ess,
        "rhat": posterior.rhat,
        "has_mixed": int(posterior.is_sound),
        "inference_seconds": learning.inference_seconds,
    }
