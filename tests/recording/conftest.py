from collections.abc import Iterator
from pathlib import Path

import mujoco
import pytest
import rerun as rr
from sample_run import CARD, EXECUTION, XML, episode, round_view

from tablesetting.recording import RunRecorder


@pytest.fixture(autouse=True)
def _strict() -> Iterator[None]:
    """Rerun swallows errors unless told not to."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


@pytest.fixture(scope="session")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


@pytest.fixture
def recorded(model: mujoco.MjModel, tmp_path: Path) -> Path:
    """A run of two rounds; the arm acts in both."""
    path = tmp_path / "recording.rrd"
    with RunRecorder(path, model, CARD, recording_id="a-run") as recorder:
        for num_demos in (1, 2):
            recorder.log_round(round_view(num_demos))
            for _ in recorder.record(episode(model)):
                pass
            recorder.log_execution(EXECUTION)
        recorder.log_summary({"stopped": "epsilon", "var_bound": 0.1})
    return path
