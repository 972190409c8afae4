"""Measure speed and memory: `python benchmarks/run.py`, or compare two measurements.

Times are processor time on one core. Beside a figure of learning stands what `plain.py`
needs for the same work in numpy; where that is long, it is measured in part and scaled.
"""

import argparse
import json
import os
import platform
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path

# More threads would add up in the processor time; said before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "disable")

import grids
import learning
import physics
import placements
import scaling
from figure import Figure, Quantity, Timing

from tablesetting.errors import TableSettingError
from tablesetting.results import package_versions, read_json

_FORMAT = "tablesetting-benchmark/1"
_MODULES = {
    module.__name__: module
    for module in (placements, learning, scaling, physics, grids)
}
_HEADER = (
    f"{'figure':<56}{'minimum':>10}{'median':>10}{'MiB':>7}"
    f"{'plain':>10}{'measured':>10}{'ratio':>9}"
)


def main() -> int:
    """Parse the command line and do what it says; return the exit code."""
    options = _parse_options()
    try:
        if options.compare:
            _compare(*options.compare)
        else:
            _run(options.out or _default_out(), options.only)
    except (TableSettingError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _parse_options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="result; by default in runs/bench/"
    )
    parser.add_argument(
        "--compare",
        type=Path,
        nargs=2,
        metavar=("A", "B"),
        help="measure nothing; print the figures of two results and their ratios",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        choices=list(_MODULES),
        default=list(_MODULES),
        help="what to measure; all if left out",
    )
    return parser.parse_args()


def _default_out() -> Path:
    return Path("runs/bench") / f"{datetime.now():%Y%m%d-%H%M%S}.json"


def _run(out: Path, names: Sequence[str]) -> None:
    """Print every figure as it is there, then save all."""
    out.parent.mkdir(parents=True, exist_ok=True)
    print(_HEADER)
    figures = []
    for figure in _all_figures(names):
        print(_format(figure), flush=True)
        figures.append(_to_json(figure))
    content = {"format": _FORMAT, "machine": _machine(), "figures": figures}
    out.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    print(f"saved to {out}")


def _all_figures(names: Sequence[str]) -> Iterator[Figure]:
    for name in names:
        for work in _MODULES[name].FIGURES:
            yield from work()


def _machine() -> dict[str, object]:
    return {
        "platform": platform.platform(),
        "python": platform.python_version(),
        "num_cores": os.cpu_count(),
        "versions": package_versions(),
    }


def _to_json(figure: Figure) -> dict[str, object]:
    ratio = {"ratio": figure.ratio} if isinstance(figure, Timing) else {}
    return asdict(figure) | ratio


def _format(figure: Figure) -> str:
    """Write a figure as a row of the table."""
    if isinstance(figure, Quantity):
        return f"{figure.name:<56}{figure.value:>10.4g} {figure.unit}"
    row = f"{figure.name:<56}"
    row += _seconds(figure.seconds_min) + _seconds(figure.seconds_median)
    row += " " * 7 if figure.peak_mib is None else f"{figure.peak_mib:>7.1f}"
    if figure.plain_seconds is None or figure.plain_share is None:
        return row.rstrip()
    measured = f"{figure.plain_share:.2%}"
    return f"{row}{_seconds(figure.plain_seconds)}{measured:>10}{figure.ratio:>8.3g}x"


def _seconds(seconds: float) -> str:
    """Write a time in ten columns."""
    if seconds < 1.0:
        return f"{1e3 * seconds:>7.4g} ms"
    return f"{seconds:>7.4g} s "


def _compare(before: Path, after: Path) -> None:
    """Print the ratio of every figure that both files hold."""
    old, new = _read_values(before), _read_values(after)
    print(f"{'figure':<56}{'A':>12}{'B':>12}{'B / A':>9}")
    for name in (name for name in old if name in new):
        ratio = new[name] / old[name] if old[name] else float("nan")
        print(f"{name:<56}{old[name]:>12.4g}{new[name]:>12.4g}{ratio:>9.3f}")
    for name in sorted(old.keys() ^ new.keys()):
        print(f"{name:<56}only in {before if name in old else after}")


def _read_values(path: Path) -> dict[str, float]:
    """Read the least time, or the value, of every figure."""
    figures = read_json(path, _FORMAT)["figures"]
    return {
        figure["name"]: figure.get("seconds_min", figure.get("value"))
        for figure in figures
    }


if __name__ == "__main__":
    sys.exit(main())
