import json
import os
import subprocess
import sys

import pytest

from tablesetting import cli

BOWL_ON_PLATE = {"plate": [0.5, 0.5], "bowl": [0.6, 0.5]}
STUDY = ("study", "placement")
CALIBRATION = ("study", "calibration")
CORNERS = {"glass": [0.1, 0.1], "cup": [0.9, 0.1]}


def complaint(capsys, *argv):
    """Run a command that is refused; return its one line."""
    try:
        code = cli.main(argv)
    except SystemExit as stop:
        code = stop.code
    output = capsys.readouterr()
    assert code == 2
    assert output.out == ""
    assert output.err.startswith("error: ")
    assert output.err.count("\n") == 1
    return output.err


@pytest.mark.parametrize(
    ("argv", "parts"),
    [
        ([], ["run", "inspect", "doctor"]),
        (["cook"], ["'cook'", "run", "study", "inspect", "doctor"]),
        (["run"], ["{vase,spoon}", "required"]),
        (["run", "cup"], ["'cup'", "vase", "spoon"]),
        (["run", "vase", "--num-queries", "-1"], ["--num-queries", "-1", "at least 0"]),
        (["run", "vase", "--num-candidates", "0"], ["--num-candidates", "at least 1"]),
        (["run", "vase", "--seed", "-7"], ["--seed", "-7"]),
        (["run", "vase", "--seed", "x"], ["--seed", "'x'"]),
        (["run", "vase", "--epsilon", "nan"], ["--epsilon", "nan"]),
        (["run", "vase", "--preset", "mine"], ["'mine'", "default", "paper"]),
        (["run", "vase", "--preset", "paper", "--execute", "1"], ["--execute", "1"]),
        (["run", "vase", "--layouts", "no.json"], ["no.json", "check the path"]),
        (["run", "spoon", "--first-layout", "paper"], ["spoon", "random"]),
        (["run", "vase", "--colour", "red"], ["--colour"]),
        (["run", "vase", "--strategy", "best"], ["'best'", "max-regret", "cvar"]),
        (["run", "vase", "--delta", "0"], ["error: --delta", "(0, 1)", "got 0.0"]),
        (["run", "vase", "--delta", "1"], ["--delta", "(0, 1)", "got 1.0"]),
        (["run", "vase", "--likelihood", "x"], ["--likelihood", "placement", "auto"]),
        (["run", "vase", "--guess", "best"], ["--guess", "'best'", "map", "mean"]),
        (["run", "vase", "--teacher", "me"], ["--teacher", "'me'", "noisy", "offset"]),
        (["run", "vase", "--truth", "mine"], ["--truth", "task", "prior"]),
        (["run", "vase", "--noise", "0"], ["error: --noise", "[0.001, 1]", "0.0"]),
        (["run", "vase", "--noise", "nan"], ["error: --noise", "got nan"]),
        (["run", "vase", "--beta", "0"], ["error: --beta", "[0.01, 10000]", "got 0.0"]),
        (
            ["run", "vase", "--beta-spread", "-1"],
            ["error: --beta-spread", "[0, 2]", "got -1.0"],
        ),
        (
            ["run", "vase", "--noise-spread", "3"],
            ["error: --noise-spread", "[0, 2]", "got 3.0"],
        ),
        (["run", "vase", "--target-ess", "0"], ["error: --target-ess", "got 0.0"]),
        (["run", "vase", "--max-rhat", "1"], ["error: --max-rhat", "over 1", "1.0"]),
        (["run", "vase", "--num-steps", "9"], ["error: --num-steps", "[2000, ", "9"]),
        (
            ["run", "vase", "--beta", "50"],
            ["--beta has no effect with the likelihood placement", "--likelihood"],
        ),
        (
            ["run", "vase", "--likelihood", "boltzmann", "--noise-spread", "1"],
            ["--noise-spread has no effect with the likelihood boltzmann", "leave it"],
        ),
        (
            ["run", "vase", "--likelihood", "auto", "--noise-spread", "1"],
            ["--noise-spread must be 0 with --likelihood auto", "got 1.0"],
        ),
        (
            ["run", "vase", "--likelihood", "auto", "--netcdf"],
            ["--netcdf takes one likelihood", "got --likelihood auto"],
        ),
        (
            ["run", "vase", "--preset", "paper", "--require-certificate"],
            ["--require-certificate cannot be met with the paper preset"],
        ),
        (
            ["run", "vase", "--epsilon", "0", "--require-certificate"],
            ["--require-certificate cannot be met with --epsilon 0"],
        ),
        (
            ["run", "vase", "--points", "--execute", "3"],
            ["--execute must be 0 with --points", "got 3"],
        ),
        (
            ["run", "vase", "--preset", "paper", "--likelihood", "auto"],
            ["--likelihood must be boltzmann", "got auto", "--preset default --points"],
        ),
        (
            [*STUDY, "--likelihood", "placement"],
            ["--likelihood must be boltzmann", "got placement", "--preset default"],
        ),
        ([*STUDY, "--num-steps", "9000"], ["--num-steps", "no effect", "leave it out"]),
        ([*CALIBRATION, "--target-ess", "0"], ["--target-ess", "[1, ", "got 0.0"]),
        ([*CALIBRATION, "--max-rhat", "1"], ["--max-rhat", "over 1", "got 1.0"]),
        ([*STUDY, "--beta-spread", "0.1"], ["--beta-spread must be 0", "got 0.1"]),
        (["study"], ["placement", "calibration"]),
        (["study", "breakfast"], ["'breakfast'", "placement", "calibration"]),
        ([*STUDY, "--tasks", "cup"], ["'cup'", "vase", "spoon"]),
        ([*STUDY, "--tasks"], ["--tasks", "none"]),
        ([*STUDY, "--tasks", "vase", "vase"], ["--tasks", "vase vase"]),
        ([*STUDY, "--strategies", "best"], ["'best'", "active-var", "random"]),
        ([*STUDY, "--strategies", "all", "random"], ["all stands alone", "all random"]),
        ([*STUDY, "--noise", "0"], ["error: --noise", "[0.001, 1]", "got 0.0"]),
        ([*STUDY, "--teacher", "me"], ["--teacher", "'me'", "noisy", "offset"]),
        ([*STUDY, "--merge", "a", "--beta", "3"], ["--beta has no effect"]),
        ([*CALIBRATION, "--teachers", "me"], ["'me'", "exact", "offset"]),
        ([*CALIBRATION, "--teachers"], ["--teachers", "none"]),
        ([*CALIBRATION, "--teachers", "exact", "exact"], ["--teachers", "exact exact"]),
        ([*CALIBRATION, "--num-trials", "0"], ["--num-trials", "at least 1", "got 0"]),
        ([*CALIBRATION, "--strategies", "random"], ["--strategies"]),
        (
            [*CALIBRATION, "--merge", "a", "--teachers", "exact"],
            ["--teachers has no effect", "leave it out"],
        ),
        ([*STUDY, "--num-trials", "0"], ["--num-trials", "at least 1", "got 0"]),
        ([*STUDY, "--num-trials", "9" * 20], ["--num-trials", "at most 1000000"]),
        ([*STUDY, "--num-queries", "-1"], ["--num-queries", "at least 0", "-1"]),
        ([*STUDY, "--num-trials", "many"], ["--num-trials", "'many'"]),
        ([*STUDY, "--jobs", "0"], ["--jobs", "at least 1", "got 0"]),
        ([*STUDY, "--shard", "3/2"], ["--shard", "3/2", "such as 2/4"]),
        ([*STUDY, "--shard", "0/2"], ["--shard", "0/2"]),
        ([*STUDY, "--shard", "half"], ["--shard", "half"]),
        ([*STUDY, "--num-trials", "2", "--shard", "1/5"], ["--shard", "4 parts"]),
        ([*STUDY, "--resume"], ["--resume", "--out"]),
        ([*STUDY, "--out", "a", "--resume", "--overwrite"], ["--resume"]),
        ([*STUDY, "--merge", "no-such-part"], ["no-such-part", "check the path"]),
        ([*STUDY, "--merge"], ["--merge", "none"]),
        ([*STUDY, "--merge", "a", "b", "--out", "./b"], ["--out", "none of the parts"]),
        ([*STUDY, "--num-queries", "9" * 20], ["--num-queries", "at most 10000"]),
        ([*STUDY, "--jobs", "9" * 20], ["--jobs", "at most 1000"]),
        ([*STUDY, "--out", "a" * 300, "--resume"], ["aaa", "--out"]),
        ([*STUDY, "--merge", "a", "--seed", "3"], ["--seed", "leave it out"]),
        ([*STUDY, "--merge", "a", "--shard", "1/2"], ["--shard", "leave it out"]),
        ([*STUDY, "--layouts", "no.json"], ["--layouts", "valid", "uniform"]),
        ([*STUDY, "--out", "/dev/null/study"], ["/dev/null/study", "--out"]),
        (["inspect", "nothing-here"], ["nothing-here"]),
        (["inspect", ".", "--text", "--web"], ["--text", "--web"]),
        (["inspect", ".", "--screenshot", "a.png", "--at", "nan"], ["--at", "nan"]),
        (["inspect", ".", "--screenshot", "a.png", "--at", "-5"], ["--at", "-5"]),
    ],
)
def test_bad_input_is_refused_in_one_line(argv, parts, capsys):
    message = complaint(capsys, *argv)
    for part in parts:
        assert part in message


