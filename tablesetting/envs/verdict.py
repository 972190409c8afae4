"""What an attempt to place the item earns."""

from typing import Any

from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution
from tablesetting.planner.goal import Refusal
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.placement import best_placements
from tablesetting.reward.preference import true_reward
from tablesetting.reward.rbf import RbfWidths
from tablesetting.reward.tasks import PlacementTask


class Verdict:
    """Weighs an outcome against the best and the worst in a layout."""

    def __init__(self, task: PlacementTask, layout: Array) -> None:
        """Take a layout, shape (K, 2) in table units, as it is before the attempt."""
        self._task = task
        self._layout = layout

    def of(
        self, outcome: Execution | Refusal, settled: Array, layout: Array
    ) -> tuple[float, dict[str, Any]]:
        """Judge an outcome.

        Args:
            outcome: How the attempt went.
            settled: Where the item is now, shape (2,), in table units.
            layout: Where the objects are now, shape (K, 2), in table units.

        Returns:
            The reward, never less for a success than for a failure, and what there is to
            know about it.
        """
        failure = _why_not(outcome)
        reward = self._least()
        if not failure:
            # Something pushed off by a hair may make the least a little less.
            reward = max(reward, true_reward(self._task, settled, layout))
        best = self._best_placement()
        best_reward = true_reward(self._task, best, self._layout)
        return reward, {
            "success": not failure,
            "failure": failure,
            "is_refused": isinstance(outcome, Refusal),
            "settled": settled,
            "best_placement": best,
            "best_reward": best_reward,
            "regret": best_reward - reward,
        }

    def _best_placement(self) -> Array:
        """The best placement where the item fits, shape (2,), in table units."""
        space = LayoutSpace.of_task(self._task, are_points=False)
        free = space.free_space(self._layout, self._task.receptacles)
        weights = self._task.true_weights[None]
        return best_placements(weights, self._layout[None], self._widths(), [free])[
            0, 0
        ]

    def _least(self) -> float:
        """The least reward on the unit square."""
        weights = -self._task.true_weights[None]
        worst = best_placements(weights, self._layout[None], self._widths())[0, 0]
        return true_reward(self._task, worst, self._layout)

    def _widths(self) -> Array:
        return RbfWidths().per_center(len(self._task.objects))


def _why_not(outcome: Execution | Refusal) -> str:
    """Say why an outcome is no success; nothing if it is one."""
    if isinstance(outcome, Refusal):
        return f"refused, {outcome.reason}: {outcome.detail}"
    return "" if outcome.success else str(outcome.failure)
