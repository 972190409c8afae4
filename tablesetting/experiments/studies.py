"""The studies there are: what a trial of each gives, and what is made of all trials."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from tablesetting.experiments import calibration_study, placement_study
from tablesetting.experiments.study_config import TrialsConfig
from tablesetting.experiments.trials import Trial


@dataclass(frozen=True)
class Study:
    """One kind of study.

    Attributes:
        columns: Lists the columns of rounds.csv.
        run_trial: Carries out a trial; returns its rows.
    """

    columns: Callable[[Any], list[str]]
    run_trial: Callable[[Any, Trial], Sequence[dict[str, object]]]


_STUDIES = {
    "placement": Study(placement_study.columns, placement_study.run_trial),
    "calibration": Study(calibration_study.columns, calibration_study.run_trial),
}


def columns(config: TrialsConfig) -> list[str]:
    """List the columns of a study's rounds.csv."""
    return _STUDIES[config.name].columns(config)


def run_trial(config: TrialsConfig, trial: Trial) -> Sequence[dict[str, object]]:
    """Carry out one trial of a study; return its rows."""
    return _STUDIES[config.name].run_trial(config, trial)
