"""What an execution study found: a summary, a figure and a table."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.curves import Share
from tablesetting.experiments.study_config import ExecutionStudyConfig
from tablesetting.plotting import plot_execution
from tablesetting.results import SUMMARY, Row, RunFolder, numbers

EXECUTIONS = "execution.md"
FIGURE = "figures/execution.png"

_QUANTILES = {"median": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}
_MEASURED = (
    *("error_mm", "yaw_error_deg", "tilt_deg", "shift_mm"),
    *("speed_share", "torque_share", "overrun_rad", "simulated_seconds"),
)


@dataclass(frozen=True)
class Executions:
    """How the arm did what it was told, with one task and kind of goal.

    Attributes:
        task: What was placed.
        goal: Where to.
        success: Placements that succeeded, of all that were asked for.
        inside: Those that ended in the receptacle, of those carried out.
        refused: How many were refused, for each reason.
        failed: How many failed, for each fault.
        touched: Placements on whose way arm or item touched anything else.
        num_retries: How many lost the item and picked it up again.
        quantiles: Of each quantity that was measured of those carried out, successes or
            not: median, 95 %, 99 % and largest, by column of rounds.csv.
    """

    task: str
    goal: str
    success: Share
    inside: Share
    refused: dict[str, int]
    failed: dict[str, int]
    touched: Share
    num_retries: int
    quantiles: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Refusals:
    """What became of requests that cannot be met, for one task and kind of request.

    Attributes:
        task: What was to be placed.
        request: The reason for which they are to be refused.
        refused: How many were refused for it.
        moved: How many had anything moved before.
    """

    task: str
    request: str
    refused: Share
    moved: Share


def executions(rows: Sequence[Row]) -> Iterator[Executions]:
    """Summarize what was to be done, for each task and goal in the order of the rows."""
    feasible = [row for row in rows if not row["request"]]
    for task, goal in dict.fromkeys((row["task"], row["goal"]) for row in feasible):
        own = [row for row in feasible if (row["task"], row["goal"]) == (task, goal)]
        done = [row for row in own if not row["refusal"]]
        yield Executions(
            task=task,
            goal=goal,
            success=Share.of([row["success"] == "1" for row in own]),
            inside=Share.of([row["inside"] == "1" for row in done]),
            refused=dict(Counter(row["refusal"] for row in own if row["refusal"])),
            failed=dict(Counter(row["fault"] for row in own if row["fault"])),
            touched=Share.of([row["touched"] != "0" for row in done]),
            num_retries=sum(row["tries"] != "1" for row in done),
            quantiles={
                name: _quantiles(numbers(done, name)) for name in _MEASURED if done
            },
        )


def refusals(rows: Sequence[Row]) -> Iterator[Refusals]:
    """Summarize what was to be refused, for each task and kind of request."""
    infeasible = [row for row in rows if row["request"]]
    kinds = dict.fromkeys((row["task"], row["request"]) for row in infeasible)
    for task, request in kinds:
        own = [
            row
            for row in infeasible
            if (row["task"], row["request"]) == (task, request)
        ]
        yield Refusals(
            task=task,
            request=request,
            refused=Share.of([row["refusal"] == request for row in own]),
            moved=Share.of([row["moved"] == "1" for row in own]),
        )


def write_executions(
    folder: RunFolder, config: ExecutionStudyConfig, rows: Sequence[Row]
) -> list[str]:
    """Write summary, figure and table of a finished study; return it in lines."""
    done, refused = list(executions(rows)), list(refusals(rows))
    title = _title(config, rows)
    text = _tables(done, refused, title)
    folder.write(EXECUTIONS, lambda path: _save_text(path, text))
    figure = plot_execution([row for row in rows if not row["request"]], title)
    folder.write(FIGURE, figure.savefig)
    folder.write_json(SUMMARY, _summarize(done, refused, config))
    return [*map(_tell, done), *map(_tell_refusals, refused)]


def _quantiles(values: Sequence[float]) -> dict[str, float]:
    found = np.percentile(np.asarray(values), list(_QUANTILES.values()))
    return dict(zip(_QUANTILES, found.round(6).tolist(), strict=True))


def _title(config: ExecutionStudyConfig, rows: Sequence[Row]) -> str:
    """Name how much was done, and every option that is not the usual."""
    num_trials = len({(row["task"], row["trial"]) for row in rows})
    changed = [
        name.replace("_", "-") if value is True else f"{name.replace('_', '-')} {value}"
        for name, value in asdict(config.arm).items()
        if value != type(config.arm).__dataclass_fields__[name].default
    ]
    return ", ".join([f"{num_trials} layouts", f"seed {config.seed}", *changed])


def _save_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _tables(done: Sequence[Executions], refused: Sequence[Refusals], title: str) -> str:
    """Write what was done and what was refused as tables in Markdown."""
    lines = [f"Execution study: {title}.", ""]
    if done:
        lines += _table_of_executions(done)
    if refused:
        lines += [
            "Requests that are to be refused:",
            "",
            *_table(
                ["refused for that reason", "anything moved"],
                [f"{each.task}: {each.request}" for each in refused],
                [
                    [_count(each.refused) for each in refused],
                    [_count(each.moved) for each in refused],
                ],
            ),
        ]
    return "\n".join(lines)


def _table_of_executions(done: Sequence[Executions]) -> list[str]:
    labels, cells = ["succeeded [%]"], [[str(each.success) for each in done]]
    for label, name, digits, quantiles in (
        ("error [mm]", "error_mm", 2, ("median", "p95", "max")),
        ("turn [degrees]", "yaw_error_deg", 3, ("median", "p95", "max")),
        ("tilt [degrees]", "tilt_deg", 3, ("max",)),
        ("shift of another object [mm]", "shift_mm", 3, ("p99", "max")),
        ("speed of a joint, of its limit", "speed_share", 2, ("max",)),
        ("torque of a joint, of its limit", "torque_share", 2, ("max",)),
        ("beyond the range of a joint [rad]", "overrun_rad", 4, ("max",)),
        ("simulated time [s]", "simulated_seconds", 1, ("median", "max")),
    ):
        labels.append(f"{label}: {' / '.join(quantiles)}")
        cells.append([_text(each, name, digits, quantiles) for each in done])
    labels += ["inside the receptacle", "touched anything else", "picked up again"]
    cells += [
        [_count(e.inside) if e.goal == "bowl" else "" for e in done],
        [_count(each.touched) for each in done],
        [str(each.num_retries) for each in done],
    ]
    for label, kind in (("refused", "refused"), ("failed", "failed")):
        labels.append(label)
        cells.append([_reasons(getattr(each, kind)) for each in done])
    names = [f"{each.task}, {each.goal}" for each in done]
    return _table(labels, names, cells)


def _table(
    labels: Sequence[str], names: Sequence[str], cells: Sequence[Sequence[str]]
) -> list[str]:
    rows = zip(labels, cells, strict=True)
    return [
        f"| | {' | '.join(names)} |",
        "|---" * (len(names) + 1) + "|",
        *(f"| {label} | {' | '.join(own)} |" for label, own in rows),
        "",
    ]


def _text(each: Executions, name: str, digits: int, quantiles: Sequence[str]) -> str:
    if name not in each.quantiles:
        return "none"
    found = each.quantiles[name]
    return " / ".join(f"{found[quantile]:.{digits}f}" for quantile in quantiles)


def _reasons(counts: dict[str, int]) -> str:
    named = [f"{count} {reason}" for reason, count in sorted(counts.items())]
    return ", ".join(named) or "none"


def _count(share: Share) -> str:
    return f"{share.count} of {share.total}"


def _summarize(
    done: Sequence[Executions],
    refused: Sequence[Refusals],
    config: ExecutionStudyConfig,
) -> dict[str, Any]:
    """Return the content of summary.json."""
    return {
        "command": "study execution",
        "seed": config.seed,
        "num_trials": config.num_trials,
        "shard": config.shard,
        "executions": [asdict(each) for each in done],
        "refusals": [asdict(each) for each in refused],
    }


def _tell(each: Executions) -> str:
    name = f"{each.task}, {each.goal}"
    if not each.quantiles:
        return f"{name}: all refused, {_reasons(each.refused)}"
    errors = _text(each, "error_mm", 2, ("median", "p95", "max"))
    line = (
        f"{name}: {_count(each.success)} succeeded, error {errors} mm (median, 95 %, "
    )
    line += f"largest), {each.touched.count} touched anything else"
    if each.refused:
        line += f"; refused: {_reasons(each.refused)}"
    if each.failed:
        line += f"; failed: {_reasons(each.failed)}"
    return line


def _tell_refusals(each: Refusals) -> str:
    return (
        f"{each.task}, {each.request}: {_count(each.refused)} refused for that reason, "
        f"{each.moved.count} moved anything"
    )
