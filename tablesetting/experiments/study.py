"""Carry out a study, in this process or in several."""

from collections.abc import Generator
from functools import partial
from typing import cast

from tablesetting.experiments import (
    calibration_results,
    execution_results,
    study_results,
)
from tablesetting.experiments.calibration_results import CALIBRATION, write_calibration
from tablesetting.experiments.execution_results import EXECUTIONS, write_executions
from tablesetting.experiments.studies import run_trial
from tablesetting.experiments.study_config import (
    CalibrationStudyConfig,
    ExecutionStudyConfig,
    PlacementStudyConfig,
)
from tablesetting.experiments.study_files import StudyFolder
from tablesetting.experiments.study_results import COMPARISON, write_results
from tablesetting.experiments.trials import Trial
from tablesetting.results import ROUNDS, read_rows
from tablesetting.workers import map_unordered


def run_study(study: StudyFolder, num_jobs: int) -> Generator[Trial, None, None]:
    """Do the trials that are not finished yet.

    Each is on the disk before it is yielded; the caller may stop at any time.

    Args:
        study: Where the rows go.
        num_jobs: Processes; the rows do not depend on it.

    Yields:
        Every trial when it is done.

    Raises:
        WorkerDied: If a trial cannot be done, because its processes die.
    """
    work = partial(run_trial, study.config)
    for trial, rows in map_unordered(work, study.unfinished, num_jobs=num_jobs):
        study.add(trial, rows)
        yield trial


def finish_study(study: StudyFolder) -> list[str]:
    """Write what a complete study found; return it in words, line by line."""
    study.write_rows()
    rows = read_rows(study.folder.path / ROUNDS)
    if isinstance(study.config, CalibrationStudyConfig):
        lines = write_calibration(study.folder, study.config, rows)
        files = (CALIBRATION, calibration_results.FIGURE)
    elif isinstance(study.config, ExecutionStudyConfig):
        lines = write_executions(study.folder, study.config, rows)
        files = (EXECUTIONS, execution_results.FIGURE)
    else:
        config = cast(PlacementStudyConfig, study.config)
        lines = write_results(study.folder, config, rows)
        files = (COMPARISON, study_results.FIGURE)
    names = ("table", "figure")
    named = zip(names, files, strict=True)
    return [*lines, *(f"{kind}: {study.folder.path / name}" for kind, name in named)]
