"""What the arm was doing when, as bars of one colour per phase."""

from collections.abc import Callable, Sequence
from itertools import cycle

import rerun as rr

from tablesetting.irl.arrays import Array
from tablesetting.recording.entities import PHASE

# Neighbours differ in hue and lightness.
_COLORS = (
    (31, 119, 180),
    (255, 187, 80),
    (44, 140, 60),
    (240, 128, 128),
    (110, 70, 170),
    (80, 200, 210),
    (170, 90, 50),
    (190, 200, 70),
)


def send_phases(
    stream: rr.RecordingStream,
    phases: Sequence[str],
    times: Array,
    indexes: Callable[[Array], list[rr.TimeColumn]],
) -> None:
    """Send the phases of an episode of T moments; they end at the stream's time.

    Args:
        stream: Where to, set to the end of the episode.
        phases: Phase at each moment, length T.
        times: The moments on the clock of the run, shape (T,), in [s].
        indexes: Makes time columns of some of the moments.
    """
    starts = [k for k, phase in enumerate(phases) if k == 0 or phase != phases[k - 1]]
    columns = rr.StateChange.columns(state=[phases[k] for k in starts])
    stream.send_columns(PHASE, indexes(times[starts]), columns)
    stream.log(PHASE, rr.StateChange.from_fields(clear_unset=True))


def log_colors(stream: rr.RecordingStream, phases: Sequence[str]) -> None:
    """Give each phase its colour, in the order in which they first occurred."""
    colors = [color for _, color in zip(phases, cycle(_COLORS), strict=False)]
    stream.log(PHASE, rr.StateConfiguration(values=phases, colors=colors), static=True)
