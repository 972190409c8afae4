import json
import shutil

import numpy as np
import pytest
import quick_cli
from refusals import refusal

from tablesetting import cli
from tablesetting.errors import InvalidFile
from tablesetting.experiments.episodes import read_episode


@pytest.fixture
def run(vase_run, tmp_path):
    return shutil.copytree(vase_run, tmp_path / "run")


@pytest.fixture(scope="module")
def noisy_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("noisy") / "run"
    noise = ("--item-noise-mm", "2", "--mass-spread", "0.5", "--epsilon", "0")
    assert quick_cli.start(folder, "--num-queries", "2", *noise) == 0
    return folder


@pytest.mark.parametrize("num_demos", [1, 2])
def test_each_episode_is_repeated_alone_bit_for_bit(noisy_run, num_demos, capsys):
    assert cli.main(["replay", str(noisy_run), "--query", str(num_demos)]) == 0
    said = capsys.readouterr().out
    assert f"after {num_demos} demonstration" in said
    assert "is repeated bit for bit" in said


def test_an_episode_that_went_otherwise_is_told_from_its_start(run, capsys):
    path = run / "episodes" / "episode_02.npz"
    with np.load(path) as arrays:
        content = dict(arrays)
    for name in ("qpos", "ctrl"):
        changed = content[name].copy()
        changed[40:] += 1e-12
        np.savez(path, **content | {name: changed})
        assert cli.main(["replay", str(run)]) == 1
        said = capsys.readouterr().out
        assert f"another way from {content['times'][40]:.2f} s on" in said
    np.savez(path, **content | {"qpos": content["qpos"][:, 1:]})
    assert cli.main(["replay", str(run)]) == 2
    assert "the scene" in capsys.readouterr().err


def test_versions_that_differ_are_named(run, capsys):
    path = run / "episodes" / "episode_02.npz"
    with np.load(path) as arrays:
        content = dict(arrays)
    np.savez(path, **content | {"ctrl": content["ctrl"] + 1.0})
    config = json.loads((run / "config.json").read_text())
    config["versions"]["mujoco"] = "3.16.0"
    (run / "config.json").write_text(json.dumps(config))
    assert cli.main(["replay", str(run)]) == 1
    assert "versions differ: mujoco 3.16.0, now 3." in capsys.readouterr().out


def test_what_cannot_be_repeated_is_refused_in_one_line(run, tmp_path, capsys):
    for argv, part in (
        ([tmp_path / "no"], "config.json"),
        (
            [run, "--query", "9"],
            "no episode after 9 demonstrations; it has those after 1, 2",
        ),
        ([run, "--query", "x"], "--query"),
    ):
        assert part in refusal(capsys, cli.main, "replay", *argv)
    shutil.rmtree(run / "episodes")
    assert cli.main(["replay", str(run)]) == 2
    assert "holds no episodes" in capsys.readouterr().err


def test_a_damaged_episode_is_refused(run):
    path = run / "episodes" / "episode_01.npz"
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(whole[: rng.integers(len(whole))])
        if len(damaged) > 10 and rng.random() < 0.5:
            damaged = bytearray(whole)
            start = int(rng.integers(len(whole)))
            damaged[start : start + 50] = rng.bytes(50)
        path.write_bytes(bytes(damaged))
        try:
            read_episode(run, 1)
        except InvalidFile:
            continue
    np.savez(path, layout=np.zeros((4, 2)))
    with pytest.raises(InvalidFile, match="no episode, or a damaged one"):
        read_episode(run, 1)
    np.savez(path, layout=np.array([{}], dtype=object))
    with pytest.raises(InvalidFile, match="cannot read"):
        read_episode(run, 1)
