import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import quick_cli
import refusals
from folder_content import read_folder

from tablesetting import cli
from tablesetting.experiments import learn, learn_files
from tablesetting.experiments.config import LearnConfig, ModelConfig
from tablesetting.experiments.listing import list_runs
from tablesetting.options import from_options, to_options
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
    assert "This layout was demonstrated next. Before that was learned from" in story
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
    # More was foretold of what came one by one.
    foretold, alone = (
        content["certificate.json"]["fit"].pop("foretold")
        for content in (appended, at_once)
    )
    assert len(foretold) == 2
    assert foretold[1:] == alone
    for content in (appended, at_once):
        del content["certificate.json"]["fit"]["p_value"]
        for row in content["rounds.csv"]:
            del row["fit"], row["foretold"]
    third, *rows = appended.pop("rounds.csv")
    assert third["num_demos"] == "3"
    assert rows == at_once.pop("rounds.csv")
    errors = [float(row["prediction_error"]) for row in (third, rows[0])]
    mean = appended["summary.json"].pop("mean_prediction_error")
    assert mean == pytest.approx(np.mean(errors))
    assert at_once["summary.json"].pop("mean_prediction_error") == errors[1]
    appended.pop("figures/query_03.png")
    assert appended == at_once


def test_a_row_stays_as_it_was_when_an_answer_is_appended(learned):
    (*_, before) = read_folder(learned)["rounds.csv"]
    argv = ["learn", str(learned), "--append", "next", "0.5,0.5"]
    assert quick_cli.main(argv, quick_cli.MIXED) == 0
    (_, after, _) = read_folder(learned)["rounds.csv"]
    assert 0.0 < float(before["foretold"]) <= 1.0
    # What was foretold is taken from the table, which has nine digits.
    assert float(after.pop("fit")) == pytest.approx(float(before.pop("fit")), abs=1e-8)
    assert after | {"prediction_error": ""} == before


def test_an_answer_is_pending_until_it_is_learned_from(learned, monkeypatch, capsys):
    answer = ["--append", "next", "0.5,0.5"]
    with monkeypatch.context() as broken:
        broken.setattr(learn_files, "plot_learning", interrupt)
        assert quick_cli.main(["learn", str(learned), *answer]) == 130
    error = capsys.readouterr().err
    assert "5 demonstrations are kept" in error
    assert "same command and --resume" in error
    # What was learned before that answer is not to pass for what was learned from it.
    assert not (learned / "certificate.json").exists()
    assert "unfinished" in list(list_runs(learned.parent))[1]
    for other in (answer, ["--append", "next", "0.5,0.6", "--resume"]):
        assert "at 0.5,0.5, is not learned from" in refusal(capsys, learned, *other)
    assert cli.main(["export", str(learned), "--to", "csv"]) == 2
    assert "not finished" in capsys.readouterr().err
    assert quick_cli.main(["learn", str(learned), *answer, "--resume"]) == 0
    assert len(read_demonstrations(learned / "demonstrations.json")[1]) == 5
    assert json.loads((learned / "summary.json").read_text())["num_demos"] == 5


def test_the_same_placement_elsewhere_is_another_answer(learned, capsys):
    answer = ["--append", "next", "0.5,0.5"]
    assert quick_cli.main(["learn", str(learned), *answer]) == 0
    error = refusal(capsys, learned, *answer, "--resume")
    assert "leave out --resume if this is another one" in error
    assert quick_cli.main(["learn", str(learned), *answer]) == 0
    _, demos = read_demonstrations(learned / "demonstrations.json")
    assert len(demos) == 6
    assert not np.array_equal(demos[-1].layout, demos[-2].layout)


def test_answers_are_not_mixed_with_those_of_other_settings(
    recorded, tmp_path, monkeypatch, capsys
):
    rng = np.random.default_rng(0)
    file = tmp_path / "layouts.json"
    given = [{name: rng.random(2).tolist() for name in VASE.objects} for _ in range(3)]
    content = {"format": LAYOUTS_FORMAT, "layouts": given}
    file.write_text(json.dumps(content))
    out = tmp_path / "out"
    argv = ["learn", str(recorded), "--candidates", str(file), "--num-layouts", "10"]
    assert quick_cli.main([*argv, "--out", str(out)]) == 0
    answer = ["--append", "next", "0.5,0.5"]
    with monkeypatch.context() as newer:
        newer.setattr(learn, "package_versions", lambda: {"mujoco": "9.0.0"})
        assert "9.0.0" in refusal(capsys, out, *answer)
    file.write_text(json.dumps(content | {"layouts": given[:2]}))
    error = refusal(capsys, out, *answer)
    assert "candidates_sha256" in error
    assert "demonstrations.json" in error


