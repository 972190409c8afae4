"""When a normalised value at risk would stop the questions, and whether rightly."""

from collections.abc import Sequence

import numpy as np

from gridworld_bench.experiments.config import NormalisedStopConfig
from gridworld_bench.experiments.results import FIGURE, losses_of
from gridworld_bench.experiments.study import Study
from tablesetting.curves import Curve, CurveKey, Share
from tablesetting.plotting import plot_strategies
from tablesetting.results import Row

_KINDS = {
    "normalized": "1 - V / V*, the paper's",
    "random_normalized": "(V* - V) / (V* - V of acting at random)",
}


def tell_stops(study: Study, rows: Sequence[Row]) -> list[str]:
    """Count how often the loss is small, as was said, when the questions stop."""
    config = study.config
    assert isinstance(config, NormalisedStopConfig)
    lines = [
        f"# {config.name}: epsilon {config.epsilon:g}, seed {config.seed}, preset "
        f"{config.preset}, {config.num_trials} trials",
        "",
        "Questions stop once the largest normalised 0.95-VaR over the states is below "
        "epsilon. Rightly: the true normalised loss is below epsilon then, in every "
        "state, with a 95 % interval. The paper's normalisation asks for optimal values "
        "that are positive in every sample; rounds without are left out.",
        "",
        "| strategy | normalised by | rounds with it | stopped within "
        f"{config.num_queries} queries | after | rightly |",
        "|---|---|---|---|---|---|",
    ]
    found: dict[str, dict[str, object]] = {}
    for strategy in config.strategies:
        found[strategy] = {}
        for kind, words in _KINDS.items():
            var = losses_of(rows, config, f"{kind}_var")[strategy]
            true = losses_of(rows, config, f"{kind}_loss")[strategy]
            is_below = var < config.epsilon  # Not so where it is missing.
            stopped = np.flatnonzero(is_below.any(axis=1))
            at = is_below.argmax(axis=1)[stopped]
            right = Share.of((true[stopped, at] < config.epsilon).tolist())
            after = f"{at.mean():.1f}" if len(at) else ""
            lines.append(
                f"| {strategy} | {words} | {np.isfinite(var).mean():.0%} | "
                f"{len(stopped)} of {len(var)} | {after} | {right} |"
            )
            found[strategy][kind] = {
                "num_stopped": len(stopped),
                "mean_queries": float(at.mean()) if len(at) else None,
                "num_right": right.count,
            }
    study.write_summary(found, epsilon=config.epsilon)
    _draw(study, rows)
    return lines


def _draw(study: Study, rows: Sequence[Row]) -> None:
    config = study.config
    counts = np.arange(config.num_queries + 1.0)
    curves = {}
    for strategy in config.strategies:
        for column in ("random_normalized_var", "random_normalized_loss"):
            values = losses_of(rows, config, column)[strategy]
            label = "0.95-VaR" if column.endswith("var") else "true loss"
            curves[CurveKey(config.name, f"{strategy}, {label}", column)] = Curve(
                counts, values.mean(axis=0), values.std(axis=0), len(values)
            )
    figure = plot_strategies(
        curves,
        {},
        f"{config.name}: {config.num_trials} trials, seed {config.seed}",
        xlabel="queries",
        ylabel="largest loss, by that of acting at random",
    )
    study.folder.write(FIGURE, figure.savefig)
