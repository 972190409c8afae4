import csv
import json
from pathlib import Path

import numpy as np
import pytest
import refusals
from scipy.optimize import minimize, root

from tablesetting import cli
from tablesetting.bootstrap import estimate
from tablesetting.reward.files import demonstrations_to_json, weights_to_json
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import RbfWidths
from tablesetting.reward.tasks import SPOON, VASE

VASE_DEMOS = Path(__file__).parents[1] / "data" / "vase_demonstrations.json"
WIDTHS = RbfWidths(0.25, 0.4)
GUESS = np.array([-0.2, 0.1, -0.05, -0.1, 0.1, 0, 0, 0.05, 0.4, 0.1, 0, 0, -0.1])


def weights_file(path, weights=GUESS, task=VASE, widths=WIDTHS):
    path.write_text(json.dumps(weights_to_json(weights, task, widths)))
    return str(path)


@pytest.fixture
def weights(tmp_path):
    return weights_file(tmp_path / "weights.json")


def validate(tmp_path, *argv, name="out"):
    """Run the command; return its summary and its rows."""
    out = tmp_path / name
    assert cli.main(["validate", *map(str, argv), "--out", str(out)]) == 0
    with (out / "layouts.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return json.loads((out / "summary.json").read_text()), rows


def numbers(row, *names):
    return np.array([[float(row[f"{name}_{axis}"]) for axis in "xy"] for name in names])


def best_by_hand(weights, layout, object_width, table_width):
    """Find the best placement by a fine grid and a descent, without the package."""
    fixed = [(x, y) for y in (1.0, 0.5, 0.0) for x in (0.0, 0.5, 1.0)]
    centers = np.vstack([layout, fixed])
    widths = np.r_[np.full(len(layout), object_width), np.full(9, table_width)]

    def loss(point):
        return -weights @ np.exp(-((point - centers) ** 2).sum(axis=1) / widths)

    def slope(point):
        bumps = weights * np.exp(-((point - centers) ** 2).sum(axis=1) / widths)
        return (2.0 * bumps / widths) @ (point - centers)

    ticks = np.linspace(0.0, 1.0, 61)
    start = min(((x, y) for x in ticks for y in ticks), key=loss)
    options = {"ftol": 1e-16, "gtol": 1e-13}
    bounds = [(0.0, 1.0)] * 2
    found = minimize(loss, start, jac=slope, bounds=bounds, options=options)
    is_inside = ((found.x > 0.0) & (found.x < 1.0)).all()
    return root(slope, found.x, tol=1e-13).x if is_inside else found.x


def test_errors_are_those_of_a_direct_evaluation(tmp_path, weights):
    summary, rows = validate(tmp_path, weights, "--num-layouts", 12)
    errors = []
    for row in rows:
        layout = numbers(row, *VASE.objects)
        robot = best_by_hand(GUESS / np.abs(GUESS).sum(), layout, 0.25, 0.4)
        wanted = best_by_hand(VASE.true_weights, layout, 0.3, 0.3)
        errors.append(np.linalg.norm(robot - wanted))
        assert float(row["error"]) == pytest.approx(errors[-1], abs=1e-9)
    assert len(rows) == 12
    found = summary["validated"][0]
    assert found["mean_placement_error"] == pytest.approx(np.mean(errors), abs=1e-9)
    assert found["max_placement_error"] == pytest.approx(max(errors), abs=1e-9)
    interval = found["placement_error"]["mean"]
    assert interval["low"] < interval["value"] < interval["high"]


def test_the_truth_has_no_error_and_the_same_seed_the_same_layouts(tmp_path, weights):
    truth = weights_file(tmp_path / "truth.json", VASE.true_weights, widths=RbfWidths())
    paired, rows = validate(tmp_path, truth, weights, "--num-layouts", 20)
    assert paired["validated"][0]["max_placement_error"] == 0.0
    single, others = validate(tmp_path, weights, "--num-layouts", 20, name="single")
    assert paired["validated"][1] == single["validated"][0] | {
        "placement_error": paired["validated"][1]["placement_error"]
    }
    for row, other in zip(rows[1::2], others, strict=True):
        assert row | {"row": ""} == other | {"row": ""}
    difference = paired["paired"]["first_minus_second"]
    mean = single["validated"][0]["mean_placement_error"]
    assert difference["value"] == pytest.approx(-mean)
    assert difference["high"] < 0.0
    assert paired["paired"]["share_where_first_is_better"] == 1.0


def test_weights_against_themselves_agree(tmp_path, weights):
    summary, _ = validate(tmp_path, weights, "--against", weights, "--num-layouts", 5)
    assert summary["validated"][0]["max_placement_error"] == 0.0


@pytest.mark.parametrize("suffix", ["json", "csv"])
def test_recorded_placements_bring_their_own_layouts(tmp_path, weights, suffix):
    layout = np.array([[0.2, 0.3], [0.2, 0.3], [0.2, 0.75], [0.75, 0.25]])
    robot = best_by_hand(GUESS / np.abs(GUESS).sum(), layout, 0.25, 0.4)
    shown = [robot + [0.03, -0.04], robot]
    file = tmp_path / f"shown.{suffix}"
    demos = [Demonstration(layout, place) for place in shown]
    content = json.dumps(demonstrations_to_json(demos, VASE))
    if suffix == "csv":
        names = [
            f"{name}_{axis}" for name in (*VASE.objects, "placement") for axis in "xy"
        ]
        cells = [[*layout.ravel().tolist(), *place.tolist()] for place in shown]
        content = "\n".join(",".join(map(str, row)) for row in [names, *cells])
    file.write_text(content)
    _, rows = validate(tmp_path, weights, "--against", file)
    assert float(rows[0]["error"]) == pytest.approx(0.05, abs=1e-9)
    assert float(rows[1]["error"]) == pytest.approx(0.0, abs=1e-9)


def test_the_arm_carries_out_some_and_a_validation_goes_on(tmp_path, weights, capsys):
    argv = ["validate", weights, "--num-layouts", "6", "--execute", "3", "--jobs", "1"]
    out = tmp_path / "out"
    assert cli.main([*argv, "--out", str(out)]) == 0
    table, summary = out / "layouts.csv", out / "summary.json"
    whole, figures = table.read_text(), summary.read_text()
    executions = json.loads(figures)["validated"][0]["executions"]
    assert executions["succeeded"] == executions["attempted"] == 3
    assert 0.0 < executions["max_error_mm"] < 1.0
    assert "the arm placed 3 of 3 (100%)" in capsys.readouterr().out
    lines = whole.splitlines(keepends=True)
    # Killed in the midst of the last row but one; rows stand as they were finished.
    table.write_text("".join([lines[0], *lines[4:], lines[2], lines[1][:-9]]))
    summary.unlink()
    assert cli.main([*argv, "--resume", "--out", str(out)]) == 0
    assert table.read_text() == whole
    assert summary.read_text() == figures


def test_two_are_carried_out_alike_by_any_number_of_processes(tmp_path, weights):
    other = weights_file(tmp_path / "other.json", VASE.true_weights)
    argv = [weights, other, "--num-layouts", 3, "--execute", 2]
    argv += ["--item-noise-mm", 3, "--mass-spread", 0.3]
    alone, rows = validate(tmp_path, *argv, "--jobs", 1)
    assert (alone, rows) == validate(tmp_path, *argv, "--jobs", 2, name="together")
    assert [bool(row["success"]) for row in rows] == [True] * 4 + [False] * 2
    for which, found in enumerate(alone["validated"]):
        own = rows[which:4:2]
        errors = [float(row["execution_error_mm"]) for row in own]
        executions = found["executions"]
        assert executions["median_error_mm"] == pytest.approx(np.mean(errors))
        assert executions["max_error_mm"] == max(errors) > 1.0
        assert executions["mean_placement_error"] == pytest.approx(
            np.mean([float(row["error"]) for row in own])
        )


def test_a_single_layout_has_no_intervals(tmp_path, weights, capsys):
    summary, _ = validate(tmp_path, weights, "--num-layouts", 1)
    mean = summary["validated"][0]["placement_error"]["mean"]
    assert mean["low"] is mean["high"] is None
    assert f"mean {mean['value']:.4f}, median" in capsys.readouterr().out


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["a$b$c.json", "\u91cd\u307f.json", "a b'c.json"])
def test_files_can_have_any_name(tmp_path, weights, name):
    odd = tmp_path / name
    Path(weights).rename(odd)
    summary, _ = validate(tmp_path, odd, "--num-layouts", 3)
    assert summary["validated"][0]["weights"] == str(odd)