def test_what_was_appended_is_not_overwritten(learned, recorded, capsys):
    argv = [recorded, *QUICK, "--out", learned]
    assert quick_cli.main(["learn", str(learned), "--append", "next", "0.5,0.5"]) == 0
    before = read_folder(learned)
    assert "would be lost, 1 demonstrations" in refusal(capsys, *argv, "--overwrite")
    own = [learned / "demonstrations.json", *QUICK, "--out", learned, "--overwrite"]
    assert "is in it" in refusal(capsys, *own)
    assert read_folder(learned) == before
    # Of others there are more, but that one is not among them.
    argv[0] = RECORDED
    assert "would be lost, 1 demonstrations" in refusal(capsys, *argv, "--overwrite")
    assert read_folder(learned) == before


def test_what_was_only_recorded_is_overwritten(learned, recorded, tmp_path):
    content = json.loads(recorded.read_text())
    fewer = tmp_path / "fewer.json"
    shorter = {"demonstrations": content["demonstrations"][:2]}
    fewer.write_text(json.dumps(content | shorter))
    argv = ["learn", str(fewer), *QUICK, "--out", str(learned), "--overwrite"]
    assert quick_cli.main(argv) == 0
    assert len(read_demonstrations(learned / "demonstrations.json")[1]) == 2


def test_a_first_session_that_was_cut_short_is_finished_first(
    learned, recorded, capsys
):
    for name in ("summary.json", "next_layout.json"):
        (learned / name).unlink()
    error = refusal(capsys, learned, "--append", "next", "0.5,0.5")
    assert f"learn {recorded} --out {learned} --resume" in error
    assert len(read_demonstrations(learned / "demonstrations.json")[1]) == 4


@pytest.mark.parametrize(
    "damage", [lambda t: t[:150], lambda t: t + "4,5\n", str.upper]
)
def test_a_damaged_table_costs_no_answer(learned, capsys, damage):
    table = learned / "rounds.csv"
    table.write_text(damage(table.read_text()))
    before = names_in(learned)
    assert "rounds.csv" in refusal(capsys, learned, "--append", "next", "0.5,0.5")
    assert names_in(learned) == before
    assert len(read_demonstrations(learned / "demonstrations.json")[1]) == 4


def test_a_session_goes_on_however_its_files_are_named(learned, recorded, monkeypatch):
    whole = read_folder(learned)
    monkeypatch.chdir(recorded.parent)
    argv = ["learn", recorded.name, *QUICK, "--out", str(learned), "--resume"]
    assert quick_cli.main(argv, quick_cli.MIXED) == 0
    assert read_folder(learned) == whole


def test_candidates_that_cannot_be_made_are_refused_at_once(recorded, tmp_path, capsys):
    content = json.loads(recorded.read_text())
    last = content["demonstrations"][-1]["layout"]
    content["demonstrations"][-1]["layout"] = {name: [0.5, 0.5] for name in last}
    file, out = tmp_path / "piled.json", tmp_path / "out"
    file.write_text(json.dumps(content))
    argv = [file, "--candidates", "one-moved", "--out", out]
    error = refusal(capsys, *argv)
    assert "demonstration 3 leads to no candidates" in error
    assert not out.exists()
    assert quick_cli.main(["learn", *map(str, argv), *QUICK, "--points"]) == 0


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


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def interrupt(*_):
    raise KeyboardInterrupt


def refusal(capsys, *argv):
    return refusals.refusal(capsys, quick_cli.main, "learn", *argv)


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
        ([recorded.parent], "is a folder"),
        ([recorded, "--num-candidates", "9", "--candidates", "some"], "no effect"),
        ([recorded, "--num-layouts", "9", "--layouts", "some"], "no effect"),
    ):
        assert part in refusal(capsys, *argv, "--out", out)
        assert not out.exists()
    for argv, part in (
        ([learned, "--append", "next", "0.5"], "'0.5'"),
        ([learned, "--append", "next", "0.5,nan"], "0.5,nan"),
        ([learned, "--append", "next", "0.5", "0.5"], "expected 2 values"),
        ([learned, "--append", "next", "0.5,1.5"], "[0, 1]"),
        ([learned, "--append", "no.json", "0.5,0.5"], "no.json"),
        ([recorded, "--append", "next", "0.5,0.5"], "config.json"),
        (
            [learned, "--append", "next", "0.5,0.5", "--seed", "3", "--noise", "0.1"],
            "leave out --noise, --seed",
        ),
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
