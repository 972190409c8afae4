"""Ask where the robot's guess errs most, on average over what may be wanted."""

from itertools import islice

import numpy as np

from tablesetting.irl.active import run_active
from tablesetting.irl.arrays import Array
from tablesetting.irl.outlook import Outlook
from tablesetting.irl.risk import RiskConfig
from tablesetting.reward.config import DEFAULT
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import VASE


def score_mean_loss(
    outlook: Outlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    """Score candidates by their mean loss over the posterior, shape (Q,)."""
    return outlook.losses.mean(axis=1)


rng = np.random.default_rng(0)
problem = PlacementProblem(VASE, DEFAULT)
first = problem.demonstrate(problem.space.sample(1, rng=rng)[0], rng=rng)
rounds = run_active(problem, [first], score_mean_loss, problem.config.risk, rng=rng)
for latest in islice(rounds, 2):
    print(f"ask in layout {latest.query.round(2).tolist()}")
