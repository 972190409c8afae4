"""Layouts, demonstrations and weights as JSON; see docs/conventions.md."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile
from tablesetting.irl.arrays import Array
from tablesetting.results import read_json
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import RbfWidths
from tablesetting.reward.tasks import PlacementTask

LAYOUTS_FORMAT = "tablesetting-layouts/1"
DEMONSTRATIONS_FORMAT = "tablesetting-demonstrations/1"
WEIGHTS_FORMAT = "tablesetting-weights/1"


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
