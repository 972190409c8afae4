"""The riskiest situations as pictures: Figure 4 of the paper."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from gridworld_bench.experiments.driving_view import View
from gridworld_bench.highway import Highway
from gridworld_bench.road_picture import draw_road

NUM_DRAWN = 5


def draw_riskiest(highway: Highway, views: Sequence[View]) -> Figure:
    """Draw the riskiest sampled situations, a row for each number of driven steps.

    Args:
        highway: The road.
        views: What is known after some steps and answers; of those after answers, the
            last is drawn.

    Returns:
        The figure.
    """
    shown = [view for view in views if not view.num_queries]
    if views[-1].num_queries:
        shown.append(views[-1])
    figure = Figure(figsize=(1.5 * NUM_DRAWN, 2.8 * len(shown)), layout="constrained")
    panels = figure.subplots(len(shown), NUM_DRAWN, squeeze=False)
    for view, row in zip(shown, panels, strict=True):
        answers = f", {view.num_queries} answers" if view.num_queries else ""
        row[0].set_ylabel(f"{view.num_steps} steps{answers}")
        for axes in row:
            axes.set(xticks=[], yticks=[])
        for axes, state, var in zip(
            row, view.riskiest.states, view.riskiest.var, strict=False
        ):
            axes.imshow(draw_road(highway.situations[state], highway.length))
            axes.set_title(f"VaR {var:.3f}", fontsize=9)
    figure.suptitle(
        "The riskiest of the sampled situations; the driver is red", fontsize=10
    )
    return figure
