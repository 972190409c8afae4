import itertools
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun_cli
from rerun.chunk import RrdReader
from sample_run import CARD, EXECUTION, episode, round_view

from tablesetting.errors import OutputError
from tablesetting.recording import ExecutionView, RunRecorder, entities
from tablesetting.recording.reading import Recording
from tablesetting.recording.story import tell

RERUN = Path(rerun_cli.__file__).with_name("rerun")


def states(path: Path) -> list[tuple[float, str | None]]:
    rows = Recording(path).rows(entities.PHASE, "StateChange:state")
    return [(row.sim_time, row.value) for row in rows if np.isfinite(row.sim_time)]


def scalars(path: Path, entity: str) -> list[float]:
    return [row.value for row in Recording(path).rows(entity, "Scalars:scalars")]


def test_snapshots_and_the_result_of_an_episode_pass_through(model, tmp_path):
    results = []

    def run(recorder: RunRecorder):
        results.append((yield from recorder.record(episode(model))))

    with RunRecorder(tmp_path / "a.rrd", model, CARD, recording_id="a") as recorder:
        passed = list(run(recorder))
    assert results == ["done"]
    for snapshot, expected in zip(passed, episode(model), strict=True):
        np.testing.assert_equal(snapshot.positions, expected.positions)


def test_episodes_follow_one_another_on_one_clock(recorded: Path):
    # Ten frames, 20 ms apart; one second between the rounds.
    expected = [
        (0.0, "reach"),
        (0.1, "lift"),
        (0.18, None),
        (1.18, "reach"),
        (1.28, "lift"),
        (1.36, None),
    ]
    for (time, state), (expected_time, expected_state) in zip(
        states(recorded), expected, strict=True
    ):
        assert time == pytest.approx(expected_time, abs=1e-6)
        assert state == expected_state


def test_curves_hold_one_point_per_round(recorded: Path):
    assert scalars(recorded, entities.VAR_BOUND) == [0.2, 0.1]
    assert scalars(recorded, entities.DEPLOYMENT_BOUND) == [0.25]  # No infinite one.
    assert scalars(recorded, entities.MAX_ERROR) == [0.3, 0.3]
    np.testing.assert_allclose(scalars(recorded, entities.EXECUTION_ERROR), 1.0)


def test_the_reward_map_lies_with_y_up_and_spans_the_shades(recorded: Path):
    data = Recording(recorded).rows(entities.REWARD_MAP, "GridMap:data")[0].value
    image = np.array(data, dtype=np.uint8).reshape(5, 5)
    reward_map = round_view().reward_map
    low, high = reward_map.min(), reward_map.max()
    expected = 255.0 * (reward_map[::-1] - low) / (high - low)
    np.testing.assert_allclose(image, expected, atol=0.5)


def test_the_worst_candidate_stands_apart(recorded: Path):
    asked = Recording(recorded).rows(entities.ASKED_VAR, "BarChart:abscissa")
    assert asked[0].value["buffer"] == [1]


def test_an_episode_that_is_broken_off_is_kept(model, tmp_path):
    path = tmp_path / "a.rrd"
    with RunRecorder(path, model, CARD, recording_id="a") as recorder:
        recorder.log_round(round_view())
        for _ in itertools.islice(recorder.record(episode(model)), 3):
            pass
    assert [state for _, state in states(path)] == ["reach", None]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_run_that_fails_leaves_a_complete_file(model, tmp_path, error):
    path = tmp_path / "a.rrd"

    def run() -> None:
        with RunRecorder(path, model, CARD, recording_id="a") as recorder:
            recorder.log_round(round_view())
            for k, _ in enumerate(recorder.record(episode(model))):
                if k == 4:
                    raise error

    with pytest.raises(error):
        run()
    subprocess.run([RERUN, "rrd", "verify", path], check=True, capture_output=True)
    assert len(states(path)) == 2


def test_a_killed_process_leaves_its_finished_rounds(tmp_path):
    script = (
        "import os, signal, sys, mujoco, pathlib\n"
        "from sample_run import CARD, EXECUTION, XML, episode, round_view\n"
        "from tablesetting.recording import RunRecorder\n"
        "model = mujoco.MjModel.from_xml_string(XML)\n"
        "path = pathlib.Path(sys.argv[1])\n"
        "recorder = RunRecorder(path, model, CARD, recording_id='a')\n"
        "recorder.log_round(round_view())\n"
        "list(recorder.record(episode(model)))\n"
        "recorder.log_execution(EXECUTION)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    path = tmp_path / "a.rrd"
    process = subprocess.run(
        [sys.executable, "-c", script, str(path)], cwd=Path(__file__).parent
    )
    assert process.returncode == -signal.SIGKILL
    story = tell(path)
    assert "execution error 1.00 mm, success" in story
    assert "interrupted" in story


def test_a_round_without_the_arm_shows_the_world(model, tmp_path):
    path = tmp_path / "a.rrd"
    with RunRecorder(path, model, CARD, recording_id="a") as recorder:
        recorder.log_round(round_view())
        recorder.show(next(episode(model)))
    poses = Recording(path).rows(f"{entities.BODIES}/cup", "Transform3D:translation")
    assert [pose.sim_time for pose in poses] == [0.0]
    assert states(path) == []


def test_the_same_run_writes_the_same_content(model, tmp_path):
    paths = [tmp_path / "a.rrd", tmp_path / "b.rrd"]
    for path in paths:
        with RunRecorder(path, model, CARD, recording_id="a-run") as recorder:
            recorder.log_round(round_view())
            list(recorder.record(episode(model)))
            recorder.log_execution(EXECUTION)
    command = [RERUN, "rrd", "compare", "--unordered", *paths]
    subprocess.run(command, check=True, capture_output=True)


def test_a_recording_opens_arranged(recorded: Path):
    reader = RrdReader(recorded)
    assert len(reader.blueprints()) == 1
    assert [entry.recording_id for entry in reader.recordings()] == ["a-run"]


def test_an_execution_needs_a_round(model, tmp_path):
    with (
        RunRecorder(tmp_path / "a.rrd", model, CARD, recording_id="a") as recorder,
        pytest.raises(ValueError, match="call `log_round` before"),
    ):
        recorder.log_execution(ExecutionView(np.zeros(2), None, "never lifted"))


def test_a_file_that_cannot_be_written_is_named(model, tmp_path):
    path = tmp_path / "missing" / "a.rrd"
    with pytest.raises(OutputError, match=r"cannot write the recording.*missing"):
        RunRecorder(path, model, CARD, recording_id="a")
