import shutil
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from sample_run import round_view

from tablesetting.errors import InvalidFile
from tablesetting.recording import ExecutionView
from tablesetting.recording.story import end_of_round, tell
from tablesetting.recording.text import round_markdown
from tablesetting.scene.table import TableFrame


def test_the_story_has_the_run_its_rounds_and_its_outcome(recorded: Path):
    story = tell(recorded)
    for words in (
        "# Task vase",
        "| strategy | active-var |",
        "| seed | 7 |",
        "| var_bound | 0.1 |",
        "| demonstrations | mean error | largest error | error here | bound | execution error [mm] |",
        "| mujoco | 3.17.0 |",
        "# After 1 demonstration\n",
        "# After 2 demonstrations\n",
        "Asked here because candidate 1 is the worst.",
        "Bound over the deployment inf, value at risk in the worst candidate 0.200, "
        "placement error on test layouts: mean 0.100, max 0.300",
        "Person's wish (0.500, 0.600): learning error 50.0 mm",
        "settled (0.500, 0.502): execution error 1.00 mm, success",
        "Phases: reach 0.10 s, lift 0.08 s",
    ):
        assert words in story
    assert "interrupted" not in story


def test_a_failure_is_told_with_its_reason():
    execution = ExecutionView(np.array([0.5, 0.5]), None, "lift: the item slipped")
    text = round_markdown(round_view(), TableFrame(), execution)
    assert "- Commanded (0.500, 0.500), failed: lift: the item slipped" in text


def test_a_missing_recording_is_named(tmp_path):
    with pytest.raises(InvalidFile, match=r"no recording at .*nowhere\.rrd"):
        tell(tmp_path / "nowhere.rrd")


@pytest.mark.parametrize("content", [b"", b"not a recording", b"RRF2" + bytes(100)])
def test_another_kind_of_file_is_refused(tmp_path, content):
    path = tmp_path / "other.rrd"
    path.write_bytes(content)
    with pytest.raises(InvalidFile, match=r"other\.rrd is no recording, or a damaged"):
        tell(path)


def test_a_recording_that_is_cut_off_inside_a_message_is_refused(recorded, tmp_path):
    path = tmp_path / "short.rrd"
    shutil.copy(recorded, path)
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 2)
    with pytest.raises(InvalidFile, match=r"short\.rrd is no recording, or a damaged"):
        tell(path)


def test_a_recording_of_something_else_is_refused(tmp_path):
    path = tmp_path / "else.rrd"
    stream = rr.RecordingStream("something_else")
    stream.save(path)
    stream.log("point", rr.Points3D([[0.0, 0.0, 0.0]]))
    stream.flush()
    stream.disconnect()
    with pytest.raises(InvalidFile, match="does not record a run"):
        tell(path)


def test_a_round_is_told_alone_and_its_end_is_known(recorded: Path):
    story = tell(recorded)
    first, second = tell(recorded, 1), tell(recorded, 2)
    assert first in story
    assert first.startswith("# After 1 demonstration\n")
    assert second.startswith("# After 2 demonstrations\n")
    assert 0.0 < end_of_round(recorded, 1) < end_of_round(recorded, 2)
    for look in (tell, end_of_round):
        with pytest.raises(InvalidFile, match=r"no round after 9 .*after 1, 2"):
            look(recorded, 9)
