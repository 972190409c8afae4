"""Figures of a run: rows or arrays in, a matplotlib Figure out; nothing is shown."""

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle, product

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tablesetting.curves import CurveKey, Curves
from tablesetting.results import numbers

Array = npt.NDArray[np.float64]

_MEAN, _MAX, _BOUND = "#1b6ca8", "#d1495b", "#3c3c3c"
_STRATEGIES = (_MEAN, "#f28e2b", "#59a14f", "#8e5ea2", "#7f7f7f")
_STYLES = ("o-", "s-.", "^:")  # The next where all colours are used up.
_LETTERS_PER_INCH = 12  # Of a title.
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
        ("deployment_bound", _BOUND, "-", "bound over the deployment"),
        ("var_bound", _BOUND, "--", "0.95-VaR, worst candidate"),
        ("max_placement_error", _MAX, "-", "largest error, test layouts"),
        ("mean_placement_error", _MEAN, "-", "mean error, test layouts"),
        ("prediction_error", _MEAN, "-", "error at the next demonstration"),
    ):
        if column not in rows[0]:
            continue
        values = np.array(numbers(rows, column))
        axes.plot(num_demos, values, style, color=color, marker="o", ms=4, label=label)
        is_infinite = np.isinf(values)
        if is_infinite.any():
            axes.plot(
                np.array(num_demos)[is_infinite],
                np.full(is_infinite.sum(), 0.97),
                "^",
                color=color,
                transform=axes.get_xaxis_transform(),
                label=f"{label}: none",
            )
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
    figure.colorbar(image, ax=axes, label="reward of the best guess")
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
        xlim=(-0.25, 1.25),
        ylim=(-0.25, 1.25),
        facecolor="#8a8f98",
    )
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def plot_placement_study(ours: Curves, published: Curves, title: str) -> Figure:
    """Draw the paper's figure of the table task, its own curves behind ours.

    Above, for each task, the mean error of every strategy; below, mean and largest error
    and the bound of the first one. Bars are half a standard deviation over the trials.

    Args:
        ours: Curves of mean_placement_error, max_placement_error and var_bound.
        published: Curves of the paper, of the same names.
        title: The settings.

    Returns:
        The figure, with a column of two panels for each task.
    """
    tasks = list(dict.fromkeys(key.task for key in ours))
    strategies = list(dict.fromkeys(key.strategy for key in ours))
    figure = Figure(figsize=(2.8 + 4.2 * len(tasks), 7.2), layout="constrained")
    panels = figure.subplots(2, len(tasks), sharex=True, squeeze=False)
    for column, task in enumerate(tasks):
        upper, lower = panels[:, column]
        looks = cycle(product(_STYLES, _STRATEGIES))
        for strategy, (style, color) in zip(strategies, looks, strict=False):
            key = CurveKey(task, strategy, "mean_placement_error")
            _draw_both(upper, key, strategy, color, ours, published, style)
        for quantity, color, label in (
            ("var_bound", _BOUND, "0.95-VaR bound"),
            ("max_placement_error", _MAX, "largest error"),
            ("mean_placement_error", _MEAN, "mean error"),
        ):
            key = CurveKey(task, strategies[0], quantity)
            _draw_both(lower, key, f"{strategies[0]}, {label}", color, ours, published)
        upper.set(title=f"place {task}", ylabel="mean placement error [table units]")
        lower.set(xlabel="demonstrations", ylabel="placement error [table units]")
        for axes in (upper, lower):
            axes.set_ylim(0.0, None)
            axes.margins(x=0.03)
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            axes.grid(alpha=0.3)
    for axes in panels[:, -1]:  # The colours are the same in every column.
        axes.legend(
            frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5)
        )
    _write_title(figure, title)
    return figure


def plot_strategies(
    ours: Curves, published: Curves, title: str, xlabel: str, ylabel: str
) -> Figure:
    """Draw a curve for each strategy, the published ones behind.

    Args:
        ours: Curves of one task and quantity.
        published: Curves of the paper, of the same names.
        title: The settings.
        xlabel: What the curves are over.
        ylabel: What they are of.

    Returns:
        The figure; bars are half a standard deviation over the trials.
    """
    figure = Figure(figsize=(7.4, 4.2), layout="constrained")
    axes = figure.subplots()
    looks = cycle(product(_STYLES, _STRATEGIES))
    for key, (style, color) in zip(ours, looks, strict=False):
        _draw_both(axes, key, key.strategy, color, ours, published, style)
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.set_ylim(0.0, None)
    axes.margins(x=0.03)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    _write_title(figure, title)
    return figure


