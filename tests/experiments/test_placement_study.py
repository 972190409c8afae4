import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import quick_cli

from tablesetting import cli
from tablesetting.experiments import study as study_module
from tablesetting.experiments.config import LearningConfig
from tablesetting.experiments.placement_study import columns, run_trial
from tablesetting.experiments.published import published_curves
from tablesetting.experiments.setup import RunSetup
from tablesetting.experiments.study_config import PlacementStudyConfig
from tablesetting.experiments.trials import Trial, all_trials, shard_trials
from tablesetting.irl.active import run_active
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.results import RunFolder
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import VASE

SMALL = ("--num-trials", "3", "--num-queries", "2", "--num-layouts", "20")
TINY = ("--num-trials", "1", "--num-queries", "1", "--num-layouts", "3")
SMALL_CONFIG = PlacementStudyConfig(num_trials=3, num_queries=2, num_layouts=20)


def study(out, *options, jobs=1):
    argv = ["study", "placement", "--out", str(out), "--jobs", str(jobs), *options]
    return cli.main(argv)


def rows_of(folder):
    """Read the table without its seconds."""
    with (folder / "rounds.csv").open(newline="") as file:
        return [
            {name: cell for name, cell in row.items() if not name.endswith("_seconds")}
            for row in csv.DictReader(file)
        ]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studies") / "whole"
    assert study(folder, *SMALL) == 0
    return folder


def test_a_study_leaves_rows_summary_figure_and_comparison(whole):
    names = {str(path.relative_to(whole)) for path in whole.rglob("*.*")}
    assert names == {
        "config.json",
        "rounds.csv",
        "summary.json",
        "comparison.md",
        "figures/placement.png",
        "figures/placement.svg",
    }
    summary = json.loads((whole / "summary.json").read_text())
    assert summary["published"]["num_points"] == 2 * (4 * 3)
    config = json.loads((whole / "config.json").read_text())
    assert config["options"]["tasks"] == ["vase", "spoon"]
    assert config["resolved"]["problem"]["mcmc"]["num_steps"] == 2500
    assert config["versions"]["numba"]


def test_rows_are_in_order_whatever_was_finished_first(whole):
    found = [
        (row["task"], row["trial"], row["strategy"], row["num_demos"])
        for row in rows_of(whole)
    ]
    assert found == [
        (task, str(trial), strategy, str(num_demos))
        for task in ("vase", "spoon")
        for trial in range(3)
        for strategy in ("active-var", "random")
        for num_demos in (1, 2, 3)
    ]


def test_the_summary_is_the_mean_of_the_rows(whole):
    curves = json.loads((whole / "summary.json").read_text())["curves"]
    rows = rows_of(whole)
    for curve in curves:
        values = np.reshape(
            [
                float(row[curve["quantity"]])
                for row in rows
                if (row["task"], row["strategy"]) == (curve["task"], curve["strategy"])
            ],
            (3, 3),
        )
        np.testing.assert_allclose(curve["mean"], values.mean(axis=0), atol=1e-6)
        np.testing.assert_allclose(curve["std"], values.std(axis=0, ddof=1), atol=1e-6)


def test_the_summary_says_how_many_demonstrations_each_strategy_took(whole):
    reached = json.loads((whole / "summary.json").read_text())["reached"]
    assert len(reached) == 2 * 2 * 2  # Tasks, strategies, levels.
    for each in reached:
        errors = np.reshape(
            [
                float(row["mean_placement_error"])
                for row in rows_of(whole)
                if (row["task"], row["strategy"]) == (each["task"], each["strategy"])
            ],
            (3, 3),
        )
        num_missed = np.count_nonzero(errors.min(axis=1) > each["level"])
        assert (each["num_missed"], each["num_trials"]) == (num_missed, 3)


def test_strategies_share_first_demonstration_candidates_and_test_layouts(whole):
    first = [row for row in rows_of(whole) if row["num_demos"] == "1"]
    active = [row for row in first if row["strategy"] == "active-var"]
    random = [row for row in first if row["strategy"] == "random"]
    for one, other in zip(active, random, strict=True):
        assert one | {"strategy": ""} == other | {"strategy": ""}


def test_trials_differ_from_each_other(whole):
    errors = {row["mean_placement_error"] for row in rows_of(whole)}
    assert len(errors) > 20


