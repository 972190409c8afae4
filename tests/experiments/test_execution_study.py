import re
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
import quick_cli
from quick_cli import content_of, rows_of

from tablesetting.experiments.execution_results import executions, refusals
from tablesetting.experiments.execution_study import (
    columns,
    draw_request,
    run_trial,
)
from tablesetting.experiments.study_config import ExecutionStudyConfig
from tablesetting.experiments.trials import Trial
from tablesetting.planner.goal import Reason, gap_at
from tablesetting.planner.receptacle import RECEPTACLES
from tablesetting.reward.tasks import SPOON
from tablesetting.scene.perception import Camera

OPTIONS = ("--num-trials", "3")
CONFIG = ExecutionStudyConfig(num_trials=3)


def study(out, *options, jobs="1"):
    argv = ["study", "execution", "--out", str(out), "--jobs", jobs, *options]
    return quick_cli.main(argv)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studies") / "whole"
    assert study(folder, *OPTIONS) == 0
    return folder


def some_rows(folder, task, trials):
    return [
        each
        for each in rows_of(folder)
        if each["task"] == task and each["trial"] in trials
    ]


def commanded(out, *options):
    """The same study in another process."""
    argv = ["study", "execution", "--out", str(out), "--jobs", "1", *options]
    return [sys.executable, quick_cli.__file__, *argv]


def row(**cells):
    """A placement that went well, but for what is said."""
    well = {
        **dict.fromkeys(("task", "goal", "request", "refusal", "fault"), ""),
        **{"task": "vase", "goal": "table", "success": "1", "error_mm": "0.2"},
        **{"yaw_error_deg": "0.0", "tilt_deg": "0.01", "inside": "0"},
        **{"shift_mm": "0.0", "touched": "0", "tries": "1", "speed_share": "0.9"},
        **{"torque_share": "0.1", "overrun_rad": "0.0", "simulated_seconds": "6"},
        "moved": "1",
    }
    return well | cells


def refused(reason, **cells):
    empty = dict.fromkeys(("error_mm", "tilt_deg", "shift_mm", "tries", "touched"), "")
    return row(refusal=reason, success="0", moved="0", **empty) | cells


def test_a_study_leaves_rows_summary_figure_and_table(whole):
    names = {str(path.relative_to(whole)) for path in whole.rglob("*.*")}
    assert names == {
        "config.json",
        "rounds.csv",
        "summary.json",
        "execution.md",
        "figures/execution.png",
    }
    assert content_of(whole, "config.json")["command"] == "study execution"


def test_every_trial_asks_for_each_kind_of_goal(whole):
    rows = rows_of(whole)
    assert list(rows[0]) == columns(CONFIG)
    assert [(each["task"], each["trial"], each["goal"]) for each in rows] == [
        (task, str(trial), goal)
        for task, goals in (
            ("vase", ("table", "infeasible")),
            ("spoon", ("table", "bowl", "infeasible")),
        )
        for trial in range(3)
        for goal in goals
    ]


def test_what_can_be_done_is_done_well(whole):
    for each in rows_of(whole):
        if each["request"]:
            continue
        assert each["success"] == "1", each
        assert float(each["error_mm"]) < (6.0 if each["goal"] == "bowl" else 0.6)
        assert float(each["shift_mm"]) < 0.1
        assert (each["touched"], each["tries"], each["moved"]) == ("0", "1", "1")
        assert each["inside"] == str(int(each["goal"] == "bowl"))
        assert float(each["speed_share"]) <= 1.0
        assert float(each["overrun_rad"]) == 0.0


def test_what_cannot_be_done_is_refused_with_its_reason_before_any_motion(whole):
    requests = [each for each in rows_of(whole) if each["request"]]
    assert {each["request"] for each in requests} == {
        "outside",
        "occupied",
        "unreachable",
    }
    for each in requests:
        assert each["refusal"] == each["request"]
        assert (each["moved"], each["success"], each["error_mm"]) == ("0", "0", "")


def test_the_cells_of_a_row_are_what_they_should_be(whole):
    measured = columns(CONFIG)[10:21]
    assert (measured[0], measured[-1]) == ("error_mm", "simulated_seconds")
    for each in rows_of(whole):
        assert re.fullmatch("[0-9a-f]{12}", each["state"])
        assert (each["success"], each["moved"]) in {("1", "1"), ("0", "0")}
        assert np.isfinite([float(each[name]) for name in ("x", "y")]).all()
        assert (each["yaw_deg"] != "") == (each["goal"] == "table")
        cells = [each[name] for name in measured]
        if each["refusal"]:
            assert cells == [""] * len(measured)
        else:
            assert np.isfinite([float(cell) for cell in cells]).all()


def draws(goal, scene, num):
    rng = np.random.default_rng(0)
    return [draw_request(goal, scene, Trial("spoon", k), rng=rng) for k in range(num)]


