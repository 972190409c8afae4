"""Ask where the average reward that explains the demonstrations errs most."""

from itertools import islice

import numpy as np

from tablesetting.irl.active import RiskConfig, run_active
from tablesetting.irl.arrays import Array
from tablesetting.reward.problem import DEFAULT, PlacementProblem
from tablesetting.reward.tasks import VASE


def score_mean_loss(losses: Array, risk: RiskConfig, rng: np.random.Generator) -> Array:
    """Score candidates by their mean loss over the posterior, shape (Q,)."""
    return losses.mean(axis=1)


rng = np.random.default_rng(0)
problem = PlacementProblem(VASE, DEFAULT)
first = problem.demonstrate(problem.space.sample(1, rng=rng)[0])
rounds = run_active(problem, [first], score_mean_loss, problem.config.risk, rng=rng)
for latest in islice(rounds, 2):
    print(f"ask in layout {latest.query.round(2).tolist()}")
