import subprocess
import sys
from typing import get_args

import pytest

from gridworld_bench.experiments.config import ActionStrategy, CritiqueStrategy
from gridworld_bench.strategies import ACTION_METHODS, CRITIQUE_METHODS
from tablesetting.experiments.config import (
    LikelihoodName,
    PresetName,
    StrategyName,
    TaskName,
    TeacherName,
)
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.reward import config as reward_config
from tablesetting.reward.config import PRESETS
from tablesetting.reward.tasks import TASKS
from tablesetting.reward.teachers import TEACHERS

SIMULATORS = ("mujoco", "dm_control", "mink", "rerun", "viser")
LIGHT = ("", ".errors", ".experiments.config", ".experiments.study_config")
IRL = (
    *("active", "arrays", "certificate", "diagnostics", "netcdf", "outlook"),
    *("posterior", "random_walk", "risk", "sampler", "strategies"),
)
REWARD = (
    *("config", "files", "fit", "inference", "layout", "likelihood", "outlook"),
    *("placement", "placement_likelihood", "problem", "rbf", "tasks", "teachers"),
)


def imported_by(*modules):
    """Name every top-level package that a fresh interpreter loads with some modules."""
    code = f"import sys, {', '.join(modules)}\nprint(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return {name.partition(".")[0] for name in done.stdout.split()}


def test_learning_loads_no_simulator():
    modules = [f"tablesetting.irl.{name}" for name in IRL]
    modules += [f"tablesetting.reward.{name}" for name in REWARD]
    loaded = imported_by("tablesetting.irl", "tablesetting.reward", *modules)
    assert "numpy" in loaded
    assert loaded.isdisjoint(SIMULATORS)


def test_results_and_figures_load_no_simulator():
    loaded = imported_by("tablesetting.results", "tablesetting.plotting")
    assert loaded.isdisjoint(SIMULATORS)


def test_a_study_loads_no_simulator():
    """Each of its processes would have to wait for that; but for the arm's own."""
    modules = ("studies", "placement_study", "calibration_study")
    loaded = imported_by(*(f"tablesetting.experiments.{name}" for name in modules))
    assert "numba" in loaded
    assert loaded.isdisjoint({"matplotlib", "h5netcdf", *SIMULATORS})


@pytest.mark.parametrize("module", LIGHT)
def test_the_package_and_its_settings_are_light(module):
    loaded = imported_by(f"tablesetting{module}")
    assert loaded.isdisjoint({"numpy", "numba", "matplotlib", *SIMULATORS})


@pytest.mark.parametrize(
    ("choices", "table"),
    [
        (TaskName, TASKS),
        (StrategyName, STRATEGIES),
        (PresetName, PRESETS),
        (TeacherName, TEACHERS),
        (LikelihoodName, get_args(reward_config.LikelihoodName)),
    ],
)
def test_choices_on_the_command_line_are_the_keys_of_the_tables(choices, table):
    assert sorted(get_args(choices)) == sorted(table)


def test_grid_worlds_load_no_simulator():
    modules = ("gridworld_bench.cli", "gridworld_bench.experiments.findings")
    assert not imported_by(*modules) & set(SIMULATORS)


def test_the_strategies_of_grid_worlds_are_those_of_their_tables():
    assert set(get_args(ActionStrategy)) == set(ACTION_METHODS)
    assert {*get_args(CritiqueStrategy), "arc-faithful"} == set(CRITIQUE_METHODS)
