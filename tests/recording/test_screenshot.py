from dataclasses import replace
from pathlib import Path

import matplotlib.image
import pytest
from sample_run import CARD, episode, round_view

from tablesetting.errors import InvalidFile
from tablesetting.recording import RunRecorder
from tablesetting.recording.screenshot import complaints, screenshot
from tablesetting.recording.viewer import NoViewer


def test_a_picture_shows_the_run(recorded: Path, tmp_path):
    output = tmp_path / "picture.png"
    try:
        screenshot(recorded, output, sim_time=0.1, size=(800, 600))
    except NoViewer as error:
        pytest.skip(str(error))
    picture = matplotlib.image.imread(output)
    assert picture.shape[:2] == (600, 800)
    assert picture[100:300, 50:400].std() > 0.05


@pytest.mark.parametrize("person", [{}, {"wish": None, "placement_errors": None}])
def test_no_view_has_anything_to_complain_of(model, tmp_path, person):
    path = tmp_path / "recording.rrd"
    card = replace(CARD, acts=not person)
    with RunRecorder(path, model, card, recording_id="a") as recorder:
        recorder.log_round(replace(round_view(2), **person))
        recorder.show(next(episode(model)))
    try:
        assert complaints(path) == []
    except NoViewer as error:
        pytest.skip(str(error))


def test_a_missing_recording_is_refused_before_a_viewer_starts(tmp_path):
    with pytest.raises(InvalidFile, match="no recording at"):
        screenshot(tmp_path / "nowhere.rrd", tmp_path / "picture.png")


def test_without_a_driver_the_remedy_is_named(recorded: Path, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_DRIVER_FILES", str(tmp_path))
    monkeypatch.setenv("VK_ICD_FILENAMES", str(tmp_path))
    with pytest.raises(NoViewer, match="apt-get install mesa-vulkan-drivers"):
        screenshot(recorded, tmp_path / "picture.png")
