import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import quick_cli
from folder_content import read_folder

from tablesetting.experiments.config import LearnConfig, ModelConfig
from tablesetting.experiments.options import from_options, to_options
from tablesetting.recording.story import tell
from tablesetting.reward.files import (
    LAYOUTS_FORMAT,
    read_demonstrations,
    read_layouts,
    read_weights,
)
from tablesetting.reward.tasks import VASE

RECORDED = Path(__file__).parents[1] / "data" / "vase_demonstrations.json"
QUICK = ("--num-layouts", "10", "--num-candidates", "8")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Four demonstrations of the recorded session, in a file."""
    content = json.loads(RECORDED.read_text())
    content["demonstrations"] = content["demonstrations"][:4]
    path = tmp_path_factory.mktemp("recorded") / "demos.json"
    path.write_text(json.dumps(content))
    return path


@pytest.fixture(scope="module")
def compiled_learned(recorded, tmp_path_factory):
    out = tmp_path_factory.mktemp("learned") / "out"
    argv = ["learn", str(recorded), *QUICK, "--out", str(out)]
    assert quick_cli.main(argv, quick_cli.MIXED) == 0
    return out


@pytest.fixture
def learned(compiled_learned, tmp_path):
    return shutil.copytree(compiled_learned, tmp_path / "learned")


def test_a_folder_has_weights_bounds_and_the_next_question(learned, recorded):
    assert read_weights(learned / "weights.json").task == VASE
    summary = json.loads((learned / "summary.json").read_text())
    assert summary["num_demos"] == 4
    assert summary["mean_prediction_error"] > 0.0
    (asked,) = read_layouts(learned / "next_layout.json", VASE.objects)
    assert np.unique(asked, axis=0).shape == (4, 2)
    task, demos = read_demonstrations(learned / "demonstrations.json")
    assert (task, len(demos)) == (VASE, 4)
    content = read_folder(learned)
    bounds = content["bounds.csv"]
    assert len(bounds) == 10
    assert max(float(row["bound"]) for row in bounds) == pytest.approx(
        summary["deployment_bound"], abs=1e-8
    )
    assert all(0.0 < float(row["var"]) <= float(row["bound"]) for row in bounds)
    assert [row["num_demos"] for row in content["rounds.csv"]] == ["3", "4"]
    assert {"figures/learning.png", "figures/query_04.png"} <= set(content)


def test_the_recording_tells_what_was_demonstrated_and_what_to_ask(learned):
    story = tell(learned / "recording.rrd")
    assert "What was demonstrated next. Before it was learned from" in story
    assert "Worth asking about next, by `active-var` (rank 1 of 8" in story
    assert "learning error" in story.split("# After 4")[0]
    assert "learning error" not in story.split("# After 4")[1]
    assert "test layouts" not in story


def test_to_append_is_to_have_had_the_demonstration_from_the_start(
    learned, recorded, tmp_path, capsys
):
    (asked,) = read_layouts(learned / "next_layout.json", VASE.objects)
    assert quick_cli.main(["learn", str(learned), "--append", "next", "0.5,0.5"]) == 0
    assert "--append next X,Y" in capsys.readouterr().out
    content = json.loads(recorded.read_text())
    layout = dict(zip(VASE.objects, asked.tolist(), strict=True))
    content["demonstrations"] += [{"layout": layout, "placement": [0.5, 0.5]}]
    longer = tmp_path / "longer.json"
    longer.write_text(json.dumps(content))
    out = tmp_path / "out"
    assert quick_cli.main(["learn", str(longer), *QUICK, "--out", str(out)]) == 0
    appended, at_once = read_folder(learned), read_folder(out)
    first, *rows = appended.pop("rounds.csv")
    assert first["num_demos"] == "3"
    assert rows == at_once.pop("rounds.csv")
    appended.pop("figures/query_03.png")
    assert appended == at_once


def test_a_killed_append_is_not_made_twice(learned, capsys):
    argv = ["learn", str(learned), "--append", "next", "0.5,0.5"]
    asked = (learned / "next_layout.json").read_text()
    assert quick_cli.main(argv) == 0
    whole = read_folder(learned)
    # As if killed before the end, with the demonstration written already.
    (learned / "next_layout.json").write_text(asked)
    (learned / "summary.json").unlink()
    assert quick_cli.main([*argv, "--resume"]) == 0
    assert read_folder(learned) == whole


def test_a_killed_session_goes_on_and_keeps_what_was_appended(learned, recorded):
    assert quick_cli.main(["learn", str(learned), "--append", "next", "0.5,0.5"]) == 0
    whole = read_folder(learned)
    (learned / "weights.json").unlink()
    argv = ["learn", str(recorded), *QUICK, "--out", str(learned), "--resume"]
    assert quick_cli.main(argv) == 0
    assert read_folder(learned) == whole


def test_only_given_layouts_are_asked_about(recorded, tmp_path):
    rng = np.random.default_rng(0)
    given = [{name: rng.random(2).tolist() for name in VASE.objects} for _ in range(3)]
    file = tmp_path / "layouts.json"
    file.write_text(json.dumps({"format": LAYOUTS_FORMAT, "layouts": given}))
    out = tmp_path / "out"
    argv = ["--candidates", str(file), "--layouts", str(file), "--curve"]
    assert quick_cli.main(["learn", str(recorded), *argv, "--out", str(out)]) == 0
    (asked,) = json.loads((out / "next_layout.json").read_text())["layouts"]
    assert asked in given
    content = read_folder(out)
    assert len(content["bounds.csv"]) == 3
    assert [row["num_demos"] for row in content["rounds.csv"]] == ["1", "2", "3", "4"]
    one = ["--append", str(out / "next_layout.json"), "0.5,0.5"]
    assert quick_cli.main(["learn", str(out), *one]) == 0


def refusal(capsys, *argv):
    try:
        code = quick_cli.main(["learn", *map(str, argv)])
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    return error


def test_what_cannot_be_learned_from_is_refused_in_one_line(
    learned, recorded, tmp_path, capsys
):
    before = read_folder(learned)
    out = tmp_path / "out"
    for argv, part in (
        (["no.json"], "no.json"),
        ([recorded, "--candidates", "some"], "cannot read 'some'"),
        ([recorded, "--layouts", "some"], "cannot read 'some'"),
        ([recorded, "--epsilon", "nan"], "--epsilon"),
        ([recorded, "--beta", "3"], "--beta has no effect"),
    ):
        assert part in refusal(capsys, *argv, "--out", out)
        assert not out.exists()
    for argv, part in (
        ([learned, "--append", "next", "0.5"], "'0.5'"),
        ([learned, "--append", "next", "0.5,nan"], "0.5,nan"),
        ([learned, "--append", "next", "0.5,1.5"], "[0, 1]"),
        ([learned, "--append", "no.json", "0.5,0.5"], "no.json"),
        ([recorded, "--append", "next", "0.5,0.5"], "config.json"),
        ([learned, "--append", "next", "0.5,0.5", "--seed", "3"], "seed"),
    ):
        assert part in refusal(capsys, *argv)
    assert read_folder(learned) == before


def test_a_config_of_something_else_is_refused(learned, capsys):
    config = learned / "config.json"
    content = json.loads(config.read_text())
    for changed in (
        content | {"command": "run"},
        content | {"options": []},
        content | {"options": {}},
        content | {"options": content["options"] | {"seed": "0"}},
        content | {"options": content["options"] | {"preset": "mine"}},
        content | {"options": content["options"] | {"noise": -1.0}},
    ):
        config.write_text(json.dumps(changed))
        error = refusal(capsys, learned, "--append", "next", "0.5,0.5")
        assert "not of a session of `learn`" in error


def test_options_come_back():
    config = LearnConfig(
        Path("demos.json"),
        learning=ModelConfig(noise=0.02, points=True),
        candidates="some.json",
        epsilon=0,
        out=Path("out"),
    )
    options = to_options(config, ("append", "out"))
    assert "out" not in options
    back = from_options(LearnConfig, options | {"out": "out"})
    assert back == config
