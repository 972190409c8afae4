"""Pictures of a recording, drawn by Rerun's own viewer without a display."""

import os
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from rerun.experimental import ViewerClient

from tablesetting.errors import InvalidFile, OutputError
from tablesetting.recording.entities import SIM_TIME
from tablesetting.recording.reading import Recording
from tablesetting.recording.viewer import LOCAL_ONLY, VIEWER, NoViewer

_TIMEOUT = 60.0  # [s]; a software renderer takes about 3.
_POLL = 0.1  # [s]
_STILL = 2.0  # [s]


def screenshot(
    recording: Path,
    output: Path,
    sim_time: float | None = None,
    size: tuple[int, int] = (1600, 1000),
) -> None:
    """Draw a recording as the viewer shows it.

    Args:
        recording: File to show.
        output: PNG file to write.
        sim_time: Moment of the run, in [s]; its end if None.
        size: Width and height, in pixels.

    Raises:
        InvalidFile: If the recording is missing, cannot be read, or is over by then.
        OutputError: If the picture cannot be written.
        NoViewer: If there is no graphics driver, or the viewer does not answer.
    """
    Recording(recording)  # The viewer would show a damaged file as an empty window.
    if not output.parent.is_dir():
        raise OutputError(f"cannot write '{output}': there is no such folder")
    with _headless_viewer(size) as viewer:
        _show(viewer, recording, sim_time)
        picture = _settled_picture(viewer)
    try:
        output.write_bytes(picture)
    except OSError as error:
        raise OutputError(f"cannot write '{output}': {error.strerror}") from error


def complaints(recording: Path, sim_time: float | None = None) -> list[str]:
    """List what the viewer has to complain of, view by view, at a moment of a run.

    Args:
        recording: File to show.
        sim_time: Moment of the run, in [s]; its end if None.

    Raises:
        NoViewer: If there is no graphics driver, or the viewer does not answer.
    """
    with _headless_viewer((800, 600)) as viewer:
        _show(viewer, recording, sim_time)
        _settled_picture(viewer)
        views = viewer.get_state().views
    return [f"{view.name}: {report}" for view in views for report in view.reports]


@contextmanager
def _headless_viewer(size: tuple[int, int]) -> Iterator[ViewerClient]:
    port = _free_port()
    command = [
        str(VIEWER),
        *("--headless", "--hide-welcome-screen", *LOCAL_ONLY),
        *("--port", str(port), "--window-size", f"{size[0]}x{size[1]}"),
    ]
    # As in continuous integration, the viewer sends no usage data.
    env = os.environ | {"WGPU_BACKEND": "vulkan", "RERUN_APP_ONLY": "true", "CI": "1"}
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(command, env=env, stdout=log, stderr=log)
        try:
            yield _connect(process, port, log)
        finally:
            process.kill()
            process.wait()


def _connect(
    process: subprocess.Popen[bytes], port: int, log: IO[bytes]
) -> ViewerClient:
    deadline = time.monotonic() + _TIMEOUT
    while time.monotonic() < deadline and process.poll() is None:
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.get_state()
        except (OSError, RuntimeError):
            time.sleep(_POLL)
        else:
            return client
    log.seek(0)
    if b"adapter" in log.read():
        raise NoViewer(
            "no Vulkan driver to draw with; on Debian `apt-get install "
            "mesa-vulkan-drivers` brings one that needs no graphics card"
        )
    raise NoViewer(f"the Rerun viewer did not answer within {_TIMEOUT:.0f} s")


def _show(viewer: ViewerClient, recording: Path, sim_time: float | None) -> None:
    viewer.open(str(recording.resolve()))
    while (state := viewer.get_state()).loading or not state.recordings:
        time.sleep(_POLL)
    ends = {line.name: line.end for line in state.recordings[0].timelines}
    end = 1e-9 * (ends.get(SIM_TIME) or 0)
    moment = end if sim_time is None else sim_time
    if moment > end:
        raise InvalidFile(f"'{recording}' ends at {end:.2f} s, before {moment:.2f} s")
    viewer.set_time(SIM_TIME, duration=moment, play_state="paused")


def _settled_picture(viewer: ViewerClient) -> bytes:
    """Wait until the picture stands still: data is loaded on demand, notices fade."""
    picture = viewer.take_screenshot()
    deadline = time.monotonic() + _TIMEOUT
    still_since = time.monotonic()
    while still_since + _STILL > time.monotonic() < deadline:
        previous, picture = picture, viewer.take_screenshot()
        if picture != previous:
            still_since = time.monotonic()
    return picture


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