def test_a_trial_is_the_same_in_any_study(whole):
    """Of other tasks, more trials and fewer queries."""
    other = PlacementStudyConfig(
        tasks=("spoon",), num_trials=50, num_queries=1, num_layouts=20
    )
    found = run_trial(other, Trial("spoon", 2))
    expected = [
        row
        for row in rows_of(whole)
        if (row["task"], row["trial"]) == ("spoon", "2") and row["num_demos"] != "3"
    ]
    for row, known in zip(found, expected, strict=True):
        assert {name: str(row[name]) for name in known} == known


def test_the_bound_has_held_where_no_error_is_above_it(whole):
    rows = rows_of(whole)
    for row in rows:
        holds = float(row["var_bound"]) >= float(row["max_placement_error"])
        assert row["bound_held"] == str(int(holds))
    assert {row["bound_held"] for row in rows} == {"0", "1"}


def test_the_bound_over_the_test_layouts_is_given_on_request():
    """The largest 96th of 100 distances from the guess's placement, over these layouts."""
    config = PlacementStudyConfig(
        num_trials=1, num_queries=3, num_layouts=40, test_bound=True
    )
    held = set()
    for trial in all_trials(config):
        rows = run_trial(config, trial)[:4]  # Those of active-var.
        run_config = config.run_config(trial.task, "active-var")
        setup = RunSetup.of_config(run_config, trial.seeds(config.seed))
        problem, layouts = setup.problem, setup.validation.layouts
        rounds = run_active(
            problem,
            [problem.demonstrate(setup.first_layout, rng=setup.teacher_rng)],
            STRATEGIES["active-var"],
            problem.config.risk,
            rng=setup.rng,
        )
        for row, latest in zip(rows, rounds, strict=False):
            posterior = latest.posterior
            found = problem.best_placements(posterior.weights, layouts)
            best = problem.best_placements(posterior.guessed_weights[None], layouts)
            distances = np.sort(np.linalg.norm(found - best, axis=-1), axis=1)
            bound = distances[:, 95].max()
            assert row["test_var_bound"] == pytest.approx(bound, abs=1e-6)
            holds = bound >= row["max_placement_error"]
            assert row["test_bound_held"] == int(holds)
            held.add(holds)
    assert True in held


def test_a_bound_that_is_exceeded_has_not_held(monkeypatch):
    monkeypatch.setattr(
        "tablesetting.experiments.placement_study.value_at_risk",
        lambda losses, alpha, rank_offset: np.zeros(len(losses)),
    )
    config = PlacementStudyConfig(num_trials=1, num_queries=0, test_bound=True)
    row, _ = run_trial(config, Trial("spoon", 0))
    assert (row["test_var_bound"], row["test_bound_held"]) == (0.0, 0)


def test_rows_do_not_depend_on_the_number_of_processes(whole, tmp_path):
    assert study(tmp_path / "study", *SMALL, jobs=3) == 0
    assert rows_of(tmp_path / "study") == rows_of(whole)


def test_shards_are_all_trials_once_and_merge_to_the_whole(whole, tmp_path, capsys):
    folders = [str(tmp_path / f"part{index}") for index in (1, 2, 3)]
    for index, folder in enumerate(folders, start=1):
        assert study(folder, *SMALL, "--shard", f"{index}/3") == 0
    merge = ["study", "placement", "--out", str(tmp_path / "merged"), "--merge"]
    assert cli.main([*merge, *folders[:2]]) == 2
    assert "2 of them, such as vase 2" in capsys.readouterr().err
    assert cli.main([*merge, *folders, folders[0]]) == 2
    assert "name each shard once" in capsys.readouterr().err
    assert not (tmp_path / "merged").exists()
    assert cli.main([*merge, *folders]) == 0
    assert rows_of(tmp_path / "merged") == rows_of(whole)
    whole_text = (whole / "comparison.md").read_text()
    assert (tmp_path / "merged" / "comparison.md").read_text() == whole_text
    assert "points are within" in whole_text


def test_shards_of_different_studies_do_not_merge(tmp_path, capsys):
    one, other = str(tmp_path / "one"), str(tmp_path / "other")
    quick = ("--num-trials", "1", "--num-queries", "0", "--num-layouts", "3")
    assert study(one, *quick, "--shard", "1/2") == 0
    assert study(other, *quick, "--shard", "2/2", "--seed", "1") == 0
    merge = ["study", "placement", "--merge", one, other, "--out", str(tmp_path / "m")]
    assert cli.main(merge) == 2
    assert "seed = 1, not 0" in capsys.readouterr().err
    assert cli.main(["study", "placement", "--merge", str(tmp_path)]) == 2
    assert "config.json" in capsys.readouterr().err


