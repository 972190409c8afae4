"""When a value at risk would stop the questions, and whether rightly."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gridworld_bench.experiments.config import NormalisedStopConfig
from gridworld_bench.experiments.results import draw_means, losses_of
from gridworld_bench.experiments.study import Study
from tablesetting.curves import Share
from tablesetting.results import Row


@dataclass(frozen=True)
class _Stop:
    """A measure of the loss: in words, and the columns of its bound and of its truth."""

    words: str
    bound: str
    truth: str


_DRAWN = {
    "random_normalized_var": "0.95-VaR",
    "random_normalized_loss": "true loss",
}
_STOPS = {
    "normalized": _Stop(
        "the optimal value: 1 - V / V*, the paper's",
        "normalized_var",
        "normalized_loss",
    ),
    "random_normalized": _Stop(
        "what acting at random loses: (V* - V) / (V* - V of it)",
        "random_normalized_var",
        "random_normalized_loss",
    ),
    "loss": _Stop("nothing: V* - V", "var", "max_policy_loss"),
}


def tell_stops(study: Study, rows: Sequence[Row]) -> list[str]:
    """Count how often the loss is small, as was said, when the questions stop."""
    config = study.config
    assert isinstance(config, NormalisedStopConfig)
    lines = [
        f"# {config.name}: seed {config.seed}, preset {config.preset}, "
        f"{config.num_trials} trials",
        "",
        "Questions stop once the largest 0.95-VaR over the states is below epsilon. "
        "Rightly: the true loss is below epsilon then, in every state, with a 95 % "
        "interval. The paper's normalisation asks for optimal values that are positive "
        "in every sample; rounds without are left out.",
        "",
        "| strategy | normalised by | epsilon | rounds with it | stopped within "
        f"{config.num_queries} queries | after | rightly |",
        "|---|---|---|---|---|---|---|",
    ]
    found: dict[str, dict[str, object]] = {}
    for strategy in config.strategies:
        found[strategy] = {}
        for kind, stop in _STOPS.items():
            epsilon = config.loss_epsilon if kind == "loss" else config.epsilon
            var = losses_of(rows, config, stop.bound)[strategy]
            true = losses_of(rows, config, stop.truth)[strategy]
            is_below = var < epsilon  # Not so where it is missing.
            stopped = np.flatnonzero(is_below.any(axis=1))
            at = is_below.argmax(axis=1)[stopped]
            right = Share.of((true[stopped, at] < epsilon).tolist())
            after = f"{at.mean():.1f}" if len(at) else ""
            lines.append(
                f"| {strategy} | {stop.words} | {epsilon:g} | {np.isfinite(var).mean():.0%} | "
                f"{len(stopped)} of {len(var)} | {after} | {right} |"
            )
            found[strategy][kind] = {
                "num_stopped": len(stopped),
                "mean_queries": float(at.mean()) if len(at) else None,
                "num_right": right.count,
            }
    study.write_summary(found, epsilon=config.epsilon, loss_epsilon=config.loss_epsilon)
    curves = {
        f"{strategy}, {label}": losses_of(rows, config, column)[strategy]
        for strategy in config.strategies
        for column, label in _DRAWN.items()
    }
    draw_means(study, curves, ylabel="largest loss, by that of acting at random")
    return lines
