"""How far learned weights put the item from where the person would."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward.files import LearnedReward
from tablesetting.reward.placement import best_placements
from tablesetting.reward.problem import PlacementProblem


@dataclass(frozen=True)
class ValidationSet:
    """Test layouts, and where the person puts the item in each.

    Attributes:
        layouts: Test layouts, shape (L, K, 2), in table units.
        widths: Widths of the reward's RBFs, shape (K + 9,).
        true_placements: The person's placements, shape (L, 2), in table units.
    """

    layouts: Array
    widths: Array
    true_placements: Array

    @classmethod
    def of_problem(cls, problem: PlacementProblem, layouts: Array) -> "ValidationSet":
        """Let the person place the item in every layout, without error."""
        return cls(layouts, problem.widths, problem.wishes(layouts))

    def placement_errors(self, weights: Array) -> Array:
        """Return the placement error in every layout, shape (L,), in table units.

        Args:
            weights: Learned weights, shape (K + 9,).
        """
        placements = best_placements(weights[None], self.layouts, self.widths)
        return np.linalg.norm(placements[:, 0] - self.true_placements, axis=-1)


def placements_of(reward: LearnedReward, layouts: Array) -> Array:
    """Return where a learned reward wants the item in layouts, shape (L, 2)."""
    widths = reward.widths.per_center(len(reward.task.objects))
    return best_placements(reward.weights[None], layouts, widths)[:, 0]
