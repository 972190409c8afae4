"""The settings of a study as config.json holds them."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, get_args

from tablesetting.errors import InvalidFile
from tablesetting.experiments.config import (
    LearningConfig,
    LikelihoodName,
    PresetName,
    StrategyName,
    TaskName,
    TeacherName,
)
from tablesetting.experiments.setup import problem_settings
from tablesetting.experiments.study_config import (
    STUDIES,
    PlacementStudyConfig,
    TrialsConfig,
)
from tablesetting.results import CONFIG, CONFIG_FORMAT, package_versions, read_json

_LEARNING = tuple(field.name for field in fields(LearningConfig))
# What may differ between the start of a study and its going on.
_OF_ONE_CALL = ("jobs", "out", "resume", "overwrite", "merge")


def describe(config: TrialsConfig) -> dict[str, Any]:
    """Return the content of config.json, as it will be read back."""
    options = asdict(config)
    options |= options.pop("learning", {})
    for name in _OF_ONE_CALL:
        del options[name]
    problems = {
        name: asdict(problem_settings(config.run_config(config.tasks[0], name)))
        for name in config.compared
    }
    first = problems[config.compared[0]]
    is_same = all(problem == first for problem in problems.values())
    content = {
        "format": CONFIG_FORMAT,
        "command": f"study {config.name}",
        "options": options,
        "resolved": {"problem": first if is_same else problems},
        "versions": package_versions(),
    }
    return json.loads(json.dumps(content))


def first_difference(found: Mapping[str, Any], expected: Mapping[str, Any]) -> str:
    """Say in which setting two descriptions differ; empty if in none.

    Rows of different settings, or of different releases, are not mixed.
    """
    for part in ("command", "options", "resolved", "versions"):
        there, here = found.get(part), expected[part]
        if there == here:
            continue
        if not isinstance(there, dict) or not isinstance(here, dict):
            return f"{part} = {there!r:.80}, not {here!r:.80}"
        name = next(
            key
            for key in here | there
            if (key in here, here.get(key)) != (key in there, there.get(key))
        )
        return f"{name} = {there.get(name)!r:.80}, not {here.get(name)!r:.80}"
    return ""


def read_settings(folder: Path) -> tuple[TrialsConfig, dict[str, Any]]:
    """Read the settings of a study; return them parsed and as they stand.

    Raises:
        InvalidFile: If there is no study there.
    """
    content = read_json(folder / CONFIG, CONFIG_FORMAT)
    try:
        command, _, name = str(content["command"]).partition(" ")
        if command != "study" or name not in STUDIES:
            raise ValueError(f"its command is {content['command']!r:.80}")
        config = _parse(STUDIES[name], content["options"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidFile(
            f"'{folder / CONFIG}' is not of a study: {error}; name the folders that the "
            "shards were written to"
        ) from error
    return config, content


def _parse(study: type[TrialsConfig], found: Mapping[str, Any]) -> TrialsConfig:
    """Build the settings of a study from options, which may be anything."""
    options: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in found.items()
    }
    if issubclass(study, PlacementStudyConfig):
        learning = {name: options.pop(name) for name in _LEARNING}
        options["learning"] = LearningConfig(**learning)
    config = study(**options)
    for name in ("num_trials", "num_queries", "seed"):
        if type(options[name]) is not int:
            raise ValueError(f"{name} must be a whole number")
    for names, known in _choices(config):
        if unknown := set(names) - set(known):
            raise ValueError(f"{unknown.pop()!r} is unknown")
    return config


def _choices(config: TrialsConfig) -> Iterator[tuple[tuple[Any, ...], tuple[Any, ...]]]:
    """Yield names that were chosen, and those that there are."""
    yield config.tasks, get_args(TaskName)
    is_calibration = config.column == "teacher"
    yield config.compared, get_args(TeacherName if is_calibration else StrategyName)
    if isinstance(config, PlacementStudyConfig):
        learning = config.learning
        yield (config.preset,), get_args(PresetName)
        yield (learning.likelihood,), (None, *get_args(LikelihoodName))
        yield (learning.guess,), (None, "map", "mean")
        yield (learning.teacher,), get_args(TeacherName)
        yield (learning.truth,), ("task", "prior")
