"""What runs there are in a folder, a line each."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tablesetting.errors import InvalidFile
from tablesetting.results import CONFIG, SUMMARY, load_json

_HEADER = ("folder", "command", "task", "strategy", "seed", "demos", "error", "bound")
_COLUMNS = (*_HEADER, "state")


def list_runs(folder: Path) -> Iterator[str]:
    """Tell what runs a folder holds, at any depth, from their settings and summaries.

    Args:
        folder: Is no run itself.

    Yields:
        Lines of a table: mean placement error and bound are in table units. The error of
        a validation is that of each weights, the one of `learn` of what was foretold.

    Raises:
        InvalidFile: If there is no run.
    """
    found = sorted(path.parent for path in folder.rglob(CONFIG))
    if not found:
        raise InvalidFile(
            f"'{folder}' is no run and holds none; name the folder of a run, or one "
            "with runs in it"
        )
    rows = [_COLUMNS, *(_describe(path, folder) for path in found)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_COLUMNS))]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()


def _describe(path: Path, folder: Path) -> tuple[str, ...]:
    config, summary = _read(path / CONFIG), _read(path / SUMMARY)
    options = _dict(config.get("options"))
    known = summary | options | _dict(config.get("resolved"))
    return (
        path.relative_to(folder).as_posix(),
        _cell(config.get("command")),
        _cell(known.get("task", known.get("tasks"))),
        _cell(known.get("strategy", known.get("strategies"))),
        _cell(known.get("seed")),
        _cell(summary.get("num_demos")),
        _cell(_error(summary)),
        _cell(summary.get("deployment_bound", summary.get("var_bound"))),
        _state(path, summary),
    )


def _error(summary: Mapping[str, Any]) -> Any:
    name, validated = "mean_placement_error", summary.get("validated")
    if isinstance(validated, list):
        return [_cell(_dict(each).get(name)) for each in validated]
    return summary.get(name, summary.get("mean_prediction_error"))


def _state(path: Path, summary: Mapping[str, Any]) -> str:
    if not (path / SUMMARY).exists():
        return "unfinished"
    if not summary:
        return "damaged"
    if "certified" not in summary:
        return "finished"
    return "certified" if summary["certified"] is True else "not certified"


def _read(path: Path) -> dict[str, Any]:
    """Read a file of a run, which may be missing or damaged."""
    try:
        return _dict(load_json(path))
    except InvalidFile:
        return {}


def _dict(content: Any) -> dict[str, Any]:
    return content if isinstance(content, dict) else {}


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, list):
        return ",".join(map(str, value))[:24]
    return " ".join(str(value).split())[:24] or "-"
