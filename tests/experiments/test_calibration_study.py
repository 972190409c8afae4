import json
import shutil
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import quick_cli
from quick_cli import content_of, without_seconds

from tablesetting.curves import Share
from tablesetting.experiments import calibration_study
from tablesetting.experiments.calibration_results import calibrate, write_calibration
from tablesetting.experiments.calibration_study import columns, run_trial
from tablesetting.experiments.learning import learn
from tablesetting.experiments.setup import RunSetup, problem_settings
from tablesetting.experiments.study_config import CalibrationStudyConfig
from tablesetting.experiments.trials import Trial
from tablesetting.irl.risk import spend, upper_bound_rank
from tablesetting.results import RunFolder
from tablesetting.reward.tasks import VASE

TINY = ("--num-trials", "1", "--num-queries", "1", "--num-layouts", "8")
OPTIONS = (*TINY, "--teachers", "noisy", "biased")
CONFIG = CalibrationStudyConfig(
    num_trials=1, num_queries=1, num_layouts=8, teachers=("noisy", "biased")
)


def study(out, *options):
    argv = ["study", "calibration", "--out", str(out), "--jobs", "1", *options]
    return quick_cli.main(argv)


def rows_of(folder):
    return without_seconds(quick_cli.rows_of(folder))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studies") / "whole"
    assert study(folder, *OPTIONS) == 0
    return folder


@pytest.fixture
def quick():
    """Short chains without the command line."""
    with quick_cli.short_chains():
        yield


@pytest.fixture
def mixed():
    """Chains that mix, by an easier measure than usual."""
    with quick_cli.short_chains(quick_cli.MIXED):
        yield


def setup_of(teacher, trial, config=CONFIG):
    run_config = config.run_config(trial.task, teacher)
    return RunSetup.of_config(run_config, trial.seeds(config.seed))


def test_a_study_leaves_rows_summary_figure_and_table(whole):
    names = {str(path.relative_to(whole)) for path in whole.rglob("*.*")}
    assert names == {
        "config.json",
        "rounds.csv",
        "summary.json",
        "calibration.md",
        "figures/calibration.png",
    }
    config = content_of(whole, "config.json")
    assert config["command"] == "study calibration"
    assert config["options"]["teachers"] == ["noisy", "biased"]
    problems = config["resolved"]["problem"]
    assert problems["noisy"]["noise"]["noise_std"] == 0.02
    assert problems["biased"]["noise"]["noise_std"] == 0.01


def test_rows_are_of_every_kind_of_people_after_every_demonstration(whole):
    rows = quick_cli.rows_of(whole)
    assert list(rows[0]) == columns(CONFIG)
    found = [
        (row["task"], row["trial"], row["teacher"], row["num_demos"]) for row in rows
    ]
    assert found == [
        (task, "0", teacher, num_demos)
        for task in ("vase", "spoon")
        for teacher in ("noisy", "biased")
        for num_demos in ("1", "2")
    ]


def test_summary_and_tables_are_of_the_rows(whole):
    summary = content_of(whole, "summary.json")
    assert summary["command"] == "study calibration"
    found = list(calibrate(quick_cli.rows_of(whole), CONFIG))
    assert len(found) == len(summary["calibration"]) == 2 * 2
    for each, written in zip(found, summary["calibration"], strict=True):
        assert (written["teacher"], written["num_demos"]) == (
            each.teacher,
            each.num_demos,
        )
        assert written["num_unbounded"] + written["covered"]["total"] == 2
        assert written["unfit"]["count"] == each.unfit.count
        error = pytest.approx(each.mean_placement_error, abs=1e-6)
        assert written["mean_placement_error"] == error
    text = (whole / "calibration.md").read_text()
    assert "2 preferences, 2 kinds of people, seed 0" in text
    for each in found:
        assert f"\n## {each.teacher}\n" in text
        assert str(each.covered) in text


def test_a_cut_table_is_made_whole_on_resume(whole, tmp_path):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    table = folder / "rounds.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:7]))
    assert study(folder, *OPTIONS, "--resume") == 0
    assert rows_of(folder) == rows_of(whole)


def test_a_finished_study_is_not_done_again_on_resume(whole, tmp_path):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    before = (folder / "rounds.csv").read_text()
    assert study(folder, *OPTIONS, "--resume") == 0
    assert (folder / "rounds.csv").read_text() == before  # To the second.


def test_a_study_of_other_people_or_another_kind_is_not_gone_on_with(whole, capsys):
    assert study(whole, *TINY, "--teachers", "noisy", "--resume") == 2
    expected = "teachers = ['noisy', 'biased'], not ['noisy']"
    assert expected in capsys.readouterr().err
    other = ["study", "placement", *TINY, "--out", str(whole), "--resume"]
    assert quick_cli.main(other) == 2
    expected = "command = 'study calibration', not 'study placement'"
    assert expected in capsys.readouterr().err


