"""Demonstrations as a table with a row each, as a spreadsheet writes it.

The columns are `<object>_x` and `<object>_y` of every object of a task, `placement_x` and
`placement_y`, in any order; their names say which task it is.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tablesetting.errors import InvalidFile
from tablesetting.reward.tasks import TASKS, PlacementTask


def columns_of(task: PlacementTask) -> list[str]:
    """List the columns of a table of demonstrations."""
    names = (*task.objects, "placement")
    return [f"{name}_{axis}" for name in names for axis in "xy"]


def read_table(path: Path) -> dict[str, Any]:
    """Read a table as the content of a demonstrations.json, positions unchecked.

    Raises:
        InvalidFile: If it is unreadable, or its columns are of no task.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")  # Spreadsheets put a mark in front.
        header, *rows = [
            row for row in csv.reader(io.StringIO(text), strict=True) if row
        ] or [[]]
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidFile(f"cannot read '{path}': {error}; mend it") from error
    names = [name.strip() for name in header]
    task = _task_of(names, path)
    if not rows:
        raise InvalidFile(f"'{path}' has no rows; give one for each demonstration")
    return {
        "task": task.name,
        "demonstrations": [
            _demonstration(names, row, task, f"'{path}': row {number}")
            for number, row in enumerate(rows, start=1)
        ],
    }


def _task_of(header: Sequence[str], path: Path) -> PlacementTask:
    """Find the task that has such columns."""
    if len(header) == 1 and ";" in header[0]:
        raise InvalidFile(
            f"'{path}' has semicolons between its cells; save it with commas"
        )
    tasks = list(TASKS.values())
    for task in tasks:
        if sorted(header) == sorted(columns_of(task)):
            return task
    # The one that was most likely meant.
    task = max(tasks, key=lambda each: len(set(header) & set(columns_of(each))))
    expected = columns_of(task)
    problems = [
        *(f"lacks the column {name!r}" for name in expected if name not in header),
        *(
            f"has an unknown column {name!r:.40}"
            for name in header
            if name not in expected
        ),
        *(
            f"has the column {name!r} twice"
            for name in expected
            if header.count(name) > 1
        ),
    ]
    raise InvalidFile(
        f"'{path}' {problems[0]}; the task {task.name} has {','.join(expected)}"
    )


def _demonstration(
    names: Sequence[str], row: Sequence[str], task: PlacementTask, where: str
) -> dict[str, Any]:
    if len(row) != len(names):
        raise InvalidFile(f"{where} has {len(row)} cells; give {len(names)}")
    cells = dict(zip(names, map(_number_or_text, row), strict=True))
    places = {
        name: [cells[f"{name}_x"], cells[f"{name}_y"]]
        for name in (*task.objects, "placement")
    }
    placement = places.pop("placement")
    return {"layout": places, "placement": placement}


def _number_or_text(cell: str) -> float | str:
    """Return a number, or what stands there instead."""
    try:
        return float(cell)
    except ValueError:
        return cell
