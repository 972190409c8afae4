"""What a calibration study found: a summary, a figure and a table for each kind."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from tablesetting.curves import Share
from tablesetting.experiments.setup import DEFAULTS
from tablesetting.experiments.study_config import CalibrationStudyConfig
from tablesetting.irl.certificate import MIN_FIT
from tablesetting.plotting import plot_calibration
from tablesetting.results import SUMMARY, Row, RunFolder, finite_or_none

CALIBRATION = "calibration.md"
FIGURE = "figures/calibration.png"

_PROMISED = 0.95  # Of losses, within the bound.


@dataclass(frozen=True)
class Calibration:
    """How often the bound held after a number of demonstrations of one kind of people.

    Attributes:
        teacher: The kind.
        num_demos: How many demonstrations.
        num_unbounded: Trials whose samples were too few for a bound; in the shares they
            do not count.
        covered: Trials in which the error in one test layout was within its own bound.
        share_covered: Share of all test layouts in which it was.
        all_covered: Trials in which no test error was above the largest bound.
        unmixed: Trials whose chains had not mixed.
        unfit: Trials whose demonstrations did not fit the model of the person.
        unfit_where_it_failed: Those among the trials whose bound did not hold.
        certified: Trials with fit and mixed chains whose largest bound was below the
            usual epsilon.
        certified_where_it_failed: Those among the trials whose bound did not hold.
        mean_placement_error: Mean over trials and test layouts, in table units.
        bound: Median over trials of the largest bound, in table units.
    """

    teacher: str
    num_demos: int
    num_unbounded: int
    covered: Share
    share_covered: float
    all_covered: Share
    unmixed: Share
    unfit: Share
    unfit_where_it_failed: Share
    certified: Share
    certified_where_it_failed: Share
    mean_placement_error: float
    bound: float


def calibrate(
    rows: Sequence[Row], config: CalibrationStudyConfig
) -> Iterator[Calibration]:
    """Count over the trials of both tasks; yield kind by kind, demonstration by one."""
    for teacher in config.teachers:
        for num_demos in range(1, config.num_queries + 2):
            every = [
                row
                for row in rows
                if row["teacher"] == teacher and int(row["num_demos"]) == num_demos
            ]
            own = [row for row in every if math.isfinite(float(row["bound"]))]
            failed = [row for row in own if row["all_covered"] == "0"]
            errors = [float(row["mean_placement_error"]) for row in every]
            bounds = [float(row["bound"]) for row in every]
            shares = [float(row["share_covered"]) for row in own]
            yield Calibration(
                teacher=teacher,
                num_demos=num_demos,
                num_unbounded=len(every) - len(own),
                covered=Share.of([row["one_covered"] == "1" for row in own]),
                share_covered=sum(shares) / len(own) if own else math.nan,
                all_covered=Share.of([row["all_covered"] == "1" for row in own]),
                unmixed=Share.of([row["has_mixed"] == "0" for row in own]),
                unfit=Share.of([_is_unfit(row) for row in own]),
                unfit_where_it_failed=Share.of([_is_unfit(row) for row in failed]),
                certified=Share.of([_is_certified(row) for row in own]),
                certified_where_it_failed=Share.of(
                    [_is_certified(row) for row in failed]
                ),
                mean_placement_error=sum(errors) / len(every),
                bound=median(bounds),
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


def _is_unfit(row: Row) -> bool:
    """Tell whether the fit forbids a certificate."""
    return float(row["fit"]) < MIN_FIT


def _is_certified(row: Row) -> bool:
    """Tell whether a run would end here with a certificate, by the study's R-hat."""
    is_small = float(row["bound"]) < DEFAULTS["default"].epsilon
    return is_small and row["has_mixed"] == "1" and not _is_unfit(row)


def _point(each: Calibration) -> tuple[str, int, float, float, float]:
    return each.teacher, each.num_demos, each.covered.value, *each.covered.interval


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
            _row("the same, all layouts [%]", [_percent(e.share_covered) for e in own])
        )
        lines.append(
            _row("no error above the bound [%]", [str(e.all_covered) for e in own])
        )
        lines.append(_row("chains not mixed", [_count(e.unmixed) for e in own]))
        lines.append(_row("fit refused", [_count(e.unfit) for e in own]))
        lines.append(
            _row(
                "of the failed, fit refused",
                [_count(e.unfit_where_it_failed) for e in own],
            )
        )
        lines.append(
            _row("certified at the usual epsilon", [_count(e.certified) for e in own])
        )
        lines.append(
            _row(
                "of the failed, certified",
                [_count(e.certified_where_it_failed) for e in own],
            )
        )
        if any(e.num_unbounded for e in own):
            lines.append(_row("without a bound", [str(e.num_unbounded) for e in own]))
        lines.append(_row("mean error", [f"{e.mean_placement_error:.3f}" for e in own]))
        lines.append(_row("median bound", [f"{e.bound:.3f}" for e in own]))
    return "\n".join(lines) + "\n"


def _percent(value: float) -> str:
    return f"{value:.1%}" if math.isfinite(value) else "none"


def _count(share: Share) -> str:
    return f"{share.count} of {share.total}"


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
                "share_covered": finite_or_none(round(each.share_covered, 6)),
                "mean_placement_error": round(each.mean_placement_error, 6),
                "bound": finite_or_none(round(each.bound, 6)),
            }
            for each in found
        ],
    }


def _tell(found: Sequence[Calibration]) -> list[str]:
    """Say in lines how often the bounds of each kind held."""
    lines = []
    for teacher in dict.fromkeys(each.teacher for each in found):
        own = [each for each in found if each.teacher == teacher]
        bounded = [each for each in own if each.covered.total]
        if not bounded:
            lines.append(f"{teacher}: no bound, for lack of effective samples")
            continue
        worst = min(bounded, key=lambda each: each.share_covered)
        failed = sum(each.unfit_where_it_failed.total for each in own)
        unfit = sum(each.unfit_where_it_failed.count for each in own)
        certified = sum(each.certified_where_it_failed.count for each in own)
        lines.append(
            f"{teacher}: within the bound in {worst.share_covered:.1%} of the layouts or "
            f"more (least after {worst.num_demos}); the run's bound failed {failed} "
            f"times, of which the fit refused {unfit}, and {certified} were certified"
        )
    return lines