@pytest.mark.parametrize("num_shards", [1, 4, 6])
def test_every_trial_is_in_one_shard(num_shards):
    shards = [
        shard_trials(
            PlacementStudyConfig(num_trials=3, shard=f"{index + 1}/{num_shards}")
        )
        for index in range(num_shards)
    ]
    together = [trial for shard in shards for trial in shard]
    assert len(together) == 6
    assert set(together) == set(all_trials(SMALL_CONFIG))
    assert max(map(len, shards)) - min(map(len, shards)) <= 1


def test_a_kill_before_the_settings_were_written_leaves_nothing_in_the_way(tmp_path):
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / ".123-config.json").write_text("{")
    quick = ("--num-trials", "1", "--num-queries", "0", "--num-layouts", "3")
    assert study(folder, *quick, "--resume") == 0
    (folder / ".45-rounds.csv").write_text("task,")
    assert study(folder, *quick, "--resume") == 0
    assert not list(folder.rglob(".*"))


@pytest.mark.parametrize(
    "cut", ["mid-trial", "mid-row", "mid-cell", "header", "none", "no number"]
)
def test_a_table_that_was_cut_short_is_made_whole(whole, tmp_path, cut):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    table = folder / "rounds.csv"
    lines = table.read_text().splitlines(keepends=True)
    table.write_text(
        {
            "mid-trial": "".join(lines[:9]),
            "mid-row": "".join(lines[:13]) + lines[13][:20],
            "mid-cell": "".join(lines[:12]) + lines[12][:-3],
            "header": lines[0][:10],
            "none": "",
            "no number": "".join(lines).replace("vase,active-var,1,2,", "&x", 1),
        }[cut]
    )
    assert study(folder, *SMALL, "--resume") == 0
    assert rows_of(folder) == rows_of(whole)


@pytest.mark.parametrize("damage", ["\ufeff", "a;b\n", "num_demos\n1\n"])
def test_a_table_of_other_columns_is_refused_and_kept(whole, tmp_path, capsys, damage):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    table = folder / "rounds.csv"
    text = damage + table.read_text()
    table.write_text(text)
    assert study(folder, *SMALL, "--resume") == 2
    assert "mend it or remove it" in capsys.readouterr().err
    assert table.read_text() == text


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("num_trials", 2.5),
        ("tasks", ["cup"]),
        ("strategies", ["all", "random"]),
        ("preset", "mine"),
        ("likelihood", "best"),
        ("guess", "middle"),
        ("teacher", "me"),
        ("truth", "mine"),
        ("noise", 0),
        ("beta", "much"),
    ],
)
def test_settings_that_make_no_sense_are_refused(whole, tmp_path, capsys, name, value):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    config = json.loads((folder / "config.json").read_text())
    config["options"][name] = value
    (folder / "config.json").write_text(json.dumps(config))
    merge = ["study", "placement", "--merge", str(folder), "--out", str(tmp_path / "m")]
    assert cli.main(merge) == 2
    assert "is not of a study" in capsys.readouterr().err
    assert study(folder, *SMALL, "--resume") == 2
    assert f"{name} = " in capsys.readouterr().err


def test_a_setting_that_is_missing_is_a_difference(whole, tmp_path, capsys):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    config = json.loads((folder / "config.json").read_text())
    del config["options"]["layouts"]  # None, as if it were missing.
    (folder / "config.json").write_text(json.dumps(config))
    assert study(folder, *SMALL, "--resume") == 2
    assert "layouts = None" in capsys.readouterr().err


