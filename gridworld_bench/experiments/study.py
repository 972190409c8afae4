"""A study in a folder: its trials, done by several processes, and what they found."""

import contextlib
import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gridworld_bench.experiments.config import StudyConfig
from gridworld_bench.experiments.trials import Trial, all_trials, run_trial
from tablesetting.errors import InvalidFile
from tablesetting.opening import open_folder
from tablesetting.options import to_options
from tablesetting.results import (
    CONFIG_FORMAT,
    ROUNDS,
    SUMMARY,
    RunFolder,
    package_versions,
    read_rows,
)
from tablesetting.workers import map_unordered

_OF_ONE_CALL = ("jobs", "out", "resume", "overwrite")
_TEXTS = ("world", "strategy")
_WHOLE_NUMBERS = ("trial", "num_queries", "query")
_MAYBE_EMPTY = ("normalized_var", "normalized_loss", "agreement")


class Study:
    """Rows of finished trials.

    Attributes:
        config: The options.
        folder: Where they are kept.
        rows: The rows of each finished trial.
    """

    def __init__(self, config: StudyConfig, folder: RunFolder):
        self.config = config
        self.folder = folder
        self.rows: dict[Trial, Sequence[Mapping[str, Any]]] = {}

    @classmethod
    @contextlib.contextmanager
    def open(cls, config: StudyConfig, out: Path) -> Iterator["Study"]:
        """Start a study in a folder, or go on there.

        Raises:
            InvalidFile: If what is there is another study.
            OutputError: If the folder is taken, or cannot be written.
        """
        opened = open_folder(
            out, settings(config), resume=config.resume, overwrite=config.overwrite
        )
        with opened as folder:
            study = cls(config, folder)
            study._read()
            yield study

    @property
    def unfinished(self) -> list[Trial]:
        """Trials that are still to be done."""
        return [trial for trial in all_trials(self.config) if trial not in self.rows]

    @property
    def ordered_rows(self) -> list[Mapping[str, Any]]:
        """All rows, trial by trial."""
        trials = [trial for trial in all_trials(self.config) if trial in self.rows]
        return [row for trial in trials for row in self.rows[trial]]

    def run(self, num_jobs: int) -> Generator[Trial, None, None]:
        """Do what is not done yet; each trial is on the disk before it is yielded."""
        work = partial(run_trial, self.config)
        for trial, rows in map_unordered(work, self.unfinished, num_jobs=num_jobs):
            self.folder.append_rows(rows)
            self.rows[trial] = rows
            yield trial

    def write_summary(self, strategies: Mapping[Any, Any], **settings: object) -> None:
        """Write what was found of each strategy, with the settings that it depends on."""
        names = ("num_trials", "num_queries", "preset", "seed")
        self.folder.write_json(
            SUMMARY,
            {
                "world": self.config.name,
                **{name: getattr(self.config, name) for name in names},
                **settings,
                "strategies": strategies,
            },
        )

    def _read(self) -> None:
        """Read the trials that are all there; what a kill cut short is removed."""
        path = self.folder.path / ROUNDS
        if not path.exists():
            return
        rows, groups = read_rows(path), dict[Trial, list[Mapping[str, Any]]]()
        columns = self.config.columns
        if rows and tuple(rows[0]) != columns:
            raise InvalidFile(
                f"'{path}' has other columns than {', '.join(columns)}; mend it or "
                "remove it"
            )
        if not path.read_bytes().endswith(b"\n"):
            rows = rows[:-1]
        for row in rows:
            if _is_whole(row, columns):
                trial = Trial(row["strategy"], int(row["trial"]))
                groups.setdefault(trial, []).append(row)
        wanted = [str(count) for count in range(self.config.num_queries + 1)]
        self.rows = {
            trial: groups[trial]
            for trial in all_trials(self.config)
            if [row["num_queries"] for row in groups.get(trial, [])] == wanted
        }
        self.folder.write_rows(self.ordered_rows)


def settings(config: StudyConfig) -> dict[str, Any]:
    """Return the content of config.json, as it will be read back."""
    return {
        "format": CONFIG_FORMAT,
        "command": config.name,
        "options": to_options(config, _OF_ONE_CALL),
        "resolved": {},
        "versions": package_versions(),
    }


def _is_whole(row: Mapping[str, Any], columns: Sequence[str]) -> bool:
    """Tell whether a row has all its cells, and numbers in them."""
    try:
        return (
            tuple(row) == tuple(columns)
            and all(row[name].isdecimal() for name in _WHOLE_NUMBERS)
            and all(
                math.isfinite(float(cell))
                for name, cell in row.items()
                if name not in _TEXTS and (cell or name not in _MAYBE_EMPTY)
            )
        )
    except (AttributeError, TypeError, ValueError):
        return False
