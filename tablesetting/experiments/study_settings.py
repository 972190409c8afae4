"""The settings of a study as config.json holds them."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tablesetting.errors import InvalidFile
from tablesetting.experiments.setup import problem_settings
from tablesetting.experiments.study_config import PlacementStudyConfig
from tablesetting.irl.active import STRATEGIES
from tablesetting.results import CONFIG, CONFIG_FORMAT, package_versions, read_json
from tablesetting.reward.problem import PRESETS
from tablesetting.reward.tasks import TASKS

_COMMAND = "study placement"
# What may differ between the start of a study and its going on.
_OF_ONE_CALL = ("jobs", "out", "resume", "overwrite", "merge")


def describe(config: PlacementStudyConfig) -> dict[str, Any]:
    """Return the content of config.json, as it will be read back."""
    options = asdict(config)
    for name in _OF_ONE_CALL:
        del options[name]
    # All runs of a study learn in the same way.
    run_config = config.run_config(config.tasks[0], config.strategies[0])
    content = {
        "format": CONFIG_FORMAT,
        "command": _COMMAND,
        "options": options,
        "resolved": {"problem": asdict(problem_settings(run_config))},
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


def read_settings(folder: Path) -> tuple[PlacementStudyConfig, dict[str, Any]]:
    """Read the settings of a study; return them parsed and as they stand.

    Raises:
        InvalidFile: If there is no study there.
    """
    content = read_json(folder / CONFIG, CONFIG_FORMAT)
    try:
        options: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in content["options"].items()
        }
        config = PlacementStudyConfig(**options)
        for name in ("num_trials", "num_queries", "seed"):
            if type(options[name]) is not int:
                raise ValueError(f"{name} must be a whole number")
        for names, known in (
            (config.tasks, TASKS),
            (config.strategies, STRATEGIES),
            ((config.preset,), PRESETS),
        ):
            if unknown := set(names) - set(known):
                raise ValueError(f"{unknown.pop()!r} is unknown")
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InvalidFile(
            f"'{folder / CONFIG}' is not of a placement study: {error}; name the "
            "folders that the shards were written to"
        ) from error
    return config, content
