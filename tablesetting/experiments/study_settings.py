"""The settings of a study as config.json holds them."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, get_args

from tablesetting.errors import InvalidFile
from tablesetting.experiments.config import (
    ArmConfig,
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
    ExecutionStudyConfig,
    GoalName,
    LearningStudyConfig,
    PlacementStudyConfig,
    TrialsConfig,
)
from tablesetting.results import CONFIG, CONFIG_FORMAT, package_versions, read_json

_GROUPS = {"learning": LearningConfig, "arm": ArmConfig}
"""Options that stand flat in the file, by the field that holds them."""
_COMPARED = {"strategy": StrategyName, "teacher": TeacherName, "goal": GoalName}
"""What the values in a column can be."""
# What may differ between the start of a study and its going on.
_OF_ONE_CALL = ("jobs", "out", "resume", "overwrite", "merge")


def describe(config: TrialsConfig) -> dict[str, Any]:
    """Return the content of config.json, as it will be read back."""
    options = asdict(config)
    for group in _GROUPS:
        options |= options.pop(group, {})
    for name in _OF_ONE_CALL:
        del options[name]
    content = {
        "format": CONFIG_FORMAT,
        "command": f"study {config.name}",
        "options": options,
        "resolved": _resolve(config),
        "versions": package_versions(),
    }
    return json.loads(json.dumps(content))


def _resolve(config: TrialsConfig) -> dict[str, Any]:
    """Return what the options of a study of learning come to."""
    if not isinstance(config, LearningStudyConfig):
        return {}
    problems = {
        name: asdict(problem_settings(config.run_config(config.tasks[0], name)))
        for name in config.compared
    }
    first = problems[config.compared[0]]
    is_same = all(problem == first for problem in problems.values())
    return {"problem": first if is_same else problems}


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
    for group, kind in _GROUPS.items():
        if group in {field.name for field in fields(study)}:
            own = {field.name: options.pop(field.name) for field in fields(kind)}
            options[group] = kind(**own)
    config = study(**options)
    for name in ("num_trials", "num_queries", "seed"):
        if name in options and type(options[name]) is not int:
            raise ValueError(f"{name} must be a whole number")
    for names, known in _choices(config):
        if unknown := set(names) - set(known):
            raise ValueError(f"{unknown.pop()!r} is unknown")
    return config


def _choices(config: TrialsConfig) -> Iterator[tuple[tuple[Any, ...], tuple[Any, ...]]]:
    """Yield names that were chosen, and those that there are."""
    yield config.tasks, get_args(TaskName)
    yield config.compared, get_args(_COMPARED[config.column])
    if isinstance(config, ExecutionStudyConfig):
        yield (config.arm.servos,), ("stiff", "real")
    if isinstance(config, PlacementStudyConfig):
        learning = config.learning
        yield (config.preset,), get_args(PresetName)
        yield (learning.likelihood,), (None, *get_args(LikelihoodName))
        yield (learning.guess,), (None, "map", "mean")
        yield (learning.teacher,), get_args(TeacherName)
        yield (learning.truth,), ("task", "prior")