def test_a_mean_is_as_exact_as_its_standard_error():
    values = np.random.default_rng(0).exponential(size=400)
    found = estimate(values, rng=np.random.default_rng(1))
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert found["mean"].value == pytest.approx(values.mean())
    assert found["mean"].high - found["mean"].low == pytest.approx(2 * half, rel=0.1)
    assert found["max"].value == found["max"].high == values.max()
    assert found["p90"].low < np.log(10) < found["p90"].high


def refusal(capsys, *argv, command="validate"):
    return refusals.refusal(capsys, cli.main, command, *argv)


def test_what_cannot_be_validated_is_refused_in_one_line(tmp_path, weights, capsys):
    spoon = weights_file(tmp_path / "spoon.json", np.eye(15)[0], SPOON)
    out = tmp_path / "out"
    for argv, part in (
        (["no.json"], "no.json"),
        ([weights, weights, weights], "one or two"),
        ([weights, spoon], "is of the task spoon"),
        ([weights, "--against", spoon], "is of the task spoon"),
        ([weights, "--against", "me"], "cannot read 'me'"),
        ([weights, "--execute", "201"], "--execute 201"),
        ([weights, "--execute", "1", "--layouts", "uniform"], "--layouts uniform"),
        ([weights, "--num-layouts", "0"], "--num-layouts"),
        ([weights, "--num-layouts", "1000001"], "at most 1000000"),
        ([weights, "--num-layouts", "5", "--layouts", "some"], "has no effect"),
        (["\udcff.json"], "not UTF-8"),
        ([weights, "--jobs", "0"], "--jobs"),
    ):
        assert part in refusal(capsys, *argv, "--out", out)
        assert not out.exists()
    assert "--resume goes with --out" in refusal(capsys, weights, "--resume")


def test_another_validation_is_not_gone_on_with(tmp_path, weights, capsys):
    out = tmp_path / "out"
    argv = ["validate", weights, "--num-layouts", "5", "--out", str(out)]
    assert cli.main(argv) == 0
    assert "--overwrite" in refusal(capsys, *argv[1:])
    assert "seed = 0, not 1" in refusal(capsys, *argv[1:], "--seed", 1, "--resume")
    other = refusal(capsys, VASE_DEMOS, "--out", out, "--resume", command="learn")
    assert "holds a `validate`" in other
    for options in ([], ["--overwrite"]):
        error = refusal(capsys, VASE_DEMOS, "--out", out, *options, command="learn")
        assert "--resume" not in error
    weights_file(tmp_path / "weights.json", VASE.true_weights)
    assert "sha256" in refusal(capsys, *argv[1:], "--resume")
