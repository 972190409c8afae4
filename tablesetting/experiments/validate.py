"""Validate learned weights on test layouts, some of them carried out by the arm."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile, InvalidLayout
from tablesetting.experiments.config import ValidateConfig
from tablesetting.experiments.validation import placements_of
from tablesetting.irl.arrays import Array
from tablesetting.opening import hash_file
from tablesetting.options import refuse_changed, to_options
from tablesetting.results import CONFIG_FORMAT, format_of, package_versions
from tablesetting.reward.files import (
    WEIGHTS_FORMAT,
    LearnedReward,
    read_demonstrations,
    read_layouts,
    read_weights,
)
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.rbf import RbfWidths
from tablesetting.reward.tasks import PlacementTask

# What may differ between the start of a validation and its going on.
_OF_ONE_CALL = ("jobs", "out", "resume", "overwrite")


@dataclass(frozen=True)
class Validation:
    """Learned weights, and where the item is wanted in test layouts.

    Attributes:
        config: The options.
        rewards: One or two learned rewards of the same task.
        layouts: Test layouts, shape (L, K, 2), in table units.
        wanted: Where the item is wanted, shape (L, 2), in table units.
        layouts_from: Where the layouts come from, in words.
        wanted_by: Who wants it, in words.
    """

    config: ValidateConfig
    rewards: tuple[LearnedReward, ...]
    layouts: Array
    wanted: Array
    layouts_from: str
    wanted_by: str

    @classmethod
    def of_config(cls, config: ValidateConfig) -> "Validation":
        """Read the files and draw the layouts.

        Raises:
            InvalidFile: If a file cannot be used, or they are not of one task.
            InvalidLayout: If the arm is to act in a given layout that is not possible.
        """
        rewards = tuple(read_weights(path) for path in config.weights)
        task = rewards[0].task
        for path, reward in zip(config.weights, rewards, strict=True):
            _check_task(path, reward.task, task)
        layouts, wanted, layouts_from = _test(config, task)
        if config.execute > len(layouts):
            remedy = " or raise --num-layouts" * (layouts_from in ("valid", "uniform"))
            raise InvalidFile(
                f"--execute {config.execute} is more than the {len(layouts)} test "
                f"layouts; lower it{remedy}"
            )
        _check_possible(task, layouts[: config.execute])
        wanted_by = "the task's truth" if config.against == "truth" else config.against
        return cls(config, rewards, layouts, wanted, layouts_from, wanted_by)

    @property
    def task(self) -> PlacementTask:
        """What is placed."""
        return self.rewards[0].task

    @cached_property
    def placements(self) -> Array:
        """Where each reward wants the item, shape (R, L, 2), in table units."""
        return np.stack([placements_of(each, self.layouts) for each in self.rewards])

    @cached_property
    def errors(self) -> Array:
        """Distance of that from where it is wanted, shape (R, L), in table units."""
        return np.linalg.norm(self.placements - self.wanted, axis=-1)

    def settings(self) -> dict[str, Any]:
        """Return the content of config.json, as it will be read back."""
        files = [*self.config.weights]
        files += [
            Path(named)
            for named in (self.config.against, self.config.layouts)
            if named not in (None, "truth", "valid", "uniform")
        ]
        return {
            "format": CONFIG_FORMAT,
            "command": "validate",
            "options": to_options(self.config, _OF_ONE_CALL),
            "resolved": {"sha256": {str(path): hash_file(path) for path in files}},
            "versions": package_versions(),
        }


def _test(config: ValidateConfig, task: PlacementTask) -> tuple[Array, Array, str]:
    """Return test layouts, where the item is wanted in them, and whence they are."""
    is_truth = config.against == "truth"
    if not is_truth and not _is_weights(Path(config.against)):
        return _recorded(config, task)
    layouts, source = _layouts(config, task)
    if is_truth:
        truth = LearnedReward(task, task.true_weights, RbfWidths())
    else:
        truth = read_weights(Path(config.against))
        _check_task(config.against, truth.task, task)
    return layouts, placements_of(truth, layouts), source


def _recorded(config: ValidateConfig, task: PlacementTask) -> tuple[Array, Array, str]:
    try:
        refuse_changed(config, ("num_layouts",), f"with --against {config.against}")
    except ValueError as error:
        raise InvalidFile(str(error)) from error
    if config.layouts is not None:
        raise InvalidFile(
            f"--layouts {config.layouts} cannot go with --against {config.against}, "
            "which has layouts of its own; leave one of them out"
        )
    found, demos = read_demonstrations(Path(config.against))
    _check_task(config.against, found, task)
    layouts = np.stack([demo.layout for demo in demos])
    wanted = np.stack([demo.placement for demo in demos])
    return layouts, wanted, f"those of {config.against}"


def _layouts(config: ValidateConfig, task: PlacementTask) -> tuple[Array, str]:
    choice = config.layouts or "valid"
    if choice not in ("valid", "uniform"):
        return read_layouts(Path(choice), task.objects), f"those of {choice}"
    space = LayoutSpace.of_task(task, are_points=choice == "uniform")
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(0,)))
    return space.sample(config.num_layouts, rng=rng), choice


def _is_weights(path: Path) -> bool:
    """Tell whether a file is of weights, rather than of demonstrations."""
    return path.suffix.lower() != ".csv" and format_of(path) == WEIGHTS_FORMAT


def _check_task(path: Path | str, found: PlacementTask, task: PlacementTask) -> None:
    if found.name != task.name:
        raise InvalidFile(
            f"'{path}' is of the task {found.name}, the weights are of {task.name}; "
            "name files of one task"
        )


def _check_possible(task: PlacementTask, layouts: Array) -> None:
    space = LayoutSpace.of_task(task, are_points=False)
    for index, layout in enumerate(layouts):
        try:
            space.check(layout)
        except InvalidLayout as error:
            raise InvalidLayout(
                f"the arm cannot act in test layout {index}: {error}"
            ) from error
