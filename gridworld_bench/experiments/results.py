"""Curves of several strategies beside the published ones."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np

from gridworld_bench.experiments.config import StudyConfig
from gridworld_bench.experiments.study import Study
from tablesetting.bootstrap import Estimate, estimate_ratio
from tablesetting.curves import Curve, CurveKey, mean_curve, read_published
from tablesetting.irl.arrays import Array
from tablesetting.plotting import plot_strategies
from tablesetting.results import Row, RunFolder, numbers

FIGURE = "figures/comparison.png"
QUANTITY = "policy_loss"

_PUBLISHED = Path(__file__).with_name("published.csv")
_PUBLISHED_TRIALS = 100
_AREA = (3, 20)  # Queries, both included, that an area is over.


@cache
def published_curves() -> dict[CurveKey, Curve]:
    """Return the curves of Figures 2 and 3a of Brown, Cui and Niekum (2018).

    The points and error bars, of half a standard deviation, are the plot data in the
    LaTeX source of the paper; the first point is before any query.
    """
    return read_published(_PUBLISHED, _PUBLISHED_TRIALS)


def compare(study: Study, rows: Sequence[Row]) -> list[str]:
    """Compare strategies by their curves, and these with the paper's."""
    config = study.config
    losses = losses_of(rows, config)
    ratios = area_ratios(losses, config)
    seconds = {
        kind: {
            name: float(np.median(each))
            for name, each in losses_of(rows, config, kind).items()
        }
        for kind in ("query_seconds", "inference_seconds")
    }
    _draw(study.folder, losses, config)
    study.write_summary(
        {
            name: {
                "mean_policy_loss": each.mean(axis=0).tolist(),
                "normalized_policy_loss": normalized(each).tolist(),
                "area_ratio": {
                    other: asdict(ratio) for other, ratio in ratios[name].items()
                },
                **{kind: medians[name] for kind, medians in seconds.items()},
            }
            for name, each in losses.items()
        }
    )
    counts: dict[str, dict[str, Array]] = {
        column: losses_of(rows, config, column)
        for column in ("distinct_pairs", "new_pairs")
        if column in config.columns
    }
    return _tell(losses, ratios, seconds, counts, config)


def losses_of(
    rows: Sequence[Row], config: StudyConfig, column: str = QUANTITY
) -> dict[str, Array]:
    """Return a column as shape (trials, queries + 1), for each strategy."""
    shape = (config.num_trials, config.num_queries + 1)
    return {
        strategy: np.reshape(
            numbers([row for row in rows if row["strategy"] == strategy], column), shape
        )
        for strategy in config.strategies
    }


def normalized(losses: Array) -> Array:
    """Return mean losses by their value before the first query, (queries + 1,)."""
    means = losses.mean(axis=0)
    return np.asarray(means / means[0]) if means[0] > 0.0 else means


def area_ratios(
    losses: Mapping[str, Array], config: StudyConfig
) -> dict[str, dict[str, Estimate]]:
    """Compare the area under each strategy's curve with that of each other one.

    Trials are paired: the same worlds are drawn again for both.
    """
    first, last = _AREA
    if config.num_queries < first:
        return {name: {} for name in losses}
    areas = {
        name: each[:, first : last + 1].sum(axis=1) for name, each in losses.items()
    }
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(0, 1)))
    return {
        name: {
            other: estimate_ratio(area, areas[other], rng=rng)
            for other in areas
            if other != name and areas[other].any()
        }
        for name, area in areas.items()
    }


def _tell(
    losses: Mapping[str, Array],
    ratios: Mapping[str, Mapping[str, Estimate]],
    seconds: Mapping[str, Mapping[str, float]],
    counts: Mapping[str, Mapping[str, Array]],
    config: StudyConfig,
) -> list[str]:
    published = published_curves()
    shown = [
        k for k in (0, 1, 2, 3, 5, 7, 9, 11, 12, 15, 20, 24) if k <= config.num_queries
    ]
    lines = [
        f"# {config.name}: preset {config.preset}, seed {config.seed}, "
        f"{config.num_trials} trials",
        "",
        "Mean policy loss after as many queries, by its value before the first. Paper: "
        "the same of the published points.",
        "",
        f"| strategy | {' | '.join(map(str, shown))} |",
        "|---" * (len(shown) + 1) + "|",
    ]
    for name, each in losses.items():
        cells = [f"{value:.3f}" for value in normalized(each)[shown]]
        lines.append(f"| {name} | {' | '.join(cells)} |")
        key = CurveKey(config.name, name, QUANTITY)
        if key in published:
            means = published[key].means
            cells = [
                f"{means[k] / means[0]:.3f}" if k < len(means) else "" for k in shown
            ]
            lines.append(f"| paper: {name} | {' | '.join(cells)} |")
    first, last = _AREA[0], min(_AREA[1], config.num_queries)
    if any(ratios.values()):
        lines += [
            "",
            f"Area under the curve over queries {first} to {last}, as a share of another's, "
            "with 95 % intervals (paired bootstrap):",
            "",
        ]
    for name, others in ratios.items():
        if others:
            told = ", ".join(f"{ratio} of {other}" for other, ratio in others.items())
            lines.append(f"- {name}: {told}")
    header = ["strategy", "query [ms]", "inference [s]", *counts]
    lines += ["", f"| {' | '.join(header)} |", "|---" * len(header) + "|"]
    for name in losses:
        cells = [name, f"{1e3 * seconds['query_seconds'][name]:.1f}"]
        cells += [f"{seconds['inference_seconds'][name]:.3f}"]
        cells += [f"{counted[name].mean():.2f}" for counted in counts.values()]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _draw(folder: RunFolder, losses: Mapping[str, Array], config: StudyConfig) -> None:
    counts = np.arange(config.num_queries + 1.0)
    ours = {}
    for name, each in losses.items():
        scale = float(each[:, 0].mean()) or 1.0
        key = CurveKey(config.name, name, QUANTITY)
        ours[key] = mean_curve(counts, each.T / scale)
    published = {
        key: Curve(
            curve.num_demos,
            curve.means / curve.means[0],
            curve.stds / curve.means[0],
            curve.num_trials,
        )
        for key, curve in published_curves().items()
        if key.task == config.name
    }
    figure = plot_strategies(
        ours,
        published,
        f"{config.name}: {config.num_trials} trials, preset {config.preset}, "
        f"seed {config.seed}",
        xlabel="queries",
        ylabel="mean policy loss, by that before the first",
    )
    folder.write(FIGURE, figure.savefig)


def draw_means(
    study: Study,
    values: Mapping[str, Array],
    *,
    ylabel: str,
    xlabel: str = "queries",
    who: str = "",
) -> None:
    """Draw the figure of a study: means over its trials.

    Args:
        study: The study.
        values: Of each strategy, shape (trials, queries + 1).
        ylabel: What they are.
        xlabel: What is counted.
        who: Words for the title, before the number of trials.
    """
    config = study.config
    counts = np.arange(config.num_queries + 1.0)
    figure = plot_strategies(
        {
            CurveKey(config.name, name, ylabel): mean_curve(counts, each.T)
            for name, each in values.items()
        },
        {},
        f"{config.name}: {who}{config.num_trials} trials, seed {config.seed}",
        xlabel=xlabel,
        ylabel=ylabel,
    )
    study.folder.write(FIGURE, figure.savefig)
