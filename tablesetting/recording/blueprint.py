"""How the viewer is arranged when a recording is opened."""

import rerun as rr
import rerun.blueprint as rrb

from tablesetting.recording import entities

_EYE = (0.80, -0.70, 0.90)  # [m], over the robot's right shoulder.
_PHASES_SHOWN = 5.0  # Before and after the moment that is shown, in [s].
_TARGET = (0.01, -0.11, 0.19)  # [m]
_WHOLE_RUN = rr.TimeRange(
    rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.infinite()
)


def run_blueprint(*, acts: bool) -> rrb.Blueprint:
    """Arrange a run: the scene on the left, what was learned on the right.

    Args:
        acts: Whether the arm does, and how it fares is to be seen as well.
    """
    learned = _curves("Bound and error over the test layouts", entities.CURVES)
    arm = [_curves("Execution error", entities.EXECUTION_ERROR), _phases()]
    learning = rrb.Vertical(
        learned,
        _candidates(),
        *(arm if acts else []),
        row_shares=[6, 5, 5, 2] if acts else [1, 1],
    )
    words = rrb.Tabs(
        rrb.TextDocumentView(origin=entities.ROUND_TEXT, name="Round"),
        rrb.TextDocumentView(origin=entities.RUN_CARD, name="Run"),
    )
    guess = rrb.Spatial2DView(origin=entities.GUESS_MAP, name="Reward of the guess")
    rival = rrb.Spatial2DView(origin=entities.RIVAL_MAP, name="Reward of the rival")
    below = rrb.Horizontal(words, guess, rival, column_shares=[3, 2, 2])
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_scene(), below, row_shares=[5, 3]),
            learning,
            column_shares=[3, 2],
        ),
        rrb.TimePanel(
            timeline=entities.SIM_TIME, play_state="paused", state="collapsed"
        ),
        collapse_panels=True,
    )


def _scene() -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=entities.WORLD,
        name="Table, with the guessed reward in the queried layout (yellow is high)",
        background=(232, 235, 240),
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            position=_EYE, look_target=_TARGET, eye_up=(0.0, 0.0, 1.0)
        ),
    )


def _curves(name: str, origin: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(view_range=_WHOLE_RUN),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def _candidates() -> rrb.BarChartView:
    return rrb.BarChartView(
        origin=entities.CANDIDATES,
        name="Value at risk of each candidate layout (orange: asked)",
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _phases() -> rrb.StateTimelineView:
    around_now = rr.TimeRange(
        rr.TimeRangeBoundary.cursor_relative(seconds=-_PHASES_SHOWN),
        rr.TimeRangeBoundary.cursor_relative(seconds=_PHASES_SHOWN),
    )
    return rrb.StateTimelineView(
        origin=entities.PHASE,
        name="Phases of the arm",
        time_view=rrb.TimeAxis(view_range=around_now),
    )
