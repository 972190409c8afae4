"""What a round of learning looks like: reward map, markers, curves, candidates."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import rerun as rr

from tablesetting.irl.arrays import Array
from tablesetting.recording import entities, markers
from tablesetting.recording.maps import log_maps
from tablesetting.recording.text import distance_mm, round_markdown
from tablesetting.recording.views import ExecutionView, RoundView
from tablesetting.scene.table import TableFrame

_MAP_HEIGHT = 0.002  # [m] above the table, clear of z-fighting.
_BAND = (entities.LOW_ERROR, entities.HIGH_ERROR)
_GREY, _ORANGE = (140, 146, 158), (255, 150, 30)
_CURVES = {
    entities.DEPLOYMENT_BOUND: ("bound over deployment [table units]", (90, 130, 255)),
    entities.VAR_BOUND: ("VaR, worst candidate [table units]", (165, 140, 200)),
    entities.MEAN_ERROR: ("mean error [table units]", (60, 190, 110)),
    entities.MAX_ERROR: ("max error [table units]", (235, 80, 70)),
    entities.LOW_ERROR: ("errors, 10 % [table units]", (150, 215, 180)),
    entities.HIGH_ERROR: ("errors, 90 % [table units]", (150, 215, 180)),
    entities.EXECUTION_ERROR: ("execution error [mm]", _ORANGE),
}
_ERRORS: Final[Mapping[str, Callable[[Array], float]]] = {
    entities.MEAN_ERROR: np.mean,
    entities.MAX_ERROR: np.max,
    entities.LOW_ERROR: lambda errors: np.quantile(errors, 0.1),
    entities.HIGH_ERROR: lambda errors: np.quantile(errors, 0.9),
}


def log_styles(stream: rr.RecordingStream) -> None:
    """Name and colour the curves, once for the whole recording."""
    for path, (name, color) in _CURVES.items():
        line = rr.SeriesLines(
            names=name,
            colors=color,
            widths=1.0 if path in _BAND else 2.0,
            interpolation_mode=rr.components.InterpolationMode.StepAfter,
        )
        points = rr.SeriesPoints(
            names=name,
            colors=color,
            markers=rr.components.MarkerShape.Circle,
            marker_sizes=2.0 if path in _BAND else 4.0,
        )
        stream.log(path, line, points, static=True)


def log_round(
    stream: rr.RecordingStream,
    view: RoundView,
    objects: tuple[str, ...],
    frame: TableFrame,
) -> None:
    """Log all that is known when a round opens."""
    _log_reward_map(stream, view.reward_map, frame)
    markers.clear_markers(stream)
    markers.log_object_names(stream, frame.to_world(view.centers), objects)
    markers.log_samples(stream, frame.to_world(view.sampled_placements))
    for marker, place in (
        (markers.GUESS, view.robot_placement),
        (markers.RIVAL, view.rival_placement),
        (markers.WISH, view.wish),
    ):
        if place is not None:
            markers.log_marker(stream, marker, frame.to_world(place))
    log_maps(stream, view, objects)
    stream.log(entities.VAR_BOUND, rr.Scalars(view.var_bound))
    if np.isfinite(view.deployment_bound):
        stream.log(entities.DEPLOYMENT_BOUND, rr.Scalars(view.deployment_bound))
    if view.placement_errors is not None:
        for path, statistic in _ERRORS.items():
            value = float(statistic(view.placement_errors))
            stream.log(path, rr.Scalars(value))
    _log_candidates(stream, view.candidate_var, view.asked)
    _log_text(stream, round_markdown(view, frame))


def log_execution(
    stream: rr.RecordingStream,
    view: RoundView,
    execution: ExecutionView,
    frame: TableFrame,
) -> None:
    """Log how the arm fared, when it has acted."""
    commanded = frame.to_world(execution.commanded)
    markers.log_marker(stream, markers.COMMANDED, commanded)
    if execution.settled is not None:
        settled = frame.to_world(execution.settled)
        markers.log_marker(stream, markers.SETTLED, settled)
        error = distance_mm(frame, execution.commanded, execution.settled)
        stream.log(entities.EXECUTION_ERROR, rr.Scalars(error))
    _log_text(stream, round_markdown(view, frame, execution))


def _log_reward_map(
    stream: rr.RecordingStream, reward_map: Array, frame: TableFrame
) -> None:
    """Lay the reward over the unit square, every pixel centred on its grid point."""
    low, high = reward_map.min(), reward_map.max()
    shades = 255.0 * (reward_map - low) / max(high - low, np.finfo(float).tiny)
    image = np.rint(shades[::-1]).astype(np.uint8)  # A grid map's first row is its top.
    rows, columns = image.shape
    grid = rr.GridMap(
        data=image.tobytes(),
        format=rr.components.ImageFormat(
            width=columns, height=rows, color_model="L", channel_datatype="U8"
        ),
        cell_size=1.0,
        translation=[-0.5, -0.5, 0.0],
        colormap=rr.components.Colormap.Viridis,
    )
    # A pixel is square; the table's cells need not be.
    pose = rr.Transform3D(
        translation=[*frame.to_world(np.zeros(2)), _MAP_HEIGHT],
        scale=[frame.size[0] / (columns - 1), frame.size[1] / (rows - 1), 1.0],
    )
    stream.log(entities.REWARD_MAP, grid, pose)


def _log_candidates(stream: rr.RecordingStream, var: Array, asked: int) -> None:
    others = np.delete(np.arange(len(var)), asked)
    stream.log(
        entities.OTHERS_VAR, rr.BarChart(var[others], abscissa=others, color=_GREY)
    )
    stream.log(
        entities.ASKED_VAR, rr.BarChart(var[[asked]], abscissa=[asked], color=_ORANGE)
    )


def _log_text(stream: rr.RecordingStream, markdown: str) -> None:
    document = rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN)
    stream.log(entities.ROUND_TEXT, document)
