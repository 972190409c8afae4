"""The sampled reward at the quantile: it says what the robot could have got wrong."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import value_at_risk
from tablesetting.reward.problem import PlacementProblem

_NUM_SAMPLES = 150  # Placements shown.


@dataclass(frozen=True)
class Rival:
    """What samples of the posterior want in one layout.

    Attributes:
        weights: The rival's, shape (K + 9,): its loss is the value at risk.
        placement: Where it wants the item, shape (2,), in table units.
        samples: Where samples, evenly chosen, want it, shape (M, 2).
    """

    weights: Array
    placement: Array
    samples: Array


def find_rival(problem: PlacementProblem, posterior: Posterior, layout: Array) -> Rival:
    """Find the rival in a layout, shape (K, 2), in table units."""
    risk = problem.config.risk
    losses = problem.policy_losses([layout], posterior)
    var = value_at_risk(losses, risk.alpha, rank_offset=risk.rank_offset)[0]
    weights = posterior.weights[int(np.abs(losses[0] - var).argmin())]
    num = min(_NUM_SAMPLES, len(posterior.weights))
    chosen = np.arange(num) * len(posterior.weights) // num
    both = np.vstack([weights, posterior.weights[chosen]])
    placements = problem.best_placements(both, layout[None])[0]
    return Rival(weights, placements[0], placements[1:])
