"""How long the whole of a query takes, and whether two chains ask the same."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from gridworld_bench.experiments.config import TimingConfig
from gridworld_bench.experiments.results import FIGURE, losses_of
from gridworld_bench.experiments.study import Study
from tablesetting.results import Row

_PUBLISHED = {"active-var": 0.0101, "random": 0.0015, "arc": 865.6993}
"""Seconds, by the table beside Figure 3 of the paper."""


def tell_seconds(study: Study, rows: Sequence[Row]) -> list[str]:
    """Tell the seconds of a query: candidates, losses and scores, strategy by strategy."""
    config = study.config
    assert isinstance(config, TimingConfig)
    lines = [
        f"# {config.name}: preset {config.preset}, seed {config.seed}, "
        f"{config.num_trials} trials of {config.num_queries + 1} queries",
        "",
        "Seconds of the whole query, after the inference, which all share. The paper's "
        "active-var leaves out the losses, its arc is faithful. Agreement: rank "
        "correlation of the gains by two chains, mean and range; arc-faithful has "
        f"{config.num_samples} samples in each.",
        "",
        "| strategy | median [s] | paper [s] | inference [s] | agreement |",
        "|---|---|---|---|---|",
    ]
    found = {}
    for name in config.strategies:
        seconds = float(np.median(losses_of(rows, config, "query_seconds")[name]))
        inference = float(np.median(losses_of(rows, config, "inference_seconds")[name]))
        alike = losses_of(rows, config, "agreement")[name]
        told = ""
        if np.isfinite(alike).all():
            told = f"{alike.mean():.2f} ({alike.min():.2f} to {alike.max():.2f})"
        published = _PUBLISHED.get(name.removesuffix("-faithful"), "")
        lines.append(
            f"| {name} | {seconds:.4f} | {published} | {inference:.3f} | {told} |"
        )
        found[name] = {
            "query_seconds": seconds,
            "inference_seconds": inference,
            "mean_agreement": float(alike.mean()) if told else None,
        }
    study.write_summary(found, num_samples=config.num_samples)
    _draw(study, {name: each["query_seconds"] or 0.0 for name, each in found.items()})
    return lines


def _draw(study: Study, seconds: dict[str, float]) -> None:
    figure = Figure(figsize=(6.4, 0.8 + 0.45 * len(seconds)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(seconds))
    axes.barh(places, list(seconds.values()), color="#1b6ca8", label="ours")
    published = {
        place: _PUBLISHED[name.removesuffix("-faithful")]
        for place, name in enumerate(seconds)
        if name.removesuffix("-faithful") in _PUBLISHED
    }
    axes.plot(
        list(published.values()), list(published), "D", color="#d1495b", label="paper"
    )
    axes.set(xscale="log", xlabel="seconds of a query", yticks=places)
    axes.set_yticklabels(list(seconds))
    axes.invert_yaxis()
    axes.legend(frameon=False)
    study.folder.write(FIGURE, figure.savefig)
