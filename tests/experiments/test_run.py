import shutil
import subprocess
import sys

import numpy as np
import pytest
import quick_cli
from quick_cli import SMALL, content_of, rows_of, start, without_seconds

from tablesetting.experiments.arm import Arm
from tablesetting.experiments.config import RunConfig
from tablesetting.experiments.setup import RunSetup
from tablesetting.irl.active import run_active
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.recording.story import tell
from tablesetting.reward.files import DEMONSTRATIONS_FORMAT, WEIGHTS_FORMAT
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.rbf import TABLE_CENTERS
from tablesetting.reward.tasks import SPOON, VASE


def commanded_in(row):
    """Return where the arm was told to put the item, shape (2,)."""
    return np.array([float(row["commanded_x"]), float(row["commanded_y"])])


def layouts_of(folder, task):
    """Return the layouts of all demonstrations, shape (L, K, 2)."""
    demos = content_of(folder, "demonstrations.json")["demonstrations"]
    return np.array([[demo["layout"][name] for name in task.objects] for demo in demos])


def test_a_run_leaves_every_file_of_the_contract(vase_run):
    names = {str(path.relative_to(vase_run)) for path in vase_run.rglob("*.*")}
    assert names == {
        "config.json",
        "rounds.csv",
        "summary.json",
        "certificate.json",
        "weights.json",
        "demonstrations.json",
        "posterior.npz",
        "recording.rrd",
        "episodes/episode_01.npz",
        "episodes/episode_02.npz",
        "figures/learning.png",
        "figures/query_01.png",
        "figures/query_02.png",
        "figures/query_03.png",
    }


def test_every_asked_layout_is_executed_and_the_last_round_asks_nothing(vase_run):
    *asked, last = rows_of(vase_run)
    assert [row["num_demos"] for row in (*asked, last)] == ["1", "2", "3"]
    for row in asked:
        assert row["success"] == "True"
        commanded = commanded_in(row)
        settled = np.array([float(row["settled_x"]), float(row["settled_y"])])
        error_mm = 500.0 * np.linalg.norm(settled - commanded)  # 0.5 m a unit.
        assert error_mm == pytest.approx(float(row["execution_error_mm"]), abs=1e-4)
        assert 0.0 < error_mm < 10.0
    assert last["success"] == last["commanded_x"] == ""


def test_the_vase_is_commanded_to_where_the_robot_wants_it_and_it_fits(vase_run):
    """The learning is played again to know what the robot wanted in each round."""
    config = RunConfig("vase", num_queries=2, num_candidates=6, num_layouts=12, seed=5)
    with quick_cli.short_chains():
        setup = RunSetup.of_config(config)
    problem = setup.problem
    rounds = run_active(
        problem,
        [problem.demonstrate(setup.first_layout, rng=setup.teacher_rng)],
        STRATEGIES[config.strategy],
        problem.config.risk,
        rng=setup.rng,
    )
    for row, latest in zip(rows_of(vase_run)[:-1], rounds, strict=False):
        best_guess, layout = latest.posterior.guessed_weights, latest.query
        expected = problem.best_free_placement(best_guess, layout)
        commanded = commanded_in(row)
        np.testing.assert_allclose(commanded, expected, atol=1e-6)
        assert problem.space.free_space(layout).contains(commanded)
        wanted = problem.best_placements(best_guess[None], layout[None])[0, 0]
        error = np.linalg.norm(wanted - problem.wishes(layout[None])[0])
        assert float(row["learning_error"]) == pytest.approx(error, abs=1e-6)
        detour = np.linalg.norm(wanted - commanded)
        assert float(row["detour"]) == pytest.approx(detour, abs=1e-6)
        person = problem.best_free_placement(VASE.true_weights, layout)
        settled = np.array([float(row["settled_x"]), float(row["settled_y"])])
        outcome_error = np.linalg.norm(settled - person)
        assert float(row["outcome_error"]) == pytest.approx(outcome_error, abs=1e-6)


def test_the_summary_agrees_with_the_rows(vase_run):
    summary, rows = content_of(vase_run, "summary.json"), rows_of(vase_run)
    assert summary["stopped"] == "budget"
    assert summary["num_demos"] == 3
    for name in ("mean_placement_error", "max_placement_error", "var_bound"):
        assert summary[name] == pytest.approx(float(rows[-1][name]))
    errors = [float(row["execution_error_mm"]) for row in rows[:-1]]
    executions = summary["executions"]
    assert executions["attempted"] == executions["succeeded"] == 2
    assert executions["refused"] == 0
    assert executions["max_error_mm"] == pytest.approx(max(errors), abs=1e-4)


