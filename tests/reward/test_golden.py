"""Whole sessions, frozen; `python tests/reward/test_golden.py` plays them anew."""

import json
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from tablesetting.irl.active import run_active
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.reward.config import PRESETS
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import TASKS

GOLDEN = Path(__file__).parents[1] / "data" / "golden_sessions.json"


def name_of(session):
    settings = session["settings"]
    return "-".join(settings[name] for name in ("preset", "likelihood", "task"))


def play(settings):
    """Return what every round of a session found and asked."""
    config = PRESETS[settings["preset"]]
    config = replace(
        config,
        likelihood=settings["likelihood"],
        mcmc=replace(config.mcmc, **settings["mcmc"]),
    )
    problem = PlacementProblem(TASKS[settings["task"]], config)
    strategy = STRATEGIES[settings["strategy"]]
    rng = np.random.default_rng(settings["seed"])
    first = problem.demonstrate(problem.space.sample(1, rng=rng)[0], rng=rng)
    rounds = run_active(problem, [first], strategy, config.risk, rng=rng)
    return [
        {
            "placement": latest.demos[-1].placement.tolist(),
            "map_weights": latest.posterior.map_weights.tolist(),
            "mean_weights": latest.posterior.mean_weights.tolist(),
            "acceptance_rate": latest.posterior.acceptance_rate,
            "ess": latest.posterior.ess,
            "var_bound": latest.var_bound,
            "query": latest.query.tolist(),
        }
        for latest in islice(rounds, settings["num_rounds"])
    ]


@pytest.mark.parametrize("session", json.loads(GOLDEN.read_text()), ids=name_of)
def test_session_is_as_it_was(session):
    rounds = play(session["settings"])
    assert len(rounds) == len(session["rounds"])
    for found, expected in zip(rounds, session["rounds"], strict=True):
        assert found.keys() == expected.keys()
        for name, value in expected.items():
            np.testing.assert_allclose(found[name], value, atol=1e-6, err_msg=name)


if __name__ == "__main__":
    sessions = json.loads(GOLDEN.read_text())
    for session in sessions:
        session["rounds"] = play(session["settings"])
    GOLDEN.write_text(json.dumps(sessions, indent=1) + "\n")
