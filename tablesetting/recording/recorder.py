"""Records a run as it passes by, for the Rerun viewer."""

from collections.abc import Generator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

import mujoco
import numpy as np
import rerun as rr

from tablesetting.errors import OutputError
from tablesetting.irl.arrays import Array
from tablesetting.recording import entities, geometry, rounds
from tablesetting.recording.blueprint import run_blueprint
from tablesetting.recording.card import log_card, log_summary
from tablesetting.recording.phases import log_colors, send_phases
from tablesetting.recording.text import distance_mm
from tablesetting.recording.views import ExecutionView, RoundView, RunCard
from tablesetting.scene.scene import Snapshot
from tablesetting.scene.table import TableFrame

ResultT = TypeVar("ResultT")

_PAUSE = 1.0  # Between rounds on the clock of the run, in [s].


class RunRecorder:
    """Writes one run to one file, on one clock; a context manager.

    Whatever ends the run, leaving the context completes the file. A process that is
    killed leaves all but its current episode.
    """

    def __init__(
        self,
        path: Path,
        model: mujoco.MjModel,
        card: RunCard,
        *,
        recording_id: str,
        frame: TableFrame | None = None,
    ) -> None:
        """Open the file and log what never changes.

        Args:
            path: File to write, by custom with the suffix ".rrd".
            model: Compiled model whose bodies the snapshots pose.
            card: What is being run.
            recording_id: Tells recordings in one viewer apart; the same run under the
                same id writes the same content, but for the seconds on its card.
            frame: Maps table units to the world; the default table if None.

        Raises:
            OutputError: If the file cannot be written.
        """
        self._model = model
        self._card = card
        self._frame = TableFrame() if frame is None else frame
        self._clock = 0.0
        self._round: RoundView | None = None
        self._rows: list[dict[str, float | None]] = []
        self._episode: list[Snapshot] = []
        self._phases: dict[str, None] = {}  # Ordered by first occurrence.
        self._stream = rr.RecordingStream(
            "tablesetting", recording_id=recording_id, send_properties=False
        )
        self._stream.set_log_time_enabled(False)
        try:
            self._stream.save(path, default_blueprint=run_blueprint(acts=card.acts))
        except (RuntimeError, UnicodeError) as error:
            raise OutputError(f"cannot write the recording: {error}") from error
        log_card(self._stream, card)
        rounds.log_styles(self._stream)
        geometry.log_model(self._stream, model)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Write what is pending and complete the file."""
        try:
            self._send_episode()
            self._flush()
        finally:
            self._stream.disconnect()

    def log_round(self, view: RoundView) -> None:
        """Open a round: show its query, and what is known before the arm acts."""
        if self._round is not None:
            self._clock += _PAUSE
        self._round = view
        self._rows.append(_row_of(view))
        self._set_time()
        rounds.log_round(self._stream, view, self._card.objects, self._frame)
        self._flush()

    def record(
        self, snapshots: Generator[Snapshot, None, ResultT]
    ) -> Generator[Snapshot, None, ResultT]:
        """Pass the snapshots of an episode through; they follow on the run's clock.

        They are sent in one go when the episode ends, or the caller breaks it off.

        Args:
            snapshots: The episode as it happens.

        Yields:
            Each snapshot, untouched.

        Returns:
            What the episode returns.
        """
        try:
            while True:
                snapshot = next(snapshots)
                self._episode.append(snapshot)
                yield snapshot
        except StopIteration as stop:
            return stop.value
        finally:
            self._send_episode()

    def show(self, snapshot: Snapshot) -> None:
        """Show the world as it stands, in a round that the arm does not carry out."""
        self._send_poses([snapshot], np.array([self._clock]))
        self._flush()

    def log_execution(self, execution: ExecutionView) -> None:
        """Show how the arm fared in the round that is open.

        Raises:
            ValueError: If no round is open.
        """
        if self._round is None:
            raise ValueError("`log_execution` needs a round; call `log_round` before")
        self._rows[-1]["execution error [mm]"] = (
            None
            if execution.settled is None
            else distance_mm(self._frame, execution.commanded, execution.settled)
        )
        self._set_time()
        rounds.log_execution(self._stream, self._round, execution, self._frame)
        self._flush()

    def log_summary(self, summary: Mapping[str, object]) -> None:
        """Add the final figures, and the errors of every round, to the run card."""
        log_summary(self._stream, self._card, summary, self._rows)

    def _set_time(self) -> None:
        self._stream.set_time(entities.SIM_TIME, duration=self._clock)
        self._stream.set_time(entities.NUM_DEMOS, sequence=self._num_demos)

    @property
    def _num_demos(self) -> int:
        return 0 if self._round is None else self._round.num_demos

    def _send_episode(self) -> None:
        episode, self._episode = self._episode, []
        if not episode:
            return
        start = self._clock - episode[0].time
        times = np.array([start + snapshot.time for snapshot in episode])
        self._send_poses(episode, times)
        self._clock = float(times[-1])
        self._set_time()
        phases = [snapshot.phase for snapshot in episode]
        send_phases(self._stream, phases, times, self._indexes)
        self._phases.update(dict.fromkeys(phases))
        log_colors(self._stream, list(self._phases))
        self._flush()

    def _flush(self) -> None:
        try:
            self._stream.flush()
        except RuntimeError as error:
            raise OutputError(
                f"cannot write the recording: {error}; is the disk full?"
            ) from error

    def _send_poses(self, snapshots: list[Snapshot], times: Array) -> None:
        geometry.send_poses(
            self._stream,
            self._model,
            self._indexes(times),
            np.stack([snapshot.positions for snapshot in snapshots]),
            np.stack([snapshot.quaternions for snapshot in snapshots]),
        )

    def _indexes(self, times: Array) -> list[rr.TimeColumn]:
        demos = np.full(len(times), self._num_demos)
        return [
            rr.TimeColumn(entities.SIM_TIME, duration=times),
            rr.TimeColumn(entities.NUM_DEMOS, sequence=demos),
        ]


def _row_of(view: RoundView) -> dict[str, float | None]:
    """Return the row of a round in the table of errors."""
    errors = view.placement_errors
    return {
        "demonstrations": view.num_demos,
        "mean error": None if errors is None else float(errors.mean()),
        "largest error": None if errors is None else float(errors.max()),
        "error here": (
            None
            if view.wish is None
            else float(np.linalg.norm(view.robot_placement - view.wish))
        ),
        "bound": view.deployment_bound,
        "execution error [mm]": None,
    }
