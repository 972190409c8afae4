"""Layouts, demonstrations and weights as JSON; see docs/conventions.md."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile
from tablesetting.irl.arrays import Array, normalize_l1
from tablesetting.results import read_json
from tablesetting.reward.demonstration_table import read_table
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import TABLE_CENTERS, RbfWidths
from tablesetting.reward.tasks import TASKS, PlacementTask

LAYOUTS_FORMAT = "tablesetting-layouts/1"
DEMONSTRATIONS_FORMAT = "tablesetting-demonstrations/1"
WEIGHTS_FORMAT = "tablesetting-weights/1"

DEMONSTRATIONS = "demonstrations.json"
"""Name of the file of demonstrations in a run folder."""

_MAX_NUMBER = 1e300  # A larger whole number could not even become a float.


@dataclass(frozen=True)
class LearnedReward:
    """The reward of a file of weights.

    Attributes:
        task: What it is of.
        weights: Weights of unit L1 norm, in the order of the task's objects, then the
            table's, shape (K + 9,).
        widths: Widths of the RBFs.
    """

    task: PlacementTask
    weights: Array
    widths: RbfWidths


def read_weights(path: Path) -> LearnedReward:
    """Read a learned reward.

    Args:
        path: A file of the format "tablesetting-weights/1".

    Raises:
        InvalidFile: If the file is unreadable, of an unknown task or of other objects,
            or holds what is no number, no width or no preference at all.
    """
    content = read_json(path, WEIGHTS_FORMAT)
    task = _parse_task(content.get("task"), f"'{path}'")
    objects = content.get("objects")
    if not isinstance(objects, list) or not all(isinstance(o, str) for o in objects):
        raise InvalidFile(f"'{path}': `objects` must be a list of names")
    if sorted(objects) != sorted(task.objects):
        raise InvalidFile(
            f"'{path}': `objects` are {', '.join(objects):.80}; the task {task.name} has "
            f"{', '.join(task.objects)}, once each"
        )
    of_objects = _parse_numbers(content, "object_weights", len(objects), path)
    by_name = dict(zip(objects, of_objects, strict=True))
    of_table = _parse_numbers(content, "table_weights", len(TABLE_CENTERS), path)
    weights = np.array([*(by_name[name] for name in task.objects), *of_table])
    if not weights.any():
        raise InvalidFile(
            f"'{path}': all weights are 0, which prefers nothing; give one that is not"
        )
    weights /= np.abs(weights).max()  # Else the norm of large ones would overflow.
    return LearnedReward(task, normalize_l1(weights), _parse_widths(content, path))


def read_demonstrations(path: Path) -> tuple[PlacementTask, list[Demonstration]]:
    """Read demonstrations; objects may overlap in their layouts.

    Args:
        path: A file of the format "tablesetting-demonstrations/1"; or, with the suffix
            ".csv", a table (see `reward.demonstration_table`).

    Returns:
        The task, and at least one demonstration.

    Raises:
        InvalidFile: If the file is unreadable, of an unknown task, or holds a layout or
            placement that cannot be one.
    """
    is_table = path.suffix.lower() == ".csv"
    content = read_table(path) if is_table else read_json(path, DEMONSTRATIONS_FORMAT)
    task = _parse_task(content.get("task"), f"'{path}'")
    found = content.get("demonstrations")
    if not isinstance(found, list) or not found:
        raise InvalidFile(f"'{path}': `demonstrations` must be a list of at least one")
    demos = [
        parse_demonstration(demo, task.objects, f"'{path}': demonstration {index}")
        for index, demo in enumerate(found)
    ]
    return task, demos


def read_layouts(path: Path, objects: Sequence[str]) -> Array:
    """Read layouts from a file.

    Args:
        path: A file of the format "tablesetting-layouts/1".
        objects: Names that every layout must place, in the order of its rows.

    Returns:
        Layouts, shape (L, K, 2), in table units; L is at least 1.

    Raises:
        InvalidFile: If the file is unreadable, lacks an object, names an unknown one,
            or holds a position that is not a pair of numbers in [0, 1].
    """
    layouts = read_json(path, LAYOUTS_FORMAT).get("layouts")
    if not isinstance(layouts, list) or not layouts:
        raise InvalidFile(f"'{path}': `layouts` must be a list of at least one layout")
    return np.array(
        [
            _parse_layout(layout, objects, f"'{path}': layout {index}")
            for index, layout in enumerate(layouts)
        ]
    )


def layout_to_json(layout: Array, objects: Sequence[str]) -> dict[str, list[float]]:
    """Name the rows of a layout, shape (K, 2)."""
    return dict(zip(objects, layout.tolist(), strict=True))


def demonstrations_to_json(
    demos: Sequence[Demonstration], task: PlacementTask
) -> dict[str, Any]:
    """Return the content of demonstrations.json."""
    return {
        "format": DEMONSTRATIONS_FORMAT,
        "task": task.name,
        "demonstrations": [
            {
                "layout": layout_to_json(demo.layout, task.objects),
                "placement": demo.placement.tolist(),
            }
            for demo in demos
        ],
    }


def weights_to_json(
    weights: Array, task: PlacementTask, widths: RbfWidths
) -> dict[str, Any]:
    """Return the content of weights.json for weights of shape (K + 9,)."""
    num_objects = len(task.objects)
    return {
        "format": WEIGHTS_FORMAT,
        "task": task.name,
        "objects": list(task.objects),
        "object_weights": weights[:num_objects].tolist(),
        "table_weights": weights[num_objects:].tolist(),
        "object_width": widths.object_width,
        "table_width": widths.table_width,
    }


def parse_demonstration(demo: Any, objects: Sequence[str], where: str) -> Demonstration:
    """Make a demonstration of {"layout": {name: [x, y], ...}, "placement": [x, y]}.

    Args:
        demo: What should be one.
        objects: Names that the layout must place, in the order of its rows.
        where: Where it stands, for the message.

    Raises:
        InvalidFile: If it is none.
    """
    if not isinstance(demo, Mapping) or set(demo) != {"layout", "placement"}:
        raise InvalidFile(
            f"{where} must have a `layout` and a `placement`, nothing else; got "
            f"{demo!r:.60}"
        )
    layout = _parse_layout(demo["layout"], objects, f"{where}, layout")
    placement = _parse_position(demo["placement"], f"{where}, placement")
    return Demonstration(np.array(layout), np.array(placement))


def _parse_task(name: Any, where: str) -> PlacementTask:
    if not isinstance(name, str) or name not in TASKS:
        raise InvalidFile(
            f"{where} is of the task {name!r:.60}; known are {', '.join(TASKS)}"
        )
    return TASKS[name]


def _parse_numbers(
    content: Mapping[str, Any], field: str, num: int, path: Path
) -> list[float]:
    found = content.get(field)
    if not isinstance(found, list) or len(found) != num:
        raise InvalidFile(f"'{path}': `{field}` must be a list of {num} numbers")
    return [_parse_number(value, f"'{path}': `{field}`") for value in found]


def _parse_number(value: Any, where: str) -> float:
    if type(value) in (int, float) and abs(value) <= _MAX_NUMBER:
        return float(value)
    raise InvalidFile(f"{where} holds {value!r:.60}; give a finite number")


def _parse_widths(content: Mapping[str, Any], path: Path) -> RbfWidths:
    names = ("object_width", "table_width")
    object_width, table_width = (
        _parse_number(content.get(name), f"'{path}': `{name}`") for name in names
    )
    try:
        return RbfWidths(object_width, table_width)
    except ValueError as error:
        raise InvalidFile(f"'{path}': {error}") from error


def _parse_layout(layout: Any, objects: Sequence[str], where: str) -> list[list[float]]:
    if not isinstance(layout, Mapping):
        raise InvalidFile(f"{where} must map each object to [x, y]; got {layout!r:.60}")
    missing = [name for name in objects if name not in layout]
    unknown = [name for name in layout if name not in objects]
    if missing or unknown:
        problem = f"lacks '{missing[0]}'" if missing else f"names '{unknown[0]}'"
        raise InvalidFile(f"{where} {problem}; it must place {', '.join(objects)}")
    return [_parse_position(layout[name], f"{where}, '{name}'") for name in objects]


def _parse_position(position: Any, where: str) -> list[float]:
    is_pair = isinstance(position, list) and len(position) == 2
    # NaN fails the comparison, too; True is an int to Python.
    if not is_pair or not all(
        type(value) in (int, float) and 0.0 <= value <= 1.0 for value in position
    ):
        raise InvalidFile(
            f"{where} is at {position!r:.60}; give two numbers in [0, 1], in table units"
        )
    return [float(value) for value in position]