@pytest.mark.parametrize("option", ["--likelihood", "--guess"])
def test_no_choice_is_offered_that_is_refused(option, capsys):
    assert "None" not in complaint(capsys, "run", "vase", option, "unknown")


@pytest.mark.parametrize(
    ("layout", "parts"),
    [
        (BOWL_ON_PLATE | CORNERS, ["'plate'", "'bowl'", "move them apart"]),
        (BOWL_ON_PLATE | CORNERS | {"bowl": [1.5, 0.5]}, ["'bowl'", "1.5"]),
        (BOWL_ON_PLATE, ["'glass'", "cup"]),
        (BOWL_ON_PLATE | CORNERS | {"fork": [0.1, 0.9]}, ["'fork'"]),
        ({"plate": 3}, ["bowl"]),
        ([1], ["[1]"]),
    ],
)
def test_an_impossible_first_layout_is_refused(layout, parts, tmp_path, capsys):
    file = tmp_path / "layout.json"
    file.write_text(
        json.dumps({"format": "tablesetting-layouts/1", "layouts": [layout]})
    )
    out = tmp_path / "out"
    argv = ("run", "vase", "--first-layout", str(file), "--out", str(out))
    message = complaint(capsys, *argv)
    for part in (str(file), *parts):
        assert part in message
    assert not out.exists()