def plot_calibration(
    points: Sequence[tuple[str, int, float, float, float]],
    promised: float,
    title: str,
) -> Figure:
    """Draw how often the bound held, for each kind of people.

    Args:
        points: Kind, number of demonstrations, share of the losses within the bound, and
            an interval of it.
        promised: The least share that was promised.
        title: The settings.

    Returns:
        The figure, with a panel for each kind.
    """
    kinds = list(dict.fromkeys(kind for kind, *_ in points))
    num_columns = min(len(kinds), 3)
    num_rows = -(-len(kinds) // num_columns)
    size = (3.4 * num_columns, 0.7 + 2.5 * num_rows)
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(
        num_rows, num_columns, sharex=True, sharey=True, squeeze=False
    )
    for axes in panels.flat[len(kinds) :]:
        axes.set_axis_off()
    bottom = min(0.5, 0.95 * min(min(share, low) for *_, share, low, _ in points))
    for kind, axes in zip(kinds, panels.flat, strict=False):
        own = np.array([point[1:] for point in points if point[0] == kind])
        num_demos, share, low, high = own.T
        axes.fill_between(num_demos, low, high, color=_STRATEGIES[0], alpha=0.2, lw=0.0)
        axes.plot(num_demos, share, "o-", color=_STRATEGIES[0], ms=3.5, lw=1.2)
        axes.axhline(promised, color="black", ls=":", lw=1.0)
        axes.set(title=kind, ylim=(bottom, 1.01))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(alpha=0.3)
    for axes in panels[-1]:
        axes.set_xlabel("demonstrations")
    for axes in panels[:, 0]:
        axes.set_ylabel("losses within the bound")
    _write_title(figure, title)
    return figure


def plot_execution(rows: Sequence[Mapping[str, str]], title: str) -> Figure:
    """Draw how exactly the arm placed things, and where.

    Args:
        rows: Rows of the rounds.csv of an execution study that ask for what can be done.
        title: The settings.

    Returns:
        The figure: first the distribution of the errors, then a map of them for each
        task and goal, with crosses where there was no success.
    """
    kinds = list(dict.fromkeys((row["task"], row["goal"]) for row in rows))
    num_panels = 1 + len(kinds)
    figure = Figure(figsize=(1.2 + 3.4 * num_panels, 3.8), layout="constrained")
    first, *maps = figure.subplots(1, num_panels, squeeze=False)[0]
    done = [row for row in rows if row["error_mm"]]
    scale = LogNorm(*_range_of_errors(numbers(done, "error_mm")))
    for (kind, color), axes in zip(
        zip(kinds, cycle(_STRATEGIES), strict=False), maps, strict=True
    ):
        own = [row for row in rows if (row["task"], row["goal"]) == kind]
        own_done = [row for row in own if row["error_mm"]]
        errors = np.sort(numbers(own_done, "error_mm"))
        shares = np.arange(1, len(errors) + 1) / max(len(errors), 1)
        first.step(errors, shares, where="post", color=color, label=", ".join(kind))
        points = axes.scatter(
            numbers(own_done, "x"),
            numbers(own_done, "y"),
            c=np.maximum(numbers(own_done, "error_mm"), scale.vmin or 0.0),
            norm=scale,
            s=14.0,
        )
        _cross_out([row for row in own if row["success"] != "1"], axes)
        axes.set(
            title=", ".join(kind),
            xlabel="x [table units]",
            xlim=(-0.05, 1.05),
            ylim=(-0.05, 1.05),
            aspect="equal",
        )
    if maps:
        maps[0].set_ylabel("y, away from the robot [table units]")
        figure.colorbar(points, ax=maps[-1], label="error [mm]")
        first.set_xscale("log")
        first.legend(frameon=False, loc="lower right")
    first.set(xlabel="error [mm]", ylabel="share of the placements", ylim=(0.0, 1.02))
    first.grid(alpha=0.3)
    _write_title(figure, title)
    return figure


def _range_of_errors(errors: Sequence[float]) -> tuple[float, float]:
    """Span a logarithmic scale over errors, in [mm]."""
    least = max(min(errors, default=0.01), 1e-3)
    return least, max(max(errors, default=1.0), 2.0 * least)


def _cross_out(rows: Sequence[Mapping[str, str]], axes: Axes) -> None:
    if rows:
        axes.plot(numbers(rows, "x"), numbers(rows, "y"), "x", color=_MAX, ms=9, mew=2)


def _draw_both(
    axes: Axes,
    key: CurveKey,
    label: str,
    color: str,
    ours: Curves,
    published: Curves,
    style: str = "o-",
) -> None:
    """Draw a curve with its bars, and behind it the published one with its band."""
    if key in published:
        curve = published[key]
        low, high = curve.means - curve.half_stds, curve.means + curve.half_stds
        axes.fill_between(curve.num_demos, low, high, color=color, alpha=0.15, lw=0.0)
        axes.plot(
            curve.num_demos,
            curve.means,
            "--",
            color=color,
            alpha=0.6,
            label=f"{label} (paper)",
        )
    if key in ours:
        curve = ours[key]
        axes.errorbar(
            curve.num_demos,
            curve.means,
            curve.half_stds,
            fmt=style,
            color=color,
            label=label,
            ms=3.5,
            lw=1.2,
            elinewidth=0.8,
            capsize=2.0,
        )


def _write_title(figure: Figure, title: str) -> None:
    """Write the title of a study in as many lines as the figure's width asks for."""
    width = int(_LETTERS_PER_INCH * figure.get_figwidth())
    figure.suptitle(textwrap.fill(title, width), fontsize=10)


@dataclass(frozen=True)
class WorstLayout:
    """A test layout in which learned weights were far off.

    Attributes:
        name: Which one, and how far.
        outlines: Points around each object, shape (S, 2), in table units.
        wanted: Where the item is wanted, shape (2,).
        robot: Where the robot wants it, shape (2,).
    """

    name: str
    outlines: Mapping[str, Array]
    wanted: Array
    robot: Array


def plot_validation(
    wanted: Array,
    validated: Sequence[tuple[str, Array, Array, Sequence[WorstLayout]]],
    title: str,
) -> Figure:
    """Draw where on the table learned weights are wrong, and their worst layouts.

    Args:
        wanted: Where the item is wanted in each test layout, shape (L, 2), in table
            units.
        validated: For each weights: a name, where they want it, shape (L, 2), the
            errors, shape (L,), and the worst layouts.
        title: What was tested.

    Returns:
        The figure, with a row of panels for each weights.
    """
    num_columns = 2 + max(max(len(worst) for *_, worst in validated) - 1, 0)
    size = (1.6 + 2.9 * num_columns, 0.9 + 3.3 * len(validated))
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(len(validated), num_columns, squeeze=False)
    # One scale and one window for all: what is compared has to look alike.
    scale = Normalize(
        0.0, max(float(errors.max()) for *_, errors, _ in validated) or 1.0
    )
    places = np.concatenate([wanted, *(placements for _, placements, *_ in validated)])
    for (name, placements, errors, worst), (first, *others) in zip(
        validated, panels, strict=True
    ):
        lines = LineCollection(
            list(np.stack([wanted, placements], axis=1)), colors="0.6", linewidths=0.7
        )
        first.add_collection(lines)
        points = first.scatter(*wanted.T, c=errors, norm=scale, s=14.0, zorder=2)
        figure.colorbar(points, ax=first, label="error [table units]", shrink=0.8)
        first.set_ylabel("y [table units]")
        first.set_title(
            f"{_plain(name)}\nwanted, and lines to the robot's place", fontsize=8
        )
        _frame_square(first)
        _zoom(first, places)
        for axes in others[len(worst) :]:
            axes.set_axis_off()
        for layout, axes in zip(worst, others, strict=False):
            _draw_worst(axes, layout)
        if not worst:
            others[0].text(0.5, 0.5, "no layout has an error", ha="center")
    legends = (axes.get_legend_handles_labels() for axes in panels[:, 1])
    handles, labels = next((each for each in legends if each[0]), ([], []))
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    for axes in panels[-1]:
        axes.set_xlabel("x [table units]")
    _write_title(figure, _plain(title))
    return figure


def _plain(text: str) -> str:
    """Keep what stands between two dollars, as in the name of a file, from being math."""
    return text.replace("$", r"\$")


def _draw_worst(axes: Axes, layout: WorstLayout) -> None:
    for name, outline in layout.outlines.items():
        axes.plot(*outline.T, "o" if len(outline) == 1 else "-", color="0.5", lw=1.2)
        axes.annotate(name, outline.mean(axis=0), fontsize=7, ha="center", color="0.3")
    axes.plot(*np.stack([layout.wanted, layout.robot]).T, color="0.6", lw=0.8)
    axes.plot(*layout.wanted, "P", color=_MAX, mec="white", ms=10, label="wanted")
    axes.plot(
        *layout.robot, "X", color=_MEAN, mec="white", ms=10, label="robot's place"
    )
    axes.set_title(layout.name, fontsize=8)
    _frame_square(axes)


def _zoom(axes: Axes, points: Array) -> None:
    """Show points, shape (S, 2), and some room around them."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.55 * max(float((high - low).max()), 0.2)
    (x, y) = 0.5 * (low + high)
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))


def _frame_square(axes: Axes) -> None:
    """Show the unit square, and what stands out over its edge."""
    axes.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], ":", color="0.7", lw=0.8)
    axes.set(xlim=(-0.2, 1.2), ylim=(-0.2, 1.2), aspect="equal")
    axes.tick_params(labelsize=7)
