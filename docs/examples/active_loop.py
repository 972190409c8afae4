"""Learn where the vase goes, without arm or recording."""

from itertools import islice

import numpy as np

from tablesetting.irl.active import run_active
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.reward.config import DEFAULT
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import VASE

rng = np.random.default_rng(0)
problem = PlacementProblem(VASE, DEFAULT)
first_layout = problem.space.sample(1, rng=rng)[0]
rounds = run_active(
    problem,
    [problem.demonstrate(first_layout, rng=rng)],
    STRATEGIES["active-var"],
    problem.config.risk,
    rng=rng,
)
for latest in islice(rounds, 3):
    print(f"{len(latest.demos)} demonstrations: at risk {latest.var_bound:.3f}")