def test_places_in_the_bowl_are_spread_evenly_over_its_disc(spoon_scene):
    found = [each.target for each in draws("bowl", spoon_scene, 1000)]
    offsets = np.array(found) - spoon_scene.position("bowl")[:2]
    shares = (
        np.linalg.norm(offsets, axis=1) / RECEPTACLES["spoon", "bowl"].radius
    ) ** 2
    assert shares.max() <= 1.0
    np.testing.assert_allclose(
        np.quantile(shares, [0.25, 0.5, 0.75]), [0.25, 0.5, 0.75], atol=0.05
    )
    np.testing.assert_allclose(offsets.mean(axis=0), 0.0, atol=1e-3)


def test_places_on_the_table_are_on_the_square_and_clear_of_objects(spoon_scene):
    seen = Camera(spoon_scene).look()
    for each in draws("table", spoon_scene, 30):
        place = spoon_scene.frame.from_world(each.target)
        assert ((place >= 0.0) & (place <= 1.0)).all()
        for name in spoon_scene.objects:
            gap = gap_at(spoon_scene, seen, each.target, each.yaw, name)
            assert gap >= 0.5 * SPOON.clearance


def test_what_cannot_be_done_takes_turns(spoon_scene):
    found = [each.expected for each in draws("infeasible", spoon_scene, 6)]
    assert found == 2 * [Reason.OUTSIDE, Reason.OCCUPIED, Reason.UNREACHABLE]


def test_rows_do_not_depend_on_the_number_of_processes(whole, tmp_path):
    options = ("--num-trials", "2", "--tasks", "vase")
    assert study(tmp_path / "two", *options, jobs="2") == 0
    assert rows_of(tmp_path / "two") == some_rows(whole, task="vase", trials="01")


def test_final_states_are_the_same_to_the_bit_in_fresh_processes(whole):
    code = """
from tablesetting.experiments.execution_study import run_trial
from tablesetting.experiments.study_config import ExecutionStudyConfig
from tablesetting.experiments.trials import Trial
config = ExecutionStudyConfig(num_trials=1, tasks=("spoon",), goals=("table", "bowl"))
print(*[row["state"] for row in run_trial(config, Trial("spoon", 0))])
"""
    first, second = (
        subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True
        ).stdout.split()
        for _ in range(2)
    )
    rows = some_rows(whole, task="spoon", trials="0")
    assert first == second == [each["state"] for each in rows if not each["request"]]


def test_a_study_that_is_killed_goes_on_to_the_same_rows(whole, tmp_path):
    """With SIGKILL, as soon as a trial is on the disk."""
    folder, options = tmp_path / "study", ("--num-trials", "3", "--tasks", "vase")
    table = folder / "rounds.csv"
    started = subprocess.Popen(
        commanded(folder, *options),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while started.poll() is None and not (table.exists() and table.stat().st_size):
        time.sleep(0.01)
    started.kill()
    started.wait()
    assert not (folder / "summary.json").exists()
    kept = table.read_text()
    assert 1 < kept.count("\n") < 7
    assert study(folder, *options, "--resume") == 0
    assert table.read_text().startswith(kept)
    assert rows_of(folder) == some_rows(whole, task="vase", trials="012")


def test_a_trial_is_the_same_whatever_else_is_done(whole):
    config = ExecutionStudyConfig(num_trials=99, tasks=("spoon",), goals=("bowl",))
    (alone,) = run_trial(config, Trial("spoon", 2))
    (among,) = (
        each
        for each in rows_of(whole)
        if (each["task"], each["goal"], each["trial"]) == ("spoon", "bowl", "2")
    )
    assert {name: str(cell) for name, cell in alone.items()} == among


@pytest.mark.parametrize("num_letters", [1, 700])
def test_a_cut_table_is_made_whole_on_resume(whole, tmp_path, num_letters):
    """A row that was cut short is done again, with the rest of its trial."""
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    (folder / "summary.json").unlink()
    table = folder / "rounds.csv"
    text = table.read_text()
    table.write_text(text[:-num_letters])
    assert study(folder, *OPTIONS, "--resume") == 0
    assert table.read_text() == text
    assert content_of(folder, "summary.json") == content_of(whole, "summary.json")


@pytest.mark.parametrize("column", ["error_mm", "success", "x", "torque_share"])
def test_a_row_that_lacks_a_number_is_done_again(whole, tmp_path, column):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    table = folder / "rounds.csv"
    text = table.read_text()
    header, first, *others = text.splitlines(keepends=True)
    cells = first.split(",")
    cells[header.split(",").index(column)] = ""
    table.write_text("".join([header, ",".join(cells), *others]))
    assert study(folder, *OPTIONS, "--resume") == 0
    assert table.read_text() == text


def test_an_earlier_study_stays_unless_told(whole, capsys):
    before = (whole / "rounds.csv").read_text()
    assert study(whole, *OPTIONS) == 2
    error = capsys.readouterr().err
    assert "exists already; go on with it by --resume" in error
    assert "pass --overwrite" in error
    assert study(whole, *OPTIONS, "--fast", "--resume") == 2
    assert "fast = False, not True" in capsys.readouterr().err
    assert (whole / "rounds.csv").read_text() == before


REFUSED = ("--tasks", "vase", "--goals", "infeasible", "--fast")


def test_an_earlier_study_is_replaced_when_told(tmp_path):
    for seed in ("0", "1"):
        options = (*REFUSED, "--num-trials", "1", "--seed", seed, "--overwrite")
        assert study(tmp_path / "one", *options) == 0
        assert study(tmp_path / seed, *options) == 0
    assert content_of(tmp_path / "one", "summary.json")["seed"] == 1
    assert rows_of(tmp_path / "one") == rows_of(tmp_path / "1")
    assert rows_of(tmp_path / "0") != rows_of(tmp_path / "1")


def test_shards_make_the_whole(tmp_path):
    options = (*REFUSED, "--num-trials", "3")
    assert study(tmp_path / "all", *options) == 0
    parts = [str(tmp_path / name) for name in ("one", "two")]
    for index, part in enumerate(parts, start=1):
        assert study(part, *options, "--shard", f"{index}/2") == 0
    merged = tmp_path / "merged"
    argv = ["study", "execution", "--out", str(merged), "--merge", *parts]
    assert quick_cli.main(argv) == 0
    for name in ("rounds.csv", "config.json", "execution.md"):
        assert (merged / name).read_text() == (tmp_path / "all" / name).read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--goals", "bowl"), "--goals must name one for the vase as well"),
        (("--goals",), "--goals must name one at least, and each once; got none"),
        (("--goals", "table", "table"), "each once"),
        (("--item-noise-mm", "-1"), "--item-noise-mm must be in [0, 100]"),
        (("--mass-spread", "nan"), "--mass-spread must be in [0, 10]"),
        (("--num-trials", "0"), "--num-trials must be at least 1"),
    ],
)
def test_senseless_options_are_refused(tmp_path, capsys, options, message):
    with pytest.raises(SystemExit, match="2"):
        study(tmp_path / "out", *options)
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_noise_of_the_senses_is_in_the_errors(tmp_path):
    options = ("--num-trials", "4", "--tasks", "vase", "--goals", "table", "--fast")
    assert study(tmp_path / "seen", *options, "--item-noise-mm", "2") == 0
    (each,) = content_of(tmp_path / "seen", "summary.json")["executions"]
    assert each["success"] == {"count": 4, "total": 4}
    assert 0.5 < each["quantiles"]["error_mm"]["median"] < 6.0
    title = (tmp_path / "seen" / "execution.md").read_text().splitlines()[0]
    assert title.endswith("4 layouts, seed 0, fast, item-noise-mm 2.0.")


