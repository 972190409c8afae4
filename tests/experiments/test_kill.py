"""Commands that are killed leave nothing half-written, and can be gone on with."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import quick_cli
from folder_content import read_folder

from tablesetting.reward.files import weights_to_json
from tablesetting.reward.rbf import RbfWidths
from tablesetting.reward.tasks import VASE

RECORDED = Path(__file__).parents[1] / "data" / "vase_demonstrations.json"
COMMANDS = {
    "run": [
        *("run", "vase", "--num-queries", "2", "--execute", "1", "--epsilon", "0"),
        *quick_cli.SMALL,
    ],
    "learn": ["learn", str(RECORDED), *quick_cli.SMALL],
    "validate": [
        *("validate", "WEIGHTS", "--num-layouts", "20"),
        *("--execute", "3", "--jobs", "1"),
    ],
    "study": [
        *("study", "placement", "--num-trials", "3", "--num-queries", "2"),
        *("--jobs", "1", "--strategies", "active-var", "random"),
    ],
}


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    path = tmp_path_factory.mktemp("weights") / "weights.json"
    weights = np.r_[-0.2, 0.1, -0.05, -0.15, np.full(9, 0.5 / 9)]
    path.write_text(json.dumps(weights_to_json(weights, VASE, RbfWidths())))
    return str(path)


def start(argv):
    """Start a command in a process group of its own."""
    command = [sys.executable, quick_cli.__file__, *argv]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        command, stdout=quiet, stderr=subprocess.PIPE, start_new_session=True, text=True
    )


def finish(argv):
    """Carry a command out; return the seconds that it took."""
    started = time.monotonic()
    process = start(argv)
    error = process.communicate()[1]
    assert process.returncode == 0, error
    return time.monotonic() - started


def is_killed(argv, moment):
    """Carry a command out, and kill it after some seconds unless it has ended."""
    process = start(argv)
    try:
        process.communicate(timeout=moment)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    return process.returncode == -signal.SIGKILL


def check_whole(folder):
    """All that bears its final name can be read; of a table, all but the last row."""
    for path in folder.rglob("*"):
        if path.name.startswith(".") or path.is_dir():
            continue
        if path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".npz":
            with np.load(path) as arrays:
                assert all(arrays[name].shape is not None for name in arrays.files)
        elif path.suffix == ".png":
            assert path.read_bytes().endswith(b"IEND\xaeB`\x82")
        elif path.suffix == ".csv":
            lines = path.read_text().splitlines()[:-1]
            assert len({line.count(",") for line in lines}) <= 1


def outcome(folder):
    """Read a folder; the recording alone depends on where it was written from."""
    content = read_folder(folder)
    content.pop("recording.rrd", None)
    return content


def check_outcome(folder, reference):
    assert outcome(folder) == reference
    assert not [path for path in folder.rglob(".*") if path.is_file()]


def kill_often(name, weights, tmp_path, num_kills):
    """Kill a command at some moments, one after the other, then let it finish."""
    argv = [weights if word == "WEIGHTS" else word for word in COMMANDS[name]]
    whole, out = tmp_path / "whole", tmp_path / "killed"
    duration = finish([*argv, "--out", str(whole)])
    moments = np.random.default_rng(len(name)).uniform(0.3, 0.9, num_kills) * duration
    argv += ["--out", str(out)]
    moment = moments[0]
    while not is_killed(argv, moment):  # The machine may have been slower before.
        shutil.rmtree(out)
        moment /= 2
    for moment in moments[1:]:
        check_whole(out)
        is_killed([*argv, "--resume"], moment)
    check_whole(out)
    finish([*argv, "--resume"])
    check_outcome(out, outcome(whole))


def kill_appends(tmp_path, num_kills):
    """Kill a command that adds a demonstration, then let it finish."""
    learned, before, whole = (
        tmp_path / name for name in ("learned", "before", "whole")
    )
    finish([*COMMANDS["learn"], "--out", str(learned)])
    shutil.copytree(learned, before)
    shutil.copytree(learned, whole)
    answer = ["--append", "next", "0.5,0.4"]
    duration = finish(["learn", str(whole), *answer])
    moments = np.random.default_rng(0).uniform(0.3, 0.9, num_kills) * duration
    argv = ["learn", str(learned), *answer, "--resume"]
    moment = moments[0]
    while not is_killed(argv, moment):  # The machine may have been slower before.
        shutil.rmtree(learned)
        shutil.copytree(before, learned)
        moment /= 2
    for moment in moments[1:]:
        is_killed(argv, moment)
    check_whole(learned)
    last = start(argv)
    error = last.communicate()[1]
    # A kill may have come when all was done.
    assert last.returncode == 0 or "is learned from" in error
    check_outcome(learned, outcome(whole))


@pytest.mark.parametrize("name", ["learn", "validate"])
def test_a_killed_command_goes_on_to_the_same_end(name, weights, tmp_path):
    kill_often(name, weights, tmp_path, num_kills=1)


def test_a_killed_answer_is_neither_lost_nor_counted_twice(tmp_path):
    kill_appends(tmp_path, num_kills=1)


@pytest.mark.slow
def test_an_answer_that_is_killed_again_and_again_is_not_either(tmp_path):
    kill_appends(tmp_path, num_kills=12)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_one_that_is_killed_again_and_again_does_so_too(name, weights, tmp_path):
    kill_often(name, weights, tmp_path, num_kills=12)
