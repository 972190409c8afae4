"""Figures of a run: rows or arrays in, a matplotlib Figure out; nothing is shown."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tablesetting.results import numbers

Array = npt.NDArray[np.float64]

_MEAN, _MAX, _BOUND = "#1b6ca8", "#d1495b", "#3c3c3c"
_MARKERS = (("X", "#1b6ca8"), ("P", "#d1495b"), ("D", "#f28e2b"))


def plot_learning(rows: Sequence[Mapping[str, str]], title: str) -> Figure:
    """Draw error and bound over the number of demonstrations.

    Args:
        rows: Rows of a rounds.csv.
        title: What was learned.

    Returns:
        The figure; its vertical axis is in table units.
    """
    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.subplots()
    num_demos = numbers(rows, "num_demos")
    for column, color, style, label in (
        ("var_bound", _BOUND, "--", "0.95-VaR, worst candidate"),
        ("max_placement_error", _MAX, "-", "largest error, test layouts"),
        ("mean_placement_error", _MEAN, "-", "mean error, test layouts"),
    ):
        values = numbers(rows, column)
        axes.plot(num_demos, values, style, color=color, marker="o", ms=4, label=label)
    axes.set(
        xlabel="demonstrations",
        ylabel="placement error [table units]",
        title=title,
        ylim=(0.0, None),
    )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)
    return figure


def plot_query(
    reward_map: Array,
    outlines: Mapping[str, Array],
    marked: Mapping[str, Array],
    title: str,
) -> Figure:
    """Draw the reward map of one query with both placements on it.

    Args:
        reward_map: Reward on a lattice that spans the unit square, shape (n, n); rows
            from y = 0 up.
        outlines: Points around each object, shape (S, 2), in table units; a single
            one for an object that is a point.
        marked: Up to three places to mark, by what they are.
        title: Which query.

    Returns:
        The figure.
    """
    figure = Figure(figsize=(5.4, 4.8), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(
        reward_map, origin="lower", extent=(0, 1, 0, 1), cmap="viridis", alpha=0.9
    )
    figure.colorbar(image, ax=axes, label="MAP reward")
    for name, outline in outlines.items():
        axes.plot(*outline.T, "o" if len(outline) == 1 else "-", color="white", lw=1.5)
        axes.annotate(
            name, outline.mean(axis=0), color="white", fontsize=9, ha="center"
        )
    for (name, place), (marker, color) in zip(marked.items(), _MARKERS, strict=False):
        axes.plot(*place, marker, color=color, mec="white", ms=12, label=name)
    axes.set(
        xlabel="x [table units]",
        ylabel="y, away from the robot [table units]",
        title=title,
        xlim=(-0.12, 1.12),
        ylim=(-0.12, 1.12),
        facecolor="#8a8f98",
    )
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure
