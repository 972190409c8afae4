"""The files of a validation: a row for each test layout, a summary and a figure."""

import warnings
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from tablesetting.bootstrap import Estimate, estimate
from tablesetting.errors import InvalidFile
from tablesetting.experiments.rows import rounded
from tablesetting.experiments.validate import Validation
from tablesetting.irl.arrays import Array
from tablesetting.plotting import WorstLayout, plot_validation
from tablesetting.results import SUMMARY, RunFolder, numbers, read_rows
from tablesetting.reward.layout import LayoutSpace

TABLE = "layouts.csv"
FIGURE = "figures/validation.png"

_EXECUTION_CELLS = (
    *("commanded_x", "commanded_y", "settled_x", "settled_y"),
    *("execution_error_mm", "bystander_shift_mm", "success", "failure"),
)
_NUM_WORST = 5
_SUMMARY_FORMAT = "tablesetting-validation/1"


def write_validation(
    validation: Validation, folder: RunFolder, num_jobs: int
) -> Generator[int, None, None]:
    """Validate, and write the folder as it goes; what is there already is not redone.

    Args:
        validation: What to do.
        folder: Its config.json is written.
        num_jobs: Processes for the arm.

    Yields:
        How many executions are done, when another one is.
    """
    done = _read_done(validation, folder)
    rows = [_row(validation, index) for index in range(validation.errors.size)]
    num_ordered = validation.config.execute * len(validation.rewards)
    others = [row for index, row in enumerate(rows) if index >= num_ordered]
    missing = [row for row in others if row["row"] not in done]
    if missing:
        folder.append_rows(missing, TABLE)
        done |= {int(str(row["row"])): row for row in missing}
    yield len(done) - len(others)
    if len(done) < len(rows):
        # Only now is the simulator needed, which takes seconds to import.
        from tablesetting.experiments.validation_orders import execute_orders

        for index, cells in execute_orders(validation, done, num_jobs):
            done[index] = rounded(rows[index] | cells)
            folder.append_rows([done[index]], TABLE)
            yield len(done) - len(others)
    folder.write_rows([done[index] for index in range(len(rows))], TABLE)


def finish_validation(validation: Validation, folder: RunFolder) -> list[str]:
    """Write summary and figure; return what was found in words, line by line."""
    rows = read_rows(folder.path / TABLE)
    summary = summarize(validation, rows)
    figure = plot_validation(
        validation.wanted,
        [
            (str(path), placements, errors, _worst(validation, which))
            for which, (path, placements, errors) in enumerate(
                zip(
                    validation.config.weights,
                    validation.placements,
                    validation.errors,
                    strict=True,
                )
            )
        ],
        f"place {validation.task.item}: {_count(len(validation.layouts))} "
        f"({validation.layouts_from}), against {validation.wanted_by}",
    )
    with warnings.catch_warnings():
        # A name may have letters that the font has not.
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        folder.write(FIGURE, figure.savefig)
    folder.write_json(SUMMARY, summary)
    return [*_lines(validation, summary), *_places(folder)]


def summarize(
    validation: Validation, rows: Sequence[Mapping[str, str]]
) -> dict[str, Any]:
    """Return the content of summary.json.

    Args:
        validation: What was done.
        rows: Rows of the table, complete and in order.
    """
    config, num_rewards = validation.config, len(validation.rewards)
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(2,)))
    found = []
    for which, (path, errors) in enumerate(
        zip(config.weights, validation.errors, strict=True)
    ):
        own = rows[which : config.execute * num_rewards : num_rewards]
        found.append(
            {
                "weights": str(path),
                "mean_placement_error": float(errors.mean()),
                "max_placement_error": float(errors.max()),
                "placement_error": _as_dicts(errors, rng),
                "executions": _executions(own) if own else None,
            }
        )
    summary = {
        "format": _SUMMARY_FORMAT,
        "task": validation.task.name,
        "against": config.against,
        "layouts": validation.layouts_from,
        "num_layouts": len(validation.layouts),
        "seed": config.seed,
        "validated": found,
    }
    if num_rewards == 2:
        less = validation.errors[0] - validation.errors[1]
        summary["paired"] = {
            "first_minus_second": _as_dicts(less, rng)["mean"],
            "share_where_first_is_better": float(np.mean(less < 0.0)),
            "share_where_second_is_better": float(np.mean(less > 0.0)),
        }
    return summary


def _as_dicts(values: Array, rng: np.random.Generator) -> dict[str, Any]:
    found = estimate(values, rng=rng)
    return {name: asdict(each) for name, each in found.items()}


def _executions(rows: Sequence[Mapping[str, str]]) -> dict[str, Any]:
    """Say how the arm fared, and apart from that how far off it was told to be."""
    made = [row for row in rows if row["execution_error_mm"]]
    errors = np.array(numbers(made, "execution_error_mm"))
    quantiles = {"median": 0.5, "p95": 0.95, "max": 1.0}
    return {
        "attempted": len(made),
        "refused": len(rows) - len(made),
        "succeeded": sum(row["success"] == "1" for row in rows),
        "share_placed": sum(row["success"] == "1" for row in rows) / len(rows),
        "mean_placement_error": float(np.mean(numbers(rows, "error"))),
        **{
            f"{name}_error_mm": float(np.quantile(errors, level)) if made else None
            for name, level in quantiles.items()
        },
        "failures": sorted({row["failure"] for row in rows if row["failure"]}),
    }


