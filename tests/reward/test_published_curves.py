"""The paper's table experiment, against its published curves."""

import csv
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from tablesetting.irl.active import STRATEGIES, run_active
from tablesetting.reward.problem import PAPER, PlacementProblem
from tablesetting.reward.tasks import TASKS

PUBLISHED = Path(__file__).parents[1] / "data" / "published_placement.csv"
NUM_PUBLISHED_TRIALS = 100
NUM_TRIALS = 40
NUM_ROUNDS = 5


def published(task, strategy, quantity):
    """Return means and standard errors after 1, 2, ... demonstrations."""
    curve = (f"place_{task}", strategy, quantity)
    with PUBLISHED.open(newline="") as file:
        rows = [
            (float(row["value"]), float(row["error_bar"]))
            for row in csv.DictReader(file)
            if (row["figure"], row["strategy"], row["quantity"]) == curve
        ]
    means, half_stds = np.array(rows[:NUM_ROUNDS]).T
    return means, 2.0 * half_stds / np.sqrt(NUM_PUBLISHED_TRIALS)


def trial(task, strategy, rng):
    """Return mean error, largest error and bound of each round, (rounds, 3)."""
    problem = PlacementProblem(task, PAPER)
    tests = problem.space.sample(200, rng=rng)
    truth = problem.best_placements(task.true_weights[None], tests)[:, 0]
    first = problem.space.sample(1, rng=rng)[0]
    if task.first_layout is not None:
        first = np.array(task.first_layout)
    demos = [problem.demonstrate(first)]
    found = []
    rounds = run_active(problem, demos, STRATEGIES[strategy], PAPER.risk, rng=rng)
    for latest in islice(rounds, NUM_ROUNDS):
        weights = latest.posterior.map_weights[None]
        learned = problem.best_placements(weights, tests)[:, 0]
        errors = np.linalg.norm(learned - truth, axis=1)
        found.append((errors.mean(), errors.max(), latest.var_bound))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize(
    ("strategy", "title", "quantities"),
    [
        (
            "active-var",
            "ActiveVaR",
            ("mean_placement_error", "max_placement_error", "var_upper_bound"),
        ),
        ("random", "Random", ("mean_placement_error",)),
    ],
)
def test_paper_preset_reproduces_the_published_curves(
    name, strategy, title, quantities
):
    children = np.random.SeedSequence(0).spawn(NUM_TRIALS)
    trials = np.array(
        [trial(TASKS[name], strategy, np.random.default_rng(c)) for c in children]
    )
    means = trials.mean(axis=0)
    standard_errors = trials.std(axis=0, ddof=1) / np.sqrt(NUM_TRIALS)
    for column, quantity in enumerate(quantities):
        expected, published_error = published(name, title, quantity)
        spread = np.hypot(standard_errors[:, column], published_error)
        difference = np.abs(means[:, column] - expected)
        # The authors' optimiser misses the best placement at times; ours does not.
        assert (difference < 3.5 * spread + 0.01).all(), quantity
