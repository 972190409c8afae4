"""The folder of a study: settings, a table that survives a kill, results at the end."""

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from tablesetting.errors import InvalidFile
from tablesetting.experiments.placement_study import Trial, all_trials, shard_trials
from tablesetting.experiments.study_config import PlacementStudyConfig
from tablesetting.irl.active import STRATEGIES
from tablesetting.results import (
    CONFIG,
    CONFIG_FORMAT,
    ROUNDS,
    Row,
    RunFolder,
    package_versions,
    read_json,
    read_rows,
)
from tablesetting.reward.problem import PRESETS
from tablesetting.reward.tasks import TASKS

_COMMAND = "study placement"
# What may differ between the start of a study and its going on.
_OF_ONE_CALL = ("jobs", "out", "resume", "overwrite", "merge")


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
        config: PlacementStudyConfig,
        rows: dict[Trial, Sequence[Mapping[str, Any]]],
    ):
        self.folder = folder
        self.config = config
        self.rows = rows

    @classmethod
    @contextlib.contextmanager
    def open(cls, config: PlacementStudyConfig, path: Path) -> Iterator["StudyFolder"]:
        """Start a study in a folder, or go on with the one that is there.

        Raises:
            OutputError: If something else is there, or it cannot be written.
            InvalidFile: If the study there is of other settings or cannot be read.
        """
        is_there = config.resume and (path / CONFIG).exists()
        if is_there:
            found = read_json(path / CONFIG, CONFIG_FORMAT)
            _refuse_others(found, _describe(config), path)
            folder = RunFolder(path)
        else:
            folder = RunFolder.create(path, overwrite=config.overwrite)
            folder.write_json(CONFIG, _describe(config))
        with folder.locked():
            study = cls(folder, config, _read_trials(config, path))
            if is_there:  # What a kill cut short goes.
                study.write_rows()
            yield study

    @classmethod
    @contextlib.contextmanager
    def merge(cls, config: PlacementStudyConfig, path: Path) -> Iterator["StudyFolder"]:
        """Put shards together in a new folder.

        Args:
            config: Names the shards' folders.
            path: The new folder.

        Raises:
            InvalidFile: If the shards are not all there, or not of one study.
            OutputError: If the folder is taken or cannot be written.
        """
        merged, rows = _read_shards(config.merge)
        missing = [trial for trial in all_trials(merged) if trial not in rows]
        if missing:
            raise InvalidFile(
                f"trials are in none of the folders, {len(missing)} of them, such as "
                f"{missing[0].task} {missing[0].index}; finish all shards, with "
                "--resume where they were cut short, and name them all"
            )
        folder = RunFolder.create(path, overwrite=config.overwrite)
        folder.write_json(CONFIG, _describe(merged))
        with folder.locked():
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


def _describe(config: PlacementStudyConfig) -> dict[str, Any]:
    """Return the content of config.json, as it is read back."""
    options = {
        name: value
        for name, value in asdict(config).items()
        if name not in _OF_ONE_CALL
    }
    content = {
        "format": CONFIG_FORMAT,
        "command": _COMMAND,
        "options": options,
        "resolved": {"problem": asdict(PRESETS[config.preset])},
        "versions": package_versions(),
    }
    return json.loads(json.dumps(content))


def _refuse_others(
    found: Mapping[str, Any], expected: Mapping[str, Any], path: Path
) -> None:
    """Refuse to mix the rows of two studies."""
    for part in ("command", "options", "resolved", "versions"):
        if found.get(part) == expected[part]:
            continue
        name, there, here = part, found.get(part), expected[part]
        if isinstance(there, dict) and isinstance(here, dict):
            name = next(key for key in here | there if here.get(key) != there.get(key))
            there, here = there.get(name), here.get(name)
        raise InvalidFile(
            f"'{path}' holds a study with {name} = {there!r:.80}, not {here!r:.80}; "
            "its rows are not mixed with others: choose another --out"
        )


def _read_trials(
    config: PlacementStudyConfig, path: Path
) -> dict[Trial, Sequence[Mapping[str, Any]]]:
    """Read the rows of every trial that is all there."""
    table = path / ROUNDS
    if not table.exists():
        return {}
    rows = read_rows(table)
    if rows and not table.read_bytes().endswith(b"\n"):
        rows.pop()  # Cut short by a kill, maybe within its last cell.
    found: dict[tuple[str | None, str | None], list[Row]] = {}
    for row in rows:
        found.setdefault((row.get("task"), row.get("trial")), []).append(row)
    trials = {
        trial: found.get((trial.task, str(trial.index)), [])
        for trial in shard_trials(config)
    }
    return {trial: own for trial, own in trials.items() if _is_complete(own, config)}


def _is_complete(rows: Sequence[Row], config: PlacementStudyConfig) -> bool:
    """Tell whether these are the rows of one whole trial."""
    expected = [
        (strategy, str(num_demos))
        for strategy in config.strategies
        for num_demos in range(1, config.num_queries + 2)
    ]
    return [(row.get("strategy"), row.get("num_demos")) for row in rows] == expected


def _read_shards(
    paths: Sequence[Path],
) -> tuple[PlacementStudyConfig, dict[Trial, Sequence[Mapping[str, Any]]]]:
    """Read shards of one study; return its settings and all rows."""
    merged: PlacementStudyConfig | None = None
    rows: dict[Trial, Sequence[Mapping[str, Any]]] = {}
    for path in paths:
        content = read_json(path / CONFIG, CONFIG_FORMAT)
        shard = _parse_config(content, path)
        whole = replace(shard, shard=None)
        merged = merged or whole
        _refuse_others(
            content | {"options": content["options"] | {"shard": None}},
            _describe(merged),
            path,
        )
        for trial, own in _read_trials(shard, path).items():
            if trial in rows:
                raise InvalidFile(
                    f"'{path}' holds {trial.task} {trial.index}, which another folder "
                    "holds as well; name each shard once"
                )
            rows[trial] = own
    assert merged is not None  # The command line takes no empty list for --merge.
    return merged, rows


def _parse_config(content: Mapping[str, Any], path: Path) -> PlacementStudyConfig:
    """Turn the content of a shard's config.json back into settings."""
    try:
        options: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in content["options"].items()
        }
        config = PlacementStudyConfig(**options)
        for names, known in (
            (config.tasks, TASKS),
            (config.strategies, STRATEGIES),
            ((config.preset,), PRESETS),
        ):
            if unknown := set(names) - set(known):
                raise ValueError(f"{unknown.pop()!r} is unknown")
        return config
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidFile(
            f"'{path / CONFIG}' is not of a placement study: {error}; name the folders "
            "that the shards were written to"
        ) from error