def test_learned_weights_and_demonstrations_are_written_in_their_formats(vase_run):
    weights = content_of(vase_run, "weights.json")
    assert weights["format"] == WEIGHTS_FORMAT
    assert weights["objects"] == list(VASE.objects)
    values = weights["object_weights"] + weights["table_weights"]
    assert np.abs(values).sum() == pytest.approx(1.0)
    demos = content_of(vase_run, "demonstrations.json")
    assert demos["format"] == DEMONSTRATIONS_FORMAT
    assert len(demos["demonstrations"]) == 3


def test_the_person_shows_the_best_placement_of_a_plain_search(vase_run):
    """Anywhere on the square: what is wanted does not depend on what is in the way."""
    ticks = np.linspace(0.0, 1.0, 201)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    demos = content_of(vase_run, "demonstrations.json")
    for demo, layout in zip(
        demos["demonstrations"], layouts_of(vase_run, VASE), strict=True
    ):
        centers = np.concatenate([layout, TABLE_CENTERS])

        def reward(points, centers=centers):
            squared = np.square(points[:, None] - centers).sum(axis=-1)
            return np.exp(-squared / 0.3) @ VASE.true_weights

        shown = np.array(demo["placement"])[None]
        assert reward(shown)[0] >= reward(grid).max()


def test_the_recording_tells_every_round(vase_run):
    story = tell(vase_run / "recording.rrd")
    for text in ("1 demonstration", "2 demonstrations", "3 demonstrations", "budget"):
        assert text in story


def test_the_same_seed_gives_the_same_rows_in_a_fresh_process(vase_run, tmp_path):
    again = tmp_path / "again"
    options = ["--num-queries", "2", "--seed", "5", "--out", str(again), *SMALL]
    command = [sys.executable, quick_cli.__file__, "run", "vase", *options]
    subprocess.run(command, check=True, capture_output=True)
    assert without_seconds(rows_of(again)) == without_seconds(rows_of(vase_run))
    assert (again / "weights.json").read_text() == (
        vase_run / "weights.json"
    ).read_text()


def test_objects_are_points_and_nothing_is_executed_in_the_paper_preset(tmp_path):
    assert start(tmp_path / "run", "--preset", "paper", "--num-queries", "2") == 0
    summary = content_of(tmp_path / "run", "summary.json")
    assert summary["executions"]["attempted"] == 0
    assert summary["epsilon"] == 0.0
    config = content_of(tmp_path / "run", "config.json")["resolved"]
    expected = dict(zip(VASE.objects, map(list, VASE.first_layout), strict=True))
    assert config["first_layout"] == expected


def test_the_arm_acts_only_as_often_as_told(tmp_path):
    options = ("--num-queries", "2", "--execute", "1", "--strategy", "random")
    assert start(tmp_path / "run", *options, task="spoon") == 0
    assert [row["success"] for row in rows_of(tmp_path / "run")] == ["True", "", ""]
    story = tell(tmp_path / "run" / "recording.rrd")
    assert "`random`" in story


def test_the_spoon_is_commanded_where_it_fits_or_into_the_bowl(tmp_path):
    assert start(tmp_path / "run", "--num-queries", "1", task="spoon") == 0
    asked = layouts_of(tmp_path / "run", SPOON)[1]
    space = LayoutSpace.of_task(SPOON, are_points=False)
    free = space.free_space(asked, SPOON.receptacles)
    assert free.contains(commanded_in(rows_of(tmp_path / "run")[0]))


def test_a_run_can_have_a_worse_arm(tmp_path):
    options = ("--num-queries", "1", "--fast", "--item-noise-mm", "3")
    assert start(tmp_path / "run", *options) == 0
    options = content_of(tmp_path / "run", "config.json")["options"]
    assert (options["fast"], options["item_noise_mm"]) == (True, 3.0)
    assert float(rows_of(tmp_path / "run")[0]["execution_error_mm"]) > 0.3


def test_an_interrupted_run_keeps_what_was_finished(tmp_path, monkeypatch, capsys):
    attempts = iter([Arm.place])

    def place_once(*args, **kwargs):
        try:
            return next(attempts)(*args, **kwargs)
        except StopIteration:
            raise KeyboardInterrupt from None

    monkeypatch.setattr(Arm, "place", place_once)
    assert start(tmp_path / "run", "--num-queries", "3") == 130
    error = capsys.readouterr().err
    assert "interrupted; 1 finished round" in error
    assert "Traceback" not in error
    assert len(rows_of(tmp_path / "run")) == 1
    assert not (tmp_path / "run" / "summary.json").exists()
    assert "1 demonstration" in tell(tmp_path / "run" / "recording.rrd")


def test_an_earlier_run_is_replaced_only_when_told(vase_run, tmp_path, capsys):
    copy = tmp_path / "copy"
    shutil.copytree(vase_run, copy)
    before = (copy / "rounds.csv").read_text()
    assert start(copy) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (copy / "rounds.csv").read_text() == before
    assert start(copy, "--overwrite", "--num-queries", "0") == 0
    assert len(rows_of(copy)) == 1