def test_shards_merge_to_the_whole_and_not_with_another_study(whole, tmp_path, capsys):
    parts = [str(tmp_path / f"part{index}") for index in (1, 2)]
    for index, part in enumerate(parts, start=1):
        assert study(part, *OPTIONS, "--shard", f"{index}/2") == 0
    merge = ["study", "calibration", "--out", str(tmp_path / "merged"), "--merge"]
    assert quick_cli.main([*merge, *parts]) == 0
    assert rows_of(tmp_path / "merged") == rows_of(whole)
    for name in ("config.json", "calibration.md"):
        text = (tmp_path / "merged" / name).read_text()
        assert text == (whole / name).read_text()
    other = str(tmp_path / "other")
    options = ("--num-trials", "1", "--num-queries", "0", "--jobs", "1")
    assert quick_cli.main(["study", "placement", "--out", other, *options]) == 0
    capsys.readouterr()
    assert quick_cli.main([*merge, parts[0], other, "--overwrite"]) == 2
    assert "command = 'study placement'" in capsys.readouterr().err


def test_a_trial_is_the_same_in_any_study(whole, quick):
    """Of other kinds of people and tasks, and of more trials and queries."""
    other = replace(CONFIG, tasks=("spoon",), num_trials=9, teachers=("biased",))
    expected = [
        row
        for row in rows_of(whole)
        if (row["task"], row["teacher"]) == ("spoon", "biased")
    ]
    for row, known in zip(run_trial(other, Trial("spoon", 0)), expected, strict=True):
        assert {name: str(row[name]) for name in known} == known


def test_all_kinds_of_people_want_the_same_and_answer_the_same_layouts(quick):
    trial = Trial("vase", 0)
    config = CalibrationStudyConfig(num_trials=1, num_queries=1, num_layouts=4)
    setups = {teacher: setup_of(teacher, trial, config) for teacher in config.teachers}
    usual = setups["exact"]
    for setup in setups.values():
        weights = setup.problem.task.true_weights
        np.testing.assert_array_equal(weights, usual.problem.task.true_weights)
        np.testing.assert_array_equal(
            setup.validation.layouts, usual.validation.layouts
        )
        assert setup.problem.config.are_points
    answered, shown = {}, {}
    for teacher in ("exact", "boltzmann", "biased"):
        *_, latest = islice(learn(setups[teacher], "random"), 2)
        answered[teacher] = [demo.layout.tolist() for demo in latest.learning.demos]
        shown[teacher] = [demo.placement.tolist() for demo in latest.learning.demos]
    assert answered["exact"] == answered["boltzmann"] == answered["biased"]
    assert shown["exact"] != shown["biased"]


def test_every_trial_is_of_another_preference():
    wanted = [
        setup_of("exact", Trial("vase", index)).problem.task.true_weights
        for index in range(4)
    ]
    assert len({tuple(weights) for weights in [*wanted, VASE.true_weights]}) == 5
    np.testing.assert_allclose(np.abs(wanted).sum(axis=1), 1.0)


def test_each_kind_is_learned_from_with_the_likelihood_made_for_it():
    settings = {
        teacher: problem_settings(CONFIG.run_config("vase", teacher))
        for teacher in CalibrationStudyConfig().teachers
    }
    assert settings.pop("boltzmann").likelihood == "boltzmann"
    assert {each.likelihood for each in settings.values()} == {"placement"}
    assert settings.pop("noisy").noise.noise_std == 0.02
    assert {each.noise.noise_std for each in settings.values()} == {0.01}


def test_when_chains_may_end_is_the_same_for_all_kinds_and_can_be_chosen():
    usual = CalibrationStudyConfig()
    chosen = replace(usual, target_ess=50.0, max_rhat=1.2, num_steps=3000)
    expected = {usual: (200.0, 1.05, 15_000), chosen: (50.0, 1.2, 3000)}
    for config, settings in expected.items():
        for teacher in config.teachers:
            mcmc = problem_settings(config.run_config("vase", teacher)).mcmc
            assert (mcmc.target_ess, mcmc.max_rhat, mcmc.num_steps) == settings


def test_bounds_of_the_test_layouts_are_those_of_a_run_at_this_look(mixed):
    """Each the order statistic that delta at this look asks for, of its distances."""
    trial = Trial("spoon", 0)
    rows = run_trial(replace(CONFIG, teachers=("biased",)), trial)
    setup = setup_of("biased", trial)
    problem, layouts = setup.problem, setup.validation.layouts
    for row, latest in zip(rows, learn(setup, "random"), strict=False):
        posterior = latest.learning.posterior
        found = problem.best_placements(posterior.weights, layouts)
        best = problem.best_placements(posterior.guessed_weights[None], layouts)
        distances = np.sort(np.linalg.norm(found - best, axis=-1), axis=1)
        num_draws = int(posterior.kept_ess)
        rank = upper_bound_rank(num_draws, 0.95, spend(0.05, row["num_demos"]))
        scaled = int(np.ceil(rank * len(posterior.weights) / num_draws))
        bounds = distances[:, scaled - 1]
        errors = np.linalg.norm(best[:, 0] - problem.wishes(layouts), axis=1)
        assert row["bound"] == pytest.approx(bounds.max(), abs=1e-6)
        assert row["max_placement_error"] == pytest.approx(errors.max(), abs=1e-6)
        assert row["mean_placement_error"] == pytest.approx(errors.mean(), abs=1e-6)
        assert row["one_covered"] == int(errors[0] <= bounds[0])
        assert row["share_covered"] == pytest.approx(np.mean(errors <= bounds))
        assert row["all_covered"] == int(errors.max() <= bounds.max())


