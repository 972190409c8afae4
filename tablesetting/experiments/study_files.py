"""The folder of a study: settings, a table that survives a kill, results at the end."""

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tablesetting.errors import InvalidFile
from tablesetting.experiments.studies import columns
from tablesetting.experiments.study_config import TrialsConfig
from tablesetting.experiments.study_settings import describe, read_settings
from tablesetting.experiments.trials import Trial, all_trials, shard_trials
from tablesetting.opening import first_difference, open_folder
from tablesetting.results import (
    CONFIG,
    ROUNDS,
    Row,
    RunFolder,
    read_rows,
)


class StudyFolder:
    """A study on the disk.

    Attributes:
        folder: The folder.
        config: The settings.
        rows: The rows of each finished trial.
    """

    def __init__(
        self,
        folder: RunFolder,
        config: TrialsConfig,
        rows: dict[Trial, Sequence[Mapping[str, Any]]],
    ):
        self.folder = folder
        self.config = config
        self.rows = rows

    @classmethod
    @contextlib.contextmanager
    def open(cls, config: TrialsConfig, path: Path) -> Iterator["StudyFolder"]:
        """Start a study in a folder, or go on with the one that is there.

        Raises:
            OutputError: If something else is there, or it cannot be written.
            InvalidFile: If the study there is of other settings or cannot be read.
        """
        opened = open_folder(
            path, describe(config), resume=config.resume, overwrite=config.overwrite
        )
        with opened as folder:
            study = cls(folder, config, _read_trials(config, path))
            if config.resume:
                study.write_rows()  # But for what a kill cut short.
            yield study

    @classmethod
    @contextlib.contextmanager
    def merge(cls, config: TrialsConfig, path: Path) -> Iterator["StudyFolder"]:
        """Put shards together in a new folder.

        Args:
            config: Names the shards' folders.
            path: The new folder.

        Raises:
            InvalidFile: If the shards are not all there, or not of one study.
            OutputError: If the folder is taken or cannot be written.
        """
        merged, rows = _read_shards(config.merge or ())
        if merged.name != config.name:
            raise InvalidFile(
                f"'{(config.merge or ())[0]}' is of a study {merged.name}; merge it with "
                f"`study {merged.name}`"
            )
        missing = [trial for trial in all_trials(merged) if trial not in rows]
        if missing:
            raise InvalidFile(
                f"trials are in none of the folders, {len(missing)} of them, such as "
                f"{missing[0].task} {missing[0].index}; finish all shards, with "
                "--resume where they were cut short, and name them all"
            )
        folder = RunFolder.make(path)
        with folder.locked():
            settings = describe(merged)
            folder.clear(overwrite=config.overwrite, command=settings["command"])
            folder.write_json(CONFIG, settings)
            yield cls(folder, merged, rows)

    @property
    def num_trials(self) -> int:
        """How many trials are to be done in all."""
        return len(shard_trials(self.config))

    @property
    def unfinished(self) -> list[Trial]:
        """The trials that are still to be done."""
        return [trial for trial in shard_trials(self.config) if trial not in self.rows]

    def add(self, trial: Trial, rows: Sequence[Mapping[str, Any]]) -> None:
        """Keep a finished trial."""
        self.folder.append_rows(rows)
        self.rows[trial] = rows

    def write_rows(self) -> None:
        """Write the table anew, its trials in order."""
        trials = [trial for trial in all_trials(self.config) if trial in self.rows]
        self.folder.write_rows([row for trial in trials for row in self.rows[trial]])


def _read_trials(
    config: TrialsConfig, path: Path
) -> dict[Trial, Sequence[Mapping[str, Any]]]:
    """Read the rows of every trial that is all there."""
    table = path / ROUNDS
    if not table.exists():
        return {}
    rows = read_rows(table)
    text, header = table.read_text(encoding="utf-8"), ",".join(columns(config))
    if text.splitlines()[:1] != [header]:
        if header.startswith(text):  # Cut short by a kill.
            return {}
        raise InvalidFile(
            f"'{table}' does not begin with the columns {header}; mend it or remove it"
        )
    if rows and not text.endswith("\n"):
        rows.pop()  # Cut short by a kill, maybe within its last cell.
    found: dict[tuple[str | None, str | None], list[Row]] = {}
    for row in rows:
        found.setdefault((row.get("task"), row.get("trial")), []).append(row)
    trials = {
        trial: found.get((trial.task, str(trial.index)), [])
        for trial in shard_trials(config)
    }
    return {
        trial: own
        for trial, own in trials.items()
        if _is_complete(own, config, config.row_keys(trial.task))
    }


def _is_complete(
    rows: Sequence[Row], config: TrialsConfig, keys: Sequence[Mapping[str, str]]
) -> bool:
    """Tell whether these are the rows of one whole trial."""
    if len(rows) != len(keys):
        return False
    return all(
        all(row.get(name) == cell for name, cell in key.items())
        and _is_numeric(row, config)
        for row, key in zip(rows, keys, strict=True)
    )


def _is_numeric(row: Row, config: TrialsConfig) -> bool:
    """Tell whether every cell but the names is a number; some may be infinite."""
    names = ("task", config.column, *config.texts)
    try:
        values = {
            column: float(cell)
            for column, cell in row.items()
            if column not in names and (cell or not config.may_be_empty(column, row))
        }
    except (TypeError, ValueError):  # Cells are missing, or there are too many.
        return False
    return all(
        math.isfinite(value) or column in ("rhat", "bound")
        for column, value in values.items()
    )


def _read_shards(
    paths: Sequence[Path],
) -> tuple[TrialsConfig, dict[Trial, Sequence[Mapping[str, Any]]]]:
    """Read shards of one study; return its settings and all rows."""
    merged = replace(read_settings(paths[0])[0], shard=None)
    rows: dict[Trial, Sequence[Mapping[str, Any]]] = {}
    for path in paths:
        shard, content = read_settings(path)
        content["options"]["shard"] = None
        if difference := first_difference(content, describe(merged)):
            raise InvalidFile(
                f"'{path}' holds a study with {difference}, as '{paths[0]}' has it; "
                "name the shards of one study"
            )
        for trial, own in _read_trials(shard, path).items():
            if trial in rows:
                raise InvalidFile(
                    f"'{path}' holds {trial.task} {trial.index}, which another folder "
                    "holds as well; name each shard once"
                )
            rows[trial] = own
    return merged, rows