def test_of_two_that_start_in_one_folder_one_is_refused(tmp_path):
    options = ["--num-trials", "2", "--num-queries", "0", "--num-layouts", "3"]
    command = [sys.executable, "-m", "tablesetting", "study", "placement", *options]
    folder = tmp_path / "study"
    started = [
        subprocess.Popen(
            [*command, "--out", str(folder), "--jobs", "1", "--seed", seed],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for seed in ("1", "2")
    ]
    codes = [process.wait() for process in started]
    assert sorted(codes) == [0, 2]
    seed = str(1 + codes.index(0))
    assert study(tmp_path / "alone", *options, "--seed", seed) == 0
    assert rows_of(folder) == rows_of(tmp_path / "alone")


def test_ctrl_c_in_compiled_code_is_an_interruption(tmp_path, monkeypatch, capsys):
    def interrupt(config, trial):
        raise SystemError("returned a result with an exception set") from (
            KeyboardInterrupt()
        )

    monkeypatch.setattr(study_module, "run_trial", interrupt)
    assert study(tmp_path / "study", *SMALL) == 130
    assert "0 of 6 trials" in capsys.readouterr().err


def prepare(config):
    """Return what a trial is about: how is learned, what is asked, shown and tested."""
    trial = Trial("vase", 0)
    run_config = config.run_config(trial.task, "random")
    setup = RunSetup.of_config(run_config, trial.seeds(config.seed))
    problem = setup.problem
    demo = problem.demonstrate(setup.validation.layouts[0], rng=setup.teacher_rng)
    queries = problem.propose_queries([demo], rng=setup.rng)
    layouts = np.concatenate([setup.validation.layouts, np.array(queries)])
    wishes = setup.validation.true_placements
    return (
        problem.config,
        layouts.tolist(),
        demo.placement.tolist(),
        wishes.tolist(),
    )


@pytest.mark.parametrize(
    "option",
    [
        {"seed": 1},
        {"preset": "default"},
        {"candidates": "any"},
        {"num_candidates": 7},
        {"layouts": "valid"},
        {"num_layouts": 21},
    ],
    ids=str,
)
def test_every_option_reaches_the_trial(option):
    """Queries, answers, tests or how is learned are others with any other setting."""
    usual = prepare(SMALL_CONFIG)
    assert prepare(SMALL_CONFIG) == usual
    assert prepare(replace(SMALL_CONFIG, **option)) != usual


@pytest.mark.parametrize(
    "option",
    [
        {"likelihood": "boltzmann"},
        {"likelihood": "auto"},
        {"guess": "map"},
        {"noise": 0.02},
        {"noise_spread": 0.1},
        {"beta": 20.0},
        {"beta_spread": 0.1},
        {"target_ess": 100.0},
        {"max_rhat": 1.1},
        {"num_steps": 5000},
        {"teacher": "noisy"},
        {"truth": "prior"},
        {"points": True},
    ],
    ids=str,
)
def test_every_option_of_learning_reaches_the_trial(option):
    usual = LearningConfig(likelihood="boltzmann" if "beta" in min(option) else None)
    config = replace(SMALL_CONFIG, preset="default", learning=usual)
    learning = replace(config.learning, **option)
    assert prepare(replace(config, learning=learning)) != prepare(config)


def test_tasks_and_trials_have_streams_of_their_own():
    seeds = [trial.seeds(0) for trial in all_trials(SMALL_CONFIG)]
    drawn = {np.random.default_rng(each).random() for each in seeds}
    assert len(drawn) == len(seeds)


def test_the_papers_test_layouts_are_uniform_points():
    """Objects overlap in many of them, which valid layouts never do."""
    config = PlacementStudyConfig().run_config("vase", "random")
    layouts = RunSetup.of_config(config).validation.layouts
    apart = LayoutSpace.of_task(VASE, are_points=False).are_apart(layouts)
    assert apart.mean() < 0.5


def test_the_columns_are_those_of_the_rows():
    for test_bound in (False, True):
        config = PlacementStudyConfig(
            num_trials=1, num_queries=0, num_layouts=3, test_bound=test_bound
        )
        row, _ = run_trial(config, Trial("vase", 0))
        assert list(row) == columns(config)


def test_finished_trials_are_not_done_again(whole, tmp_path):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    before = (folder / "rounds.csv").read_text()
    assert study(folder, *SMALL, "--resume") == 0
    assert (folder / "rounds.csv").read_text() == before  # The seconds, too.


def test_a_study_is_resumed_with_its_own_settings_only(whole, tmp_path, capsys):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    before = (folder / "rounds.csv").read_text()
    assert study(folder, *SMALL[:-1], "21", "--resume") == 2
    assert "num_layouts = 20, not 21" in capsys.readouterr().err
    assert study(folder, *SMALL) == 2
    assert "exists already" in capsys.readouterr().err
    assert (folder / "rounds.csv").read_text() == before


def test_a_folder_is_written_by_one_process_at_a_time(whole, tmp_path, capsys):
    folder = tmp_path / "study"
    shutil.copytree(whole, folder)
    with RunFolder(folder).locked():
        assert study(folder, *SMALL, "--resume") == 2
        assert study(folder, *SMALL, "--overwrite") == 2
    assert capsys.readouterr().err.count("another process is using") == 2
    assert study(folder, *SMALL, "--resume") == 0


def num_lines(path):
    return path.read_text().count("\n") if path.exists() else 0


def test_a_study_that_is_killed_goes_on_to_the_same_rows(tmp_path):
    """With SIGKILL, twice, as soon as another trial is on the disk."""
    options = ["--num-trials", "8", "--num-queries", "4", "--seed", "3"]
    assert study(tmp_path / "whole", *options) == 0
    folder = tmp_path / "study"
    command = [sys.executable, "-m", "tablesetting", "study", "placement"]
    command += ["--out", str(folder), "--resume", "--jobs", "2", *options]
    table = folder / "rounds.csv"
    num_before = 0
    for _ in range(2):
        started = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        while started.poll() is None and num_lines(table) <= num_before + 1:
            time.sleep(0.01)
        started.send_signal(signal.SIGKILL)
        started.communicate()
        assert num_before < num_lines(table) < 1 + 2 * 8 * 2 * 5
        num_before = num_lines(table)
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert rows_of(folder) == rows_of(tmp_path / "whole")


def test_a_worker_that_is_killed_costs_a_retry_and_nothing_else(tmp_path):
    options = ["--num-trials", "10", "--num-queries", "4", "--seed", "3"]
    assert study(tmp_path / "whole", *options) == 0
    folder = tmp_path / "study"
    command = [sys.executable, "-m", "tablesetting", "study", "placement"]
    command += ["--out", str(folder), "--jobs", "2", *options]
    started = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    num_kills = 0
    while started.poll() is None and num_kills < 2:
        time.sleep(0.3)
        for worker in workers_of(started.pid)[:1]:
            os.kill(worker, signal.SIGKILL)
            num_kills += 1
            time.sleep(1.0)
    _, complaint = started.communicate()
    assert started.returncode == 0, complaint
    assert num_kills > 0
    assert rows_of(folder) == rows_of(tmp_path / "whole")


def workers_of(pid):
    """List the processes that compute for a command."""
    children = []
    with open(f"/proc/{pid}/task/{pid}/children") as file:
        children = file.read().split()
    found = []
    for child in children:
        try:
            with open(f"/proc/{child}/cmdline") as file:
                command = file.read()
        except OSError:
            continue
        if "spawn_main" in command:
            found.append(int(child))
    return found


def test_an_interrupted_study_says_how_to_go_on(tmp_path, monkeypatch, capsys):
    def interrupt(config, trial):
        if trial.index == 2:
            raise KeyboardInterrupt
        return run_trial(config, trial)

    monkeypatch.setattr(study_module, "run_trial", interrupt)
    assert study(tmp_path / "study", *SMALL) == 130
    error = capsys.readouterr().err
    assert "2 of 6 trials" in error
    assert "--resume" in error
    assert len(rows_of(tmp_path / "study")) == 2 * 6


ANOTHER = ("--preset", "default", "--likelihood", "placement", "--points")
ANOTHER += ("--teacher", "noisy", "--truth", "prior", "--candidates", "any")
ANOTHER += ("--noise", "0.02", "--num-candidates", "4")


def quick_study(out, *options):
    """Carry out another study with short chains."""
    argv = ["study", "placement", "--out", str(out), "--jobs", "1"]
    return quick_cli.main([*argv, *TINY, *ANOTHER, *options])


@pytest.fixture(scope="module")
def another(tmp_path_factory):
    """A study of other people, of whom something else is assumed."""
    folder = tmp_path_factory.mktemp("studies") / "another"
    assert quick_study(folder) == 0
    return folder


def test_a_study_may_be_of_other_people_and_another_likelihood(another):
    assert len(rows_of(another)) == 2 * 2 * 2
    config = json.loads((another / "config.json").read_text())
    options, problem = config["options"], config["resolved"]["problem"]
    assert "learning" not in options
    expected = {"likelihood": "placement", "teacher": "noisy", "points": True}
    expected |= {"candidates": "any", "beta": 100.0, "noise": 0.02, "truth": "prior"}
    assert {name: options[name] for name in expected} == expected
    assert problem["likelihood"] == "placement"
    assert problem["noise"]["noise_std"] == 0.02
    summary = json.loads((another / "summary.json").read_text())
    assert summary["published"]["num_points"] == 0  # Of another experiment.
    title, *_ = (another / "comparison.md").read_text().splitlines()
    for setting in (
        "likelihood placement",
        "noise 0.02",
        "teacher noisy",
        "points True",
    ):
        assert setting in title
    assert "beta" not in title


def test_options_of_learning_are_kept_by_resume(another, tmp_path, capsys):
    folder = tmp_path / "study"
    shutil.copytree(another, folder)
    table = folder / "rounds.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:5]))
    assert quick_study(folder, "--resume") == 0
    assert rows_of(folder) == rows_of(another)
    changes = [
        ("--teacher", "exact", "teacher = 'noisy', not 'exact'"),
        ("--likelihood", "auto", "likelihood = 'placement', not 'auto'"),
        ("--noise", "0.03", "noise = 0.02, not 0.03"),
        ("--noise-spread", "0.5", "noise_spread = 0.0, not 0.5"),
    ]
    capsys.readouterr()
    for option, value, message in changes:
        assert quick_study(folder, option, value, "--resume") == 2
        assert message in capsys.readouterr().err
    assert rows_of(folder) == rows_of(another)


def test_options_of_learning_are_kept_by_merge(another, tmp_path, capsys):
    parts = [str(tmp_path / f"part{index}") for index in (1, 2)]
    for index, part in enumerate(parts, start=1):
        assert quick_study(part, "--shard", f"{index}/2") == 0
    merge = ["study", "placement", "--out", str(tmp_path / "merged"), "--merge"]
    assert quick_cli.main([*merge, *parts]) == 0
    assert rows_of(tmp_path / "merged") == rows_of(another)
    settings = (tmp_path / "merged" / "config.json").read_text()
    assert settings == (another / "config.json").read_text()
    file = tmp_path / "part2" / "config.json"
    config = json.loads(file.read_text())
    config["options"]["noise_spread"] = 0.5
    file.write_text(json.dumps(config))
    capsys.readouterr()
    assert quick_cli.main([*merge, *parts, "--overwrite"]) == 2
    assert "noise_spread = 0.5, not 0.0" in capsys.readouterr().err
    del config["options"]["noise_spread"]
    file.write_text(json.dumps(config))
    assert quick_cli.main([*merge, *parts, "--overwrite"]) == 2
    assert "'noise_spread'" in capsys.readouterr().err


def test_all_strategies_are_compared_on_request(tmp_path):
    options = ("--tasks", "vase", "--num-trials", "1", "--num-queries", "0")
    options += ("--num-layouts", "3", "--strategies", "all")
    assert study(tmp_path / "study", *options) == 0
    assert [row["strategy"] for row in rows_of(tmp_path / "study")] == list(STRATEGIES)
    text = (tmp_path / "study" / "comparison.md").read_text()
    for strategy in STRATEGIES:
        assert f"| {strategy}, mean error |" in text
    before = (tmp_path / "study" / "rounds.csv").read_text()
    assert study(tmp_path / "study", *options, "--resume") == 0
    assert (tmp_path / "study" / "rounds.csv").read_text() == before


@pytest.mark.slow
def test_the_study_reproduces_the_published_figure(tmp_path):
    assert study(tmp_path / "study", jobs=2) == 0
    summary = json.loads((tmp_path / "study" / "summary.json").read_text())
    published = summary["published"]
    assert published["num_points"] == 86
    assert published["num_within_error_bars"] >= 0.9 * 86
    for key, curve in published_curves().items():
        if key.strategy == "active-var" and key.quantity == "mean_placement_error":
            (found,) = [
                np.array(each["mean"])
                for each in summary["curves"]
                if (each["task"], each["strategy"], each["quantity"]) == key
            ]
            assert (np.abs(found - curve.means) <= 1.5 * curve.half_stds).all()
    curves = {
        (curve["task"], curve["strategy"]): np.array(curve["mean"])
        for curve in summary["curves"]
        if curve["quantity"] == "mean_placement_error"
    }
    for task in ("vase", "spoon"):
        gain = curves[task, "random"] - curves[task, "active-var"]
        assert (gain[3:] > 0.0).all()