@pytest.mark.parametrize(
    ("bounds", "one", "share", "all_of_them"),
    [
        ([0.0] * 8, 0, 0.0, 0),
        ([2.0] * 8, 1, 1.0, 1),
        ([0.0] + [2.0] * 7, 0, 7 / 8, 1),
        ([2.0] + [0.0] * 7, 1, 1 / 8, 1),
    ],
    ids=["none", "all", "but the first", "the first"],
)
def test_errors_are_held_against_the_bounds(
    bounds, one, share, all_of_them, quick, monkeypatch
):
    """Every layout against its own; the largest error against the largest bound."""
    monkeypatch.setattr(
        calibration_study, "var_upper_bound", lambda *_, **__: np.array(bounds)
    )
    config = replace(CONFIG, num_queries=0, teachers=("offset",))
    (row,) = run_trial(config, Trial("vase", 0))
    assert (row["one_covered"], row["all_covered"]) == (one, all_of_them)
    assert row["share_covered"] == pytest.approx(share)
    assert row["bound"] == max(bounds)


def row_of(teacher, num_demos, bound, share, one, all_of_them, fit=0.5, mixed=1):
    """Make a row as rounds.csv has it; the mean error is a tenth of the bound."""
    row = {
        "teacher": teacher,
        "num_demos": num_demos,
        "mean_placement_error": 0.1 * min(bound, 1.0),
        "bound": bound,
        "one_covered": one,
        "share_covered": share,
        "all_covered": all_of_them,
        "fit": fit,
        "has_mixed": mixed,
    }
    return {name: str(cell) for name, cell in row.items()}


COUNTED = replace(CONFIG, num_trials=2, num_queries=0, teachers=("biased", "exact"))
ROWS = [
    row_of("exact", 1, 0.4, 1.0, one=1, all_of_them=1),
    row_of("biased", 1, 0.3, 0.5, one=0, all_of_them=0, fit=0.049),
    row_of("biased", 1, 0.1, 0.0, one=0, all_of_them=0, fit=0.05),
    row_of("biased", 1, 0.2, 0.9, one=1, all_of_them=0, mixed=0),
    row_of("biased", 1, 0.04, 0.0, one=0, all_of_them=0),
    row_of("biased", 1, float("inf"), 1.0, one=1, all_of_them=1, fit=0.01, mixed=0),
]


def test_counts_are_by_kind_and_number_of_demonstrations():
    biased, exact = calibrate(ROWS, COUNTED)
    assert (biased.teacher, biased.num_demos) == ("biased", 1)
    assert biased.num_unbounded == 1
    assert biased.covered == Share(1, 4)
    assert biased.share_covered == pytest.approx(1.4 / 4)
    assert biased.all_covered == Share(0, 4)
    assert biased.unmixed == Share(1, 4)
    assert biased.unfit == Share(1, 4)  # A fit of 0.05 will do.
    assert biased.unfit_where_it_failed == Share(1, 4)
    assert biased.certified == biased.certified_where_it_failed == Share(1, 4)
    assert biased.mean_placement_error == pytest.approx(
        (0.03 + 0.01 + 0.02 + 0.004 + 0.1) / 5
    )
    assert biased.bound == 0.2
    assert exact.covered == exact.all_covered == Share(1, 1)
    assert exact.unmixed == exact.unfit == exact.certified == Share(0, 1)
    assert exact.unfit_where_it_failed == Share(0, 0)


def test_what_was_counted_is_told_kind_by_kind(tmp_path):
    lines = write_calibration(RunFolder.make(tmp_path / "out"), COUNTED, ROWS)
    biased, exact = lines
    assert biased.startswith("biased: within the bound in 35.0%")
    assert "4 times, of which the fit refused 1, and 1 were certified" in biased
    assert exact.startswith("exact: within the bound in 100.0%")
    text = (tmp_path / "out" / "calibration.md").read_text()
    assert "| within its bound [%] | 25.0 (5-70) |" in text
    assert "| the same, all layouts [%] | 35.0% |" in text
    assert "| of the failed, fit refused | 1 of 4 |" in text
    assert "| without a bound | 1 |" in text


def test_an_infinite_bound_is_none_in_the_summary(tmp_path):
    config = replace(COUNTED, teachers=("biased",))
    write_calibration(RunFolder.make(tmp_path / "out"), config, ROWS[-1:])

    def refuse(constant):
        raise ValueError(f"{constant} is not JSON")

    text = (tmp_path / "out" / "summary.json").read_text()
    (each,) = json.loads(text, parse_constant=refuse)["calibration"]
    assert each["bound"] is None