def test_a_folder_that_cannot_be_written_is_refused(capsys):
    assert "/dev/null" in complaint(capsys, "run", "vase", "--out", "/dev/null/run")


def test_what_is_not_a_run_is_never_overwritten(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("years of work")
    argv = ("run", "vase", "--out", str(tmp_path), "--overwrite")
    assert "it holds no run" in complaint(capsys, *argv)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_a_text_file_is_no_recording(tmp_path, capsys):
    (tmp_path / "recording.rrd").write_text("not a recording")
    assert "recording.rrd" in complaint(capsys, "inspect", str(tmp_path), "--text")


@pytest.mark.parametrize("argv", [["run", "cup"], ["run", "vase", "--seed", "-1"]])
def test_a_mistake_is_told_in_one_plain_line_on_a_terminal(argv):
    try:
        leader, follower = os.openpty()
    except OSError:
        pytest.skip("this machine has no pseudo-terminals")
    command = [sys.executable, "-m", "tablesetting", *argv]
    streams = {"stdout": follower, "stderr": subprocess.PIPE}
    done = subprocess.run(command, text=True, check=False, **streams)
    os.close(follower)
    os.close(leader)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "\x1b" not in done.stderr
    assert argv[-1] in done.stderr


def test_a_reader_who_leaves_causes_no_traceback(tmp_path):
    command = f"{sys.executable} -m tablesetting doctor --out '{tmp_path}' | head -1"
    done = subprocess.run(
        command, shell=True, text=True, capture_output=True, check=False
    )
    assert done.stdout.startswith("ok    python")
    assert done.stderr == ""


def test_asking_for_help_loads_nothing_heavy():
    code = (
        "import sys, tablesetting.cli as cli\n"
        "for command in (['run'], ['study'], ['study', 'placement']):\n"
        "    try: cli.main([*command, '--help'])\n"
        "    except SystemExit as stop: assert not stop.code\n"
        "heavy = {'numpy', 'numba', 'mujoco', 'mink', 'rerun', 'matplotlib', 'dm_control'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "--num-queries" in done.stdout
    assert "--shard" in done.stdout


@pytest.mark.parametrize("command", [("run",), STUDY], ids=" ".join)
def test_help_names_how_can_be_learned_and_from_whom(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        cli.main([*command, "--help"])
    text = capsys.readouterr().out
    for option in (
        "--likelihood {boltzmann,placement,auto}",
        "--guess {map,mean}",
        "--noise FLOAT",
        "--noise-spread FLOAT",
        "--beta FLOAT",
        "--beta-spread FLOAT",
        "--target-ess FLOAT",
        "--max-rhat FLOAT",
        "--num-steps INT",
        "--teacher {exact,boltzmann,noisy,blundering,biased,offset}",
        "--truth {task,prior}",
        "--points",
    ):
        assert option in text


@pytest.mark.parametrize("missing", ["h5netcdf", "h5py"])
def test_netcdf_without_its_extra_is_refused_before_any_work(
    missing, tmp_path, capsys, monkeypatch
):
    for module in ("h5netcdf", "h5py"):
        monkeypatch.setitem(sys.modules, module, type(sys)(module))
    monkeypatch.setitem(sys.modules, missing, None)
    out = tmp_path / "out"
    message = complaint(capsys, "run", "vase", "--netcdf", "--out", str(out))
    for part in (str(out / "posterior.nc"), missing, "tablesetting[arviz]"):
        assert part in message
    assert not out.exists()


def test_the_doctor_finds_this_machine_well(tmp_path, capsys):
    assert cli.main(["doctor", "--out", str(tmp_path)]) == 0
    report = capsys.readouterr().out
    assert "FAIL" not in report
    for subject in ("mujoco", "rendering", "write access", "reach of the arm"):
        assert subject in report


def test_the_doctor_names_what_is_ill_and_the_remedy(capsys, monkeypatch):
    monkeypatch.setattr(
        "tablesetting.experiments.doctor.package_versions", lambda: {"mujoco": "4.0.1"}
    )
    assert cli.main(["doctor", "--out", "/dev/null/runs"]) == 1
    report = capsys.readouterr().out
    assert "FAIL  mujoco" in report
    assert "pip install 'mujoco==3.17.*'" in report
    assert "FAIL  write access" in report
    assert "--out" in report
