"""A drive, and what was learned from it, as a Rerun recording."""

from collections.abc import Sequence
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from gridworld_bench.drives import Drive
from gridworld_bench.experiments.driving_figure import NUM_DRAWN
from gridworld_bench.experiments.driving_view import View
from gridworld_bench.highway import ACTIONS, Highway
from gridworld_bench.road_picture import Picture, draw_road

_TIMELINE = "step"


def record_driving(path: Path, driven: Drive, views: Sequence[View]) -> None:
    """Write the drive step by step, and each view after its last step.

    Args:
        path: The file.
        driven: The steps that were learned from.
        views: What was known after some steps and answers; an answer counts as a step.
    """
    stream = rr.RecordingStream(
        "gridworld-bench",
        recording_id=f"driving-{driven.driver}",
        send_properties=False,
    )
    stream.set_log_time_enabled(False)
    stream.save(path, default_blueprint=_blueprint())
    highway = driven.highway
    try:
        for k, (state, action) in enumerate(
            zip(driven.states, driven.actions, strict=True)
        ):
            stream.set_time(_TIMELINE, sequence=k)
            image = draw_road(highway.situations[state], highway.length, k)
            stream.log("drive", _compressed(image))
            stream.log("action", rr.TextDocument(f"{driven.driver}: {ACTIONS[action]}"))
        for view in views:
            stream.set_time(_TIMELINE, sequence=view.num_steps + view.num_queries)
            _log_view(stream, highway, view)
    finally:
        stream.flush()
        stream.disconnect()


def _log_view(stream: rr.RecordingStream, highway: Highway, view: View) -> None:
    for rank, state in enumerate(view.riskiest.states[:NUM_DRAWN]):
        image = draw_road(highway.situations[state], highway.length)
        stream.log(f"riskiest/{rank + 1}", _compressed(image))
    stream.log("var", rr.Scalars(float(view.riskiest.var[0])))
    stream.log("collisions", rr.Scalars(float(view.record.collisions)))
    if view.asked is not None and view.answer is not None:
        image = draw_road(highway.situations[view.asked], highway.length)
        stream.log("query", _compressed(image))
        stream.log("answer", rr.TextDocument(ACTIONS[view.answer]))


def _compressed(image: Picture) -> rr.Image | rr.EncodedImage:
    return rr.Image(image).compress(jpeg_quality=90)


def _blueprint() -> rrb.Blueprint:
    riskiest = [
        rrb.Spatial2DView(name=f"riskiest {rank}", origin=f"riskiest/{rank}")
        for rank in range(1, NUM_DRAWN + 1)
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial2DView(name="drive", origin="drive"),
                rrb.TextDocumentView(name="action", origin="action"),
                row_shares=[5, 1],
            ),
            rrb.Vertical(
                rrb.Horizontal(*riskiest),
                rrb.Horizontal(
                    rrb.Vertical(
                        rrb.Spatial2DView(name="query", origin="query"),
                        rrb.TextDocumentView(name="answer", origin="answer"),
                        row_shares=[5, 1],
                    ),
                    rrb.TimeSeriesView(name="0.95-VaR", origin="var"),
                    rrb.TimeSeriesView(name="collisions", origin="collisions"),
                ),
            ),
            column_shares=[1, 3],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=_TIMELINE, state="collapsed"),
    )
