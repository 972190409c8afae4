"""What driving on, and what questions, teach of a highway."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gridworld_bench.experiments.config import DrivingStudyConfig
from gridworld_bench.experiments.results import draw_means, losses_of
from gridworld_bench.experiments.study import Study
from tablesetting.bootstrap import Estimate, estimate, estimate_ratio
from tablesetting.irl.arrays import Array
from tablesetting.results import Row

_SHOWN = (0, 5, 15)  # Queries, or further steps, in the table, beside the last.
_COLUMNS = ("collisions", "off_road", "policy_loss", "var", "riskiest_probability")


def tell_driving(study: Study, rows: Sequence[Row]) -> list[str]:
    """Tell how well the robot drives, and how rare the riskiest states are."""
    config = study.config
    assert isinstance(config, DrivingStudyConfig)
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(0, 1)))
    last = config.num_queries
    counts = sorted({count for count in _SHOWN if count < last} | {last})
    lines = [
        f"# {config.name}: driver {config.driver}, seed {config.seed}, "
        f"{config.num_trials} trials, {config.num_samples} samples",
        "",
        f"Means after {config.num_shown} driven steps and as many steps or answers more; "
        "95 % intervals by bootstrap over the trials. Collisions and steps off the road are "
        "of 1 000 steps of the robot's policy, the loss is its true one, on average over "
        "all states, and probabilities the mean share of the time that the driver spends "
        "in each of the ten riskiest sampled states.",
        "",
        "| strategy | more | collisions | off the road | loss | 0.95-VaR | probability [%] |",
        "|---|---|---|---|---|---|---|",
    ]
    found: dict[str, dict[str, Any]] = {}
    values = {column: losses_of(rows, config, column) for column in _COLUMNS}
    for name in map(str, config.strategies):
        found[name] = {}
        for count in counts:
            means = {
                column: _mean_of(column, values[column][name][:, count], rng=rng)
                for column in _COLUMNS
            }
            cells = " | ".join(map(str, means.values()))
            lines.append(f"| {name} | {count} | {cells} |")
            found[name][str(count)] = {
                column: mean.value for column, mean in means.items()
            }
    if last:
        lines += _tell_ratios(values, found, last, rng=rng)
    study.write_summary(found, driver=config.driver, num_samples=config.num_samples)
    draw_means(
        study,
        values["collisions"],
        ylabel="collisions in 1 000 steps",
        xlabel=f"steps, or answers, after {config.num_shown} steps",
        who=f"{config.driver} driver, ",
    )
    return lines


def _tell_ratios(
    values: Mapping[str, Mapping[str, Array]],
    found: dict[str, dict[str, Any]],
    last: int,
    *,
    rng: np.random.Generator,
) -> list[str]:
    """Compare the riskiest states with those at first, and `active-var` with the others."""
    lines = []
    for name, each in values["riskiest_probability"].items():
        if not each[:, 0].any():
            continue  # The driver is never in them.
        ratio = estimate_ratio(each[:, last], each[:, 0], rng=rng)
        found[name]["probability_by_first"] = vars(ratio)
        lines += [
            "",
            f"Probability after {last} more by that at first, {name}: {ratio}.",
        ]
    others = [name for name in found if name != "active-var"]
    if "active-var" not in found:
        return lines
    for first, rounds in ((1, "all rounds"), (last // 2 + 1, "the second half")):
        for column in ("collisions", "policy_loss"):
            areas = {
                name: each[:, first:].sum(axis=1)
                for name, each in values[column].items()
            }
            for name in others:
                if areas[name].any():
                    ratio = estimate_ratio(areas["active-var"], areas[name], rng=rng)
                    key = f"{column}_by_{name}, {rounds}"
                    found["active-var"][key] = vars(ratio)
                    what = column.replace("_", " ")
                    lines += [
                        "",
                        f"Sum of {what} over {rounds}, active-var by {name}: {ratio}.",
                    ]
    return lines


def _mean_of(column: str, values: Array, *, rng: np.random.Generator) -> Estimate:
    if column == "riskiest_probability":
        values = 100.0 * values  # In percent.
    return estimate(values, rng=rng)["mean"]
