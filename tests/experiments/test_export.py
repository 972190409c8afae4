import csv
import json
import shutil
import socket
import subprocess
import warnings

import numpy as np
import pyarrow.parquet as pq
import pytest
from rerun.chunk import RrdReader

from tablesetting import cli
from tablesetting.experiments.episodes import read_episode
from tablesetting.experiments.export import FORMS
from tablesetting.recording.viewer import LOCAL_ONLY, VIEWER
from tablesetting.results import RunFolder
from tablesetting.reward.files import read_demonstrations


def export(run, form, out, *options):
    return cli.main(["export", str(run), "--to", form, "--out", str(out), *options])


@pytest.fixture(scope="module")
def dataset(vase_run, tmp_path_factory):
    out = tmp_path_factory.mktemp("exported") / "lerobot"
    assert export(vase_run, "lerobot", out) == 0
    return out


def test_demonstrations_come_back_from_their_table(vase_run, tmp_path):
    out = tmp_path / "out"
    assert export(vase_run, "csv", out) == 0
    task, found = read_demonstrations(out / "demonstrations.csv")
    again, expected = read_demonstrations(vase_run / "demonstrations.json")
    assert task == again
    for demo, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(demo.layout, other.layout)
        np.testing.assert_array_equal(demo.placement, other.placement)
    with (out / "rounds.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["num_demos"] for row in rows] == ["1", "2", "3"]


def test_the_posterior_comes_with_its_demonstrations(vase_run, tmp_path):
    assert export(vase_run, "npz", tmp_path / "out") == 0
    found = np.load(tmp_path / "out" / "posterior.npz", allow_pickle=False)
    assert found["weights"].shape[1] == 13
    assert found["layouts"].shape == (3, 4, 2)
    assert found["placements"].shape == (3, 2)
    assert found["objects"].tolist() == ["plate", "bowl", "glass", "cup"]


def test_a_dataset_holds_every_snapshot_of_every_episode(dataset, vase_run):
    info = json.loads((dataset / "meta" / "info.json").read_text())
    episodes = [read_episode(vase_run, number) for number in (1, 2)]
    lengths = [len(each.times) for each in episodes]
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"]) == (2, sum(lengths))
    path = info["data_path"].format(chunk_index=0, file_index=0)
    table = pq.read_table(dataset / path)
    assert set(table.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        first = table[name][0].as_py()
        assert np.size(first) == feature["shape"][0]
    assert table["episode_index"].to_pylist() == np.repeat([0, 1], lengths).tolist()
    assert table["index"].to_pylist() == list(range(sum(lengths)))
    times = np.array(table["timestamp"].to_pylist()[: lengths[0]])
    np.testing.assert_allclose(times + 1 / 30, episodes[0].times, atol=0.009)
    (row,) = pq.read_table(dataset / "meta" / "tasks.parquet").to_pylist()
    assert row == {"task_index": 0, "task": "Place the vase."}


def test_a_dataset_has_joints_servos_and_places_as_they_were(
    dataset, vase_run, compiled_vase_scene
):
    table = pq.read_table(dataset / "data" / "chunk-000" / "file-000.parquet")
    episodes = [read_episode(vase_run, number) for number in (1, 2)]
    qpos = np.concatenate([each.qpos for each in episodes])
    ctrl = np.concatenate([each.ctrl for each in episodes])
    model = compiled_vase_scene.model
    joints = [model.joint(f"jaco/joint_{k}").qposadr[0] for k in range(1, 7)]
    state = np.array(table["observation.state"].to_pylist())
    np.testing.assert_array_equal(state[:, :6], qpos[:, joints].astype(np.float32))
    action = np.array(table["action"].to_pylist())
    np.testing.assert_array_equal(action, ctrl[:, :7].astype(np.float32))
    vase = model.joint("vase/").qposadr[0]
    places = np.array(table["observation.environment_state"].to_pylist())
    assert any(
        np.array_equal(
            places[:, k : k + 3], qpos[:, vase : vase + 3].astype(np.float32)
        )
        for k in range(0, places.shape[1], 3)
    )


def test_rerun_reads_the_dataset(dataset, vase_run, tmp_path):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    file = tmp_path / "read.rrd"
    command = [str(VIEWER), *LOCAL_ONLY, "--port", port, str(dataset)]
    done = subprocess.run(
        [*command, "--save", str(file)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert "ERROR" not in done.stderr
    reader = RrdReader(file)
    assert len(reader.recordings()) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # It reads the first of the two.
        chunks = reader.stream().to_chunks()
    rows = {
        chunk.entity_path: chunk.to_record_batch().num_rows
        for chunk in chunks
        if "Scalars:scalars" in chunk.to_record_batch().schema.names
    }
    length = len(read_episode(vase_run, 1).times)
    expected = ("/action", "/observation.state", "/observation.environment_state")
    assert rows == dict.fromkeys(expected, length)


def test_nothing_but_an_export_is_overwritten(vase_run, tmp_path, capsys):
    out = tmp_path / "out"
    assert export(vase_run, "lerobot", out) == 0
    assert export(vase_run, "npz", out) == 2
    assert "--overwrite" in capsys.readouterr().err
    mine = out / "data" / "chunk-000" / "mine.parquet"
    mine.write_text("mine")
    assert export(vase_run, "npz", out, "--overwrite") == 2
    assert mine.read_text() == "mine"
    mine.unlink()
    assert export(vase_run, "npz", out, "--overwrite") == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "export.json",
        "posterior.npz",
    ]
    own = tmp_path / "own"
    own.mkdir()
    (own / "rounds.csv").write_text("mine")
    for place in (own, "."):
        assert export(vase_run, "csv", place, "--overwrite") == 2
        assert "--overwrite" not in capsys.readouterr().err
    assert (own / "rounds.csv").read_text() == "mine"


def test_what_comes_while_a_run_is_exported_stays(vase_run, tmp_path, monkeypatch):
    out = tmp_path / "out"
    for options in ([], ["--overwrite"]):

        def write(run, path):
            (path / "posterior.npz").write_text("exported")
            out.mkdir(exist_ok=True)
            (out / "mine.txt").write_text("mine")

        monkeypatch.setitem(FORMS, "npz", write)
        assert export(vase_run, "npz", out, *options) == 2
        assert [path.name for path in tmp_path.iterdir()] == ["out"]
        assert [path.name for path in out.iterdir()] == ["mine.txt"]
        (out / "mine.txt").unlink()
        out.rmdir()


def test_a_run_that_is_not_finished_is_not_exported(vase_run, tmp_path, capsys):
    run, out = shutil.copytree(vase_run, tmp_path / "run"), tmp_path / "out"
    with RunFolder(run).locked():
        assert export(run, "csv", out) == 2
        assert "another process" in capsys.readouterr().err
    with RunFolder(run).locked(is_shared=True):
        assert export(run, "csv", tmp_path / "other") == 0
    (run / "summary.json").unlink()
    for form in ("csv", "npz", "lerobot"):
        assert export(run, form, out) == 2
        assert "--resume" in capsys.readouterr().err
    assert not out.exists()


def test_names_that_no_file_can_have_are_refused_in_one_line(vase_run, capsys):
    name = "n" * 300
    for argv in (
        ["export", str(vase_run), "--to", "csv", "--out", name],
        *([command, name] for command in ("inspect", "replay", "learn", "validate")),
    ):
        assert cli.main(argv) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_what_cannot_be_exported_leaves_no_folder(tmp_path, vase_run, capsys):
    out = tmp_path / "out"
    for form in ("csv", "npz", "lerobot"):
        assert export(tmp_path / "no", form, out) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert list(tmp_path.iterdir()) == []