def test_summary_and_table_are_of_the_rows(whole):
    summary = content_of(whole, "summary.json")
    rows = rows_of(whole)
    for each, written in zip(executions(rows), summary["executions"], strict=True):
        own = [
            float(cells["error_mm"])
            for cells in rows
            if (cells["task"], cells["goal"]) == (each.task, each.goal)
        ]
        assert written["quantiles"]["error_mm"]["max"] == pytest.approx(
            max(own), abs=1e-6
        )
        assert written["success"] == {"count": 3, "total": 3}
    assert len(summary["refusals"]) == len(list(refusals(rows))) == 6
    text = (whole / "execution.md").read_text()
    assert "| | vase, table | spoon, table | spoon, bowl |" in text
    assert "| refused for that reason | 1 of 1 |" in text


def test_refusals_and_faults_are_no_successes():
    rows = [
        *[row(error_mm=str(error)) for error in (0.1, 0.2, 0.6)],
        row(success="0", fault="misplaced", error_mm="12", touched="2", tries="2"),
        refused("blocked"),
    ]
    (found,) = executions(rows)
    assert (found.success.count, found.success.total) == (3, 5)
    assert found.refused == {"blocked": 1}
    assert found.failed == {"misplaced": 1}
    assert (found.touched.count, found.touched.total) == (1, 4)
    assert found.num_retries == 1
    quantiles = found.quantiles["error_mm"]
    assert quantiles["median"] == pytest.approx(0.4)
    assert quantiles["max"] == 12.0


def test_where_all_is_refused_nothing_is_measured():
    (found,) = executions([refused("blocked"), refused("too tall")])
    assert found.quantiles == {}
    assert found.success.total == 2


def test_a_refusal_for_another_reason_does_not_count():
    rows = [
        refused("outside", request="outside"),
        refused("blocked", request="outside"),
        row(request="outside"),
    ]
    (found,) = refusals(rows)
    assert (found.refused.count, found.refused.total) == (1, 3)
    assert found.moved.count == 1
    assert not list(executions(rows))


def test_infeasible_requests_alone_make_a_study(tmp_path):
    assert study(tmp_path / "out", *REFUSED, "--num-trials", "1") == 0
    assert content_of(tmp_path / "out", "summary.json")["executions"] == []
    assert (tmp_path / "out" / "figures" / "execution.png").exists()
