"""The studies there are: each a module that tells its columns and carries out a trial.

A study is imported when it is asked for: only one of them needs the simulator, for which
the processes of the others do not wait.
"""

from collections.abc import Sequence
from importlib import import_module
from typing import Protocol, cast

from tablesetting.experiments.study_config import TrialsConfig
from tablesetting.experiments.trials import Trial


class _Study(Protocol):
    """What the module of a study has."""

    def columns(self, config: TrialsConfig) -> list[str]: ...

    def run_trial(
        self, config: TrialsConfig, trial: Trial
    ) -> Sequence[dict[str, object]]: ...


def columns(config: TrialsConfig) -> list[str]:
    """List the columns of a study's rounds.csv."""
    return _study(config).columns(config)


def run_trial(config: TrialsConfig, trial: Trial) -> Sequence[dict[str, object]]:
    """Carry out one trial of a study; return its rows."""
    return _study(config).run_trial(config, trial)


def _study(config: TrialsConfig) -> _Study:
    module = import_module(f"tablesetting.experiments.{config.name}_study")
    return cast(_Study, module)
