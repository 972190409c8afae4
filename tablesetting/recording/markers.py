"""Marks on the table: where was demonstrated, planned, commanded and settled."""

from dataclasses import dataclass

import numpy as np
import rerun as rr

from tablesetting.irl.arrays import Array
from tablesetting.recording import entities

_RING_HEIGHT = 0.004  # [m] above the table, so that the reward map does not hide it.
_NAME_HEIGHT = 0.10  # [m], over most objects, under the markers' labels.
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 49)


@dataclass(frozen=True)
class Marker:
    """A ring on the table and a labelled pin, seen above whatever stands there."""

    path: str
    label: str
    color: tuple[int, int, int]
    radius: float
    """Radius of the ring, in [m]; they differ, so that equal places stay visible."""
    height: float
    """Height of the label, in [m]; they differ, so that labels do not overlap."""


WISH = Marker(entities.WISH, "person's wish", (255, 60, 200), 0.052, 0.39)
GUESS = Marker(entities.GUESS, "best guess", (255, 255, 255), 0.046, 0.34)
RIVAL = Marker(entities.RIVAL, "rival", (70, 200, 255), 0.058, 0.44)
COMMANDED = Marker(entities.COMMANDED, "commanded", (255, 150, 30), 0.040, 0.29)
SETTLED = Marker(entities.SETTLED, "settled", (255, 95, 85), 0.034, 0.24)
MARKERS = (WISH, GUESS, RIVAL, COMMANDED, SETTLED)

_SAMPLE_HEIGHT = 0.003  # [m], between the reward map and the rings.


def log_marker(stream: rr.RecordingStream, marker: Marker, position: Array) -> None:
    """Put a marker at a world position, shape (2,), in [m]."""
    circle = marker.radius * np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
    ring = np.column_stack([position + circle, np.full(len(_ANGLES), _RING_HEIGHT)])
    foot, head = [*position, _RING_HEIGHT], [*position, marker.height]
    lines = rr.LineStrips3D(
        [ring, [foot, head]], colors=marker.color, radii=rr.Radius.ui_points(1.5)
    )
    pin = rr.Points3D(
        [head], colors=marker.color, radii=rr.Radius.ui_points(4.0), labels=marker.label
    )
    stream.log(f"{marker.path}/lines", lines)
    stream.log(f"{marker.path}/pin", pin)


def clear_markers(stream: rr.RecordingStream) -> None:
    """Take all markers away."""
    for marker in MARKERS:
        stream.log(marker.path, rr.Clear(recursive=True))


def log_samples(stream: rr.RecordingStream, positions: Array) -> None:
    """Strew the placements of the posterior, world positions (M, 2), in [m]."""
    raised = np.column_stack([positions, np.full(len(positions), _SAMPLE_HEIGHT)])
    points = rr.Points3D(raised, colors=RIVAL.color, radii=rr.Radius.ui_points(1.5))
    stream.log(entities.SAMPLES, points)


def log_object_names(
    stream: rr.RecordingStream, positions: Array, names: tuple[str, ...]
) -> None:
    """Write each object's name above its place, world positions (K, 2), in [m]."""
    above = np.column_stack([positions, np.full(len(positions), _NAME_HEIGHT)])
    points = rr.Points3D(
        above, labels=names, colors=(235, 235, 235), radii=rr.Radius.ui_points(1.0)
    )
    stream.log(entities.OBJECT_NAMES, points)
