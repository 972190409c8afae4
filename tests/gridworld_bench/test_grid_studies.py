import csv
import json

import numpy as np
import pytest
from refusals import refusal

from gridworld_bench import cli
from gridworld_bench.experiments import trials
from gridworld_bench.experiments.results import normalized, published_curves
from gridworld_bench.posterior import CoordinateChain
from gridworld_bench.problem import MdpConfig
from tablesetting.curves import CurveKey

SMALL = (
    "--num-trials",
    "2",
    "--num-queries",
    "3",
    "--size",
    "4",
    "--num-features",
    "6",
)
COMMANDS = ("action-queries", "critique-queries")


@pytest.fixture(autouse=True)
def short_chains(monkeypatch):
    short = MdpConfig(CoordinateChain(num_samples=60))
    monkeypatch.setattr(trials, "mdp_config", lambda config: short)


def run(command, out, *options):
    return cli.main([command, *SMALL, "--jobs", "1", "--out", str(out), *options])


def rows_of(out):
    with (out / "rounds.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return [
        {name: cell for name, cell in row.items() if not name.endswith("seconds")}
        for row in rows
    ]


@pytest.mark.parametrize("command", COMMANDS)
def test_a_study_writes_what_it_found(command, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(command, out) == 0
    said = capsys.readouterr().out
    assert "paper: active-var" in said
    assert (out / "comparison.md").read_text() in said
    rows = rows_of(out)
    summary = json.loads((out / "summary.json").read_text())
    num_strategies = len(summary["strategies"])
    assert len(rows) == 2 * 4 * num_strategies
    own = [row for row in rows if row["strategy"] == "random"]
    losses = np.reshape([float(row["policy_loss"]) for row in own], (2, 4))
    found = summary["strategies"]["random"]
    np.testing.assert_allclose(found["mean_policy_loss"], losses.mean(axis=0))
    np.testing.assert_allclose(found["normalized_policy_loss"], normalized(losses))
    firsts = {row["policy_loss"] for row in rows if row["num_queries"] == "0"}
    assert len(firsts) == 2  # All strategies start alike in each of the two worlds.
    assert (out / "figures" / "comparison.png").exists()


def test_few_states_tell_anything_in_a_sparse_world(tmp_path, capsys):
    out = tmp_path / "out"
    argv = ["sparse-barrier", "--num-trials", "3", "--num-queries", "4", "--size", "5"]
    argv += ["--level", "0.2", "--jobs", "1", "--out", str(out)]
    assert cli.main(argv) == 0
    rows = rows_of(out)
    found = json.loads((out / "summary.json").read_text())["strategies"]
    for name in ("active-var", "random"):
        worst = [
            float(row["max_policy_loss"]) for row in rows if row["strategy"] == name
        ]
        counts = []
        for losses in np.reshape(worst, (3, 5)):
            below = [k for k, loss in enumerate(losses) if loss < 0.2]
            counts.append(below[0] + 1 if below else 6)
        assert found[name]["mean_demonstrations"] == pytest.approx(np.mean(counts))
        assert found[name]["num_missed"] == counts.count(6)
        own = [float(row["policy_loss"]) for row in rows if row["strategy"] == name]
        shares = (np.reshape(own, (3, 5)) > 1e-9).mean(axis=0)
        assert found[name]["share_with_loss"] == shares.tolist()
    assert "| random |" in capsys.readouterr().out


def test_the_example_asks_as_in_the_paper(tmp_path, monkeypatch, capsys):
    longer = MdpConfig(CoordinateChain(num_samples=2000))
    monkeypatch.setattr(trials, "mdp_config", lambda config: longer)
    out = tmp_path / "out"
    argv = ["example", "--num-trials", "4", "--jobs", "1", "--out", str(out)]
    assert cli.main(argv) == 0
    found = json.loads((out / "summary.json").read_text())["strategies"]
    assert found["active-var"]["share_next_to_yellow"] == 1.0
    assert found["active-sampling"]["share_next_to_blue"] == 1.0
    assert found["active-sampling"]["share_next_to_yellow"] == 0.0
    assert found["active-var"]["most_frequent"] == [19, 12]


def test_a_normalised_stop_is_counted_by_both_normalisations(tmp_path):
    out = tmp_path / "out"
    argv = ["normalised-stop", *SMALL, "--epsilon", "0.9", "--jobs", "1"]
    assert cli.main([*argv, "--out", str(out)]) == 0
    found = json.loads((out / "summary.json").read_text())["strategies"]["active-var"]
    rows = rows_of(out)
    stops = {
        (row["trial"], row["num_queries"])
        for row in rows
        if float(row["random_normalized_var"]) < 0.9
    }
    assert found["random_normalized"]["num_stopped"] == len({t for t, _ in stops})
    for row in rows:
        assert float(row["random_normalized_loss"]) >= 0.0
        for name in ("normalized_var", "normalized_loss"):
            assert row[name] == "" or float(row[name]) >= 0.0
    table = (out / "rounds.csv").read_text()
    assert cli.main([*argv, "--out", str(out), "--resume"]) == 0
    assert (out / "rounds.csv").read_text() == table  # Nothing was done again.


@pytest.mark.parametrize("name", ["policy_loss", "query", "trial", "var"])
def test_a_row_that_lacks_something_is_done_again(name, tmp_path):
    out = tmp_path / "out"
    assert run("action-queries", out) == 0
    whole = rows_of(out)
    table = out / "rounds.csv"
    header, first, *lines = table.read_text().splitlines(keepends=True)
    cells = first.rstrip("\n").split(",")
    cells[header.split(",").index(name)] = ""
    table.write_text("".join([header, ",".join(cells) + "\n", *lines, "a,b,0\n"]))
    assert run("action-queries", out, "--resume") == 0
    assert rows_of(out) == whole


def test_few_states_start_in_the_bottom_row(tmp_path):
    argv = ["sparse-barrier", "--num-trials", "2", "--num-queries", "2", "--size", "5"]
    argv += ["--num-starts", "2", "--jobs", "1", "--out", str(tmp_path / "out")]
    assert cli.main(argv) == 0
    assert {int(row["query"]) >= 20 for row in rows_of(tmp_path / "out")} == {True}


def test_the_timing_has_both_kinds_of_arc(tmp_path):
    out = tmp_path / "out"
    argv = ["timing", *SMALL, "--size", "3", "--num-trials", "1", "--num-queries", "1"]
    argv += ["--num-samples", "20", "--jobs", "1", "--out", str(out)]
    assert cli.main(argv) == 0
    found = json.loads((out / "summary.json").read_text())["strategies"]
    assert found["arc-faithful"]["query_seconds"] > found["random"]["query_seconds"]
    assert (
        found["arc"]["mean_agreement"] > found["arc-faithful"]["mean_agreement"] - 1.0
    )
    assert found["active-var"]["mean_agreement"] is None


def test_a_study_goes_on_after_a_kill_to_the_same_rows(tmp_path, capsys):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    assert run("action-queries", whole) == 0
    assert run("action-queries", cut) == 0
    table = cut / "rounds.csv"
    header, *lines = table.read_text().splitlines(keepends=True)
    # The last trial came first, others are missing, and one was cut within a cell.
    table.write_text("".join([header, *lines[20:], *lines[:8], lines[8][:-9]]))
    (cut / "summary.json").unlink()
    assert run("action-queries", cut, "--resume") == 0
    assert rows_of(cut) == rows_of(whole)
    assert run("action-queries", cut, "--resume", "--seed", "1") == 2
    assert "seed = 0, not 1" in capsys.readouterr().err
    assert run("action-queries", cut) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_rows_do_not_depend_on_the_processes(tmp_path, monkeypatch):
    monkeypatch.undo()  # Other processes would not have it.
    argv = ["action-queries", *SMALL, "--num-trials", "1", "--strategies", "random"]
    argv += ["active-var"]
    for jobs in ("1", "2"):
        assert cli.main([*argv, "--jobs", jobs, "--out", str(tmp_path / jobs)]) == 0
    assert rows_of(tmp_path / "1") == rows_of(tmp_path / "2")


@pytest.mark.parametrize(
    ("argv", "part"),
    [
        (["fly"], "'fly'"),
        (["action-queries", "--num-trials", "0"], "at least 1"),
        (["action-queries", "--num-trials", "1000001"], "at most 100000"),
        (["action-queries", "--strategies", "arc"], "arc"),
        (["action-queries", "--strategies"], "none"),
        (["critique-queries", "--strategies", "arc", "arc"], "arc arc"),
        (["action-queries", "--size", "1"], "--size"),
        (["example", "--num-queries", "0"], "--num-queries"),
        (["sparse-barrier", "--level", "0"], "--level"),
        (["sparse-barrier", "--num-colors", "0"], "--num-colors"),
        (["sparse-barrier", "--num-starts", "9"], "--num-starts"),
        (["timing", "--num-samples", "4"], "--num-samples"),
        (["timing", "--preset", "default"], "--preset"),
        (["normalised-stop", "--epsilon", "nan"], "--epsilon"),
        (["action-queries", "--seed", "-1"], "--seed"),
        (["action-queries", "--resume"], "--out"),
        (["action-queries", "--preset", "mine"], "mine"),
    ],
)
def test_bad_input_is_refused_in_one_line(argv, part, capsys):
    assert part in refusal(capsys, cli.main, *argv)


def test_the_published_points_begin_before_any_query():
    curve = published_curves()[CurveKey("action-queries", "active-var", "policy_loss")]
    assert curve.num_demos.tolist() == list(range(25))
    assert curve.means[[0, 9, 24]] == pytest.approx([1.7596, 0.5256, 0.3630], abs=1e-4)
