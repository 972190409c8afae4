"""What a calibration study found: a summary, a figure and a table for each kind."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tablesetting.curves import Share
from tablesetting.experiments.study_config import CalibrationStudyConfig
from tablesetting.irl.certificate import MIN_FIT
from tablesetting.plotting import plot_calibration
from tablesetting.results import SUMMARY, Row, RunFolder

CALIBRATION = "calibration.md"
FIGURE = "figures/calibration.png"

_PROMISED = 0.95  # Of losses, within the bound.


@dataclass(frozen=True)
class Calibration:
    """How often the bound held after a number of demonstrations of one kind of people.

    Attributes:
        teacher: The kind.
        num_demos: How many demonstrations.
        covered: Trials in which the error in one test layout was within its own bound.
        share_covered: Share of all test layouts in which it was.
        all_covered: Trials in which no test error was above the largest bound.
        doubted: Trials for which no certificate would be given, for lack of fit or as
            the chains had not mixed.
        doubted_where_it_failed: Those among the trials whose bound did not hold.
        mean_placement_error: Mean over trials and test layouts, in table units.
        bound: Median over trials of the largest bound, in table units.
    """

    teacher: str
    num_demos: int
    covered: Share
    share_covered: float
    all_covered: Share
    doubted: Share
    doubted_where_it_failed: Share
    mean_placement_error: float
    bound: float


def calibrate(
    rows: Sequence[Row], config: CalibrationStudyConfig
) -> Iterator[Calibration]:
    """Count over the trials of both tasks; yield kind by kind, demonstration by one."""
    for teacher in config.teachers:
        for num_demos in range(1, config.num_queries + 2):
            own = [
                row
                for row in rows
                if row["teacher"] == teacher and int(row["num_demos"]) == num_demos
            ]
            failed = [row for row in own if row["all_covered"] == "0"]
            errors = [float(row["mean_placement_error"]) for row in own]
            bounds = sorted(float(row["bound"]) for row in own)
            shares = [float(row["share_covered"]) for row in own]
            yield Calibration(
                teacher=teacher,
                num_demos=num_demos,
                covered=Share.of([row["one_covered"] == "1" for row in own]),
                share_covered=sum(shares) / len(own),
                all_covered=Share.of([row["all_covered"] == "1" for row in own]),
                doubted=Share.of([_is_doubted(row) for row in own]),
                doubted_where_it_failed=Share.of([_is_doubted(row) for row in failed]),
                mean_placement_error=sum(errors) / len(own),
                bound=bounds[len(bounds) // 2],
            )


def write_calibration(
    folder: RunFolder, config: CalibrationStudyConfig, rows: Sequence[Row]
) -> list[str]:
    """Write summary, figure and tables of a finished study; return it in lines."""
    found = list(calibrate(rows, config))
    num_trials = len(rows) // (len(config.teachers) * (config.num_queries + 1))
    title = (
        f"{num_trials} preferences, {len(config.teachers)} kinds of people, "
        f"seed {config.seed}"
    )
    text = _tables(found, title)
    folder.write(CALIBRATION, lambda path: _save_text(path, text))
    figure = plot_calibration([_point(each) for each in found], _PROMISED, title)
    folder.write(FIGURE, figure.savefig)
    folder.write_json(SUMMARY, _summarize(found, config))
    return _tell(found)


def _is_doubted(row: Row) -> bool:
    """Tell whether a run that ends here would not be certified, but for its epsilon."""
    return float(row["fit"]) < MIN_FIT or row["has_mixed"] == "0"


def _point(each: Calibration) -> tuple[str, int, float, float, float]:
    low, high = each.covered.interval
    return each.teacher, each.num_demos, each.share_covered, low, high


def _save_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _tables(found: Sequence[Calibration], title: str) -> str:
    """Write one table for each kind of people, in Markdown."""
    lines = [
        f"Calibration study: {title}. Within its bound is to be the error in a test "
        f"layout in {_PROMISED:.0%} of the cases at least; intervals are of 95 %, for one "
        "layout of each trial.",
    ]
    for teacher in dict.fromkeys(each.teacher for each in found):
        own = [each for each in found if each.teacher == teacher]
        lines += ["", f"## {teacher}", ""]
        lines.append(_row("after demonstrations", [str(e.num_demos) for e in own]))
        lines.append("|---" * (len(own) + 1) + "|")
        lines.append(_row("within its bound [%]", [str(e.covered) for e in own]))
        lines.append(
            _row("the same, all layouts [%]", [f"{e.share_covered:.1%}" for e in own])
        )
        lines.append(
            _row("no error above the bound [%]", [str(e.all_covered) for e in own])
        )
        lines.append(
            _row("not certifiable [%]", [f"{e.doubted.value:.0%}" for e in own])
        )
        lines.append(
            _row(
                "of the failed, not certifiable",
                [
                    f"{e.doubted_where_it_failed.count} of "
                    f"{e.doubted_where_it_failed.total}"
                    for e in own
                ],
            )
        )
        lines.append(_row("mean error", [f"{e.mean_placement_error:.3f}" for e in own]))
        lines.append(_row("median bound", [f"{e.bound:.3f}" for e in own]))
    return "\n".join(lines) + "\n"


def _row(label: str, cells: Sequence[str]) -> str:
    return f"| {label} | {' | '.join(cells)} |"


def _summarize(
    found: Sequence[Calibration], config: CalibrationStudyConfig
) -> dict[str, Any]:
    """Return the content of summary.json."""
    return {
        "command": "study calibration",
        "seed": config.seed,
        "num_trials": config.num_trials,
        "shard": config.shard,
        "promised": _PROMISED,
        "calibration": [
            asdict(each)
            | {
                "share_covered": round(each.share_covered, 6),
                "mean_placement_error": round(each.mean_placement_error, 6),
                "bound": round(each.bound, 6) if math.isfinite(each.bound) else None,
            }
            for each in found
        ],
    }


def _tell(found: Sequence[Calibration]) -> list[str]:
    """Say in lines how often the bounds of each kind held."""
    lines = []
    for teacher in dict.fromkeys(each.teacher for each in found):
        own = [each for each in found if each.teacher == teacher]
        worst = min(own, key=lambda each: each.share_covered)
        failed = sum(each.doubted_where_it_failed.total for each in own)
        doubted = sum(each.doubted_where_it_failed.count for each in own)
        lines.append(
            f"{teacher}: within the bound in {worst.share_covered:.1%} of the layouts or "
            f"more (least after {worst.num_demos}); the run's bound failed {failed} "
            f"times, {doubted} of them not certifiable"
        )
    return lines
