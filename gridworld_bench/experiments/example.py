"""What is asked in the small world of Figure 1, and the maps that say why."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gridworld_bench.experiments.config import StudyConfig
from gridworld_bench.experiments.results import FIGURE
from gridworld_bench.experiments.study import Study
from gridworld_bench.experiments.trials import Trial, rounds_of
from gridworld_bench.grid import grid_successors
from gridworld_bench.gridworlds import EXAMPLE
from tablesetting.curves import Share
from tablesetting.irl.arrays import Array
from tablesetting.results import Row

_PAINT = {"w": "white", "y": "#f2d024", "g": "#4caf50", "b": "#4a7fc1"}
_WORDS = {"y": "yellow", "b": "blue"}


def tell_queries(study: Study, rows: Sequence[Row]) -> list[str]:
    """Count next to which color the second query lies, and draw the first seed's maps."""
    config, letters = study.config, "".join(EXAMPLE)
    lines = [
        f"# {config.name}: preset {config.preset}, {config.num_trials} seeds from "
        f"{config.seed}",
        "",
        "Queries are cells, counted row by row from 0. In the paper, the second one of "
        "active-sampling lies next to blue, that of active-var next to yellow.",
        "",
        "| strategy | most frequent queries | second one is next to | in % of the seeds |",
        "|---|---|---|---|",
    ]
    found: dict[str, dict[str, object]] = {}
    for strategy in config.strategies:
        own = [row for row in rows if row["strategy"] == strategy]
        asked = {
            count: [int(row["query"]) for row in own if row["num_queries"] == count]
            for count in ("0", "1")
        }
        common = [max(set(each), key=each.count) for each in asked.values()]
        found[strategy] = {"most_frequent": common}
        for color, word in _WORDS.items():
            share = Share.of(
                [_is_next_to(query, color, letters) for query in asked["1"]]
            )
            lines.append(
                f"| {strategy} | {', '.join(map(str, common))} | {word} | {share} |"
            )
            found[strategy][f"share_next_to_{word}"] = share.value
    study.write_summary(found)
    study.folder.write(FIGURE, draw_maps(config).savefig)
    return lines


def _is_next_to(state: int, color: str, letters: str) -> bool:
    width = len(EXAMPLE[0])
    nexts = grid_successors(len(letters) // width, width)[state, :, 0]
    return any(letters[there] == color for there in nexts if there != state)


def draw_maps(config: StudyConfig) -> Figure:
    """Draw the world and, of each strategy, the scores before both queries."""
    num_maps = config.num_queries + 1
    figure = Figure(
        figsize=(2.6 * (num_maps + 1), 2.4 * len(config.strategies)),
        layout="constrained",
    )
    panels = figure.subplots(len(config.strategies), num_maps + 1, squeeze=False)
    for strategy, (first, *others) in zip(config.strategies, panels, strict=True):
        _paint_world(first)
        first.set_ylabel(strategy)
        rounds = rounds_of(config, Trial(strategy, 0))
        for number, (axes, latest) in enumerate(zip(others, rounds, strict=False)):
            scores = np.full(len(EXAMPLE) * len(EXAMPLE[0]), np.nan)
            scores[[query.start for query in latest.candidates]] = _to_unit(
                latest.scores
            )
            axes.imshow(
                scores.reshape(len(EXAMPLE), -1), cmap="viridis", vmin=0, vmax=1
            )
            row, column = divmod(latest.query.start, len(EXAMPLE[0]))
            axes.plot(column, row, "*", color="#d1495b", mec="white", ms=15)
            axes.set_title(f"query {number + 1}", fontsize=9)
            axes.set(xticks=[], yticks=[])
    figure.suptitle(
        f"{config.name}: scores from 0 to 1, and what is asked (star); seed "
        f"{config.seed}, first trial",
        fontsize=10,
    )
    return figure


def _paint_world(axes: Axes) -> None:
    for row, letters in enumerate(EXAMPLE):
        for column, letter in enumerate(letters):
            axes.fill(
                column + np.array([-0.5, 0.5, 0.5, -0.5]),
                row + np.array([-0.5, -0.5, 0.5, 0.5]),
                facecolor=_PAINT[letter],
                edgecolor="0.4",
            )
    axes.set(
        xlim=(-0.5, len(EXAMPLE[0]) - 0.5),
        ylim=(len(EXAMPLE) - 0.5, -0.5),
        aspect="equal",
        xticks=[],
        yticks=[],
    )


def _to_unit(scores: Array) -> Array:
    spread = float(np.ptp(scores))
    return (scores - scores.min()) / spread if spread > 0.0 else np.zeros(len(scores))