def _lines(validation: Validation, summary: Mapping[str, Any]) -> Iterator[str]:
    yield (
        f"{_count(summary['num_layouts'])} ({summary['layouts']}), placement error "
        f"against {validation.wanted_by}, in table units, with 95 % intervals:"
    )
    for found in summary["validated"]:
        figures = ", ".join(
            f"{name} {Estimate(**each)}"
            for name, each in found["placement_error"].items()
        )
        yield f"{found['weights']}: {figures}"
        if found["executions"] is not None:
            yield f"  {_execution_line(found['executions'])}"
    if paired := summary.get("paired"):
        less = Estimate(**paired["first_minus_second"])
        yield (
            f"first minus second, layout by layout: mean {less}; the first is better in "
            f"{paired['share_where_first_is_better']:.0%} of the layouts, the second in "
            f"{paired['share_where_second_is_better']:.0%}"
        )


def _count(num_layouts: int) -> str:
    return f"{num_layouts} test layout{'s' * (num_layouts != 1)}"


def _execution_line(found: Mapping[str, Any]) -> str:
    total = found["attempted"] + found["refused"]
    line = (
        f"the arm placed {found['succeeded']} of {total} ({found['share_placed']:.0%}), "
        f"{found['refused']} refused"
    )
    if found["median_error_mm"] is not None:
        line += (
            f"; execution error {found['median_error_mm']:.2f} / "
            f"{found['p95_error_mm']:.2f} / {found['max_error_mm']:.2f} mm (median, "
            "95 %, largest)"
        )
    return f"{line}; learning error in these {found['mean_placement_error']:.4f}"


def _places(folder: RunFolder) -> list[str]:
    named = (("table", TABLE), ("figure", FIGURE))
    return [f"{kind}: {folder.path / name}" for kind, name in named]


def _row(validation: Validation, index: int) -> dict[str, object]:
    """Return one row, that of each reward in turn for each layout."""
    layout, which = divmod(index, len(validation.rewards))
    places = zip(validation.task.objects, validation.layouts[layout], strict=True)
    robot, wanted = validation.placements[which, layout], validation.wanted[layout]
    return rounded(
        {
            "row": index,
            "weights": str(validation.config.weights[which]),
            "layout": layout,
            **{f"{name}_{a}": v for name, xy in places for a, v in _named(xy)},
            **{f"wanted_{a}": v for a, v in _named(wanted)},
            **{f"robot_{a}": v for a, v in _named(robot)},
            "error": float(validation.errors[which, layout]),
            **dict.fromkeys(_EXECUTION_CELLS),
        }
    )


def _named(place: Array) -> Iterator[tuple[str, float]]:
    return zip("xy", place.tolist(), strict=True)


def _read_done(
    validation: Validation, folder: RunFolder
) -> dict[int, Mapping[str, object]]:
    """Read the rows that are there; what a kill cut short is left out, and removed."""
    path = folder.path / TABLE
    if not path.exists():
        return {}
    rows = read_rows(path)
    header = list(_row(validation, 0))
    if not path.read_bytes().endswith(b"\n"):
        rows = rows[:-1]
    if rows and list(rows[0]) != header:
        raise InvalidFile(
            f"'{path}' has other columns than {', '.join(header)}; mend it or remove it"
        )
    is_ordered = validation.config.execute * len(validation.rewards)
    done: dict[int, Mapping[str, object]] = {
        int(row["row"]): dict(row)
        for row in rows
        if _is_whole(row, len(header), validation.errors.size, is_ordered)
    }
    folder.write_rows(list(done.values()), TABLE)
    return done


def _is_whole(
    row: Mapping[str, str], num_cells: int, num_rows: int, num_ordered: int
) -> bool:
    """Tell whether a row is all there."""
    cells = list(row.values())
    if len(cells) != num_cells or None in cells or not row["row"].isdecimal():
        return False
    index = int(row["row"])
    return index < num_rows and (index >= num_ordered or row["success"] in ("0", "1"))


def _worst(validation: Validation, which: int) -> list[WorstLayout]:
    """Describe the layouts of the largest errors, for drawing."""
    errors = validation.errors[which]
    space = LayoutSpace.of_task(
        validation.task, are_points=validation.config.layouts == "uniform"
    )
    ordered = np.argsort(-errors, kind="stable")[:_NUM_WORST]
    worst = [index for index in ordered if errors[index] > 0.0]
    return [
        WorstLayout(
            name=f"layout {index}: error {errors[index]:.4f}",
            outlines=space.outlines(validation.layouts[index]),
            wanted=validation.wanted[index],
            robot=validation.placements[which, index],
        )
        for index in worst
    ]
