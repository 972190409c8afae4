"""Placements as a Gymnasium environment: the arm does the rest."""

import copy
from functools import cache
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from tablesetting.envs.picture import RENDER_MODE, Painter, Pixels
from tablesetting.envs.verdict import Verdict
from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution, run_to_end
from tablesetting.planner.goal import Reason, Refusal
from tablesetting.planner.place import place
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import PlacementTask
from tablesetting.scene.environment import find_task
from tablesetting.scene.scene import Scene
from tablesetting.scene.table import FAST_TIMESTEP, TIMESTEP


class PlacementEnv(gymnasium.Env[Array, Array]):
    """Say where the item shall stand; the arm puts it there, and the episode is over.

    An observation has the objects' centres, shape (K, 2), an action is a placement,
    shape (2,), both in table units. The reward is the person's for where the item came to
    rest, or the least on the unit square if the placement was refused or failed.

    `info` of a step holds `success`; `failure`, why not, or ""; `is_refused`, whether
    nothing was moved; `touched`, which objects arm or item have touched; `settled`, where the item is, shape (2,), in table units (in a
    receptacle its centre of mass); `error_mm`, its distance to the action;
    `best_placement` and `best_reward`, of all where it fits; `regret`, the reward that is
    missing to that.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012, as the base class has it.
        "render_modes": [RENDER_MODE],
        "render_fps": 1,
    }

    def __init__(
        self, task: str, *, fast: bool = False, render_mode: str | None = None
    ) -> None:
        """Set the table.

        Args:
            task: One of `tablesetting.reward.tasks.TASKS`.
            fast: Whether to simulate in time steps of 4 ms, not 2 ms.
            render_mode: "rgb_array" for pictures by `render`.

        Raises:
            TableSettingError: If there is no such task, or MuJoCo cannot draw here.
            ValueError: If `render_mode` is another.
        """
        self._task = find_task(task)
        self._space = LayoutSpace.of_task(self._task, are_points=False)
        self._scene = _own_scene(self._task, FAST_TIMESTEP if fast else TIMESTEP)
        self._painter = Painter(self._scene.model, render_mode)
        self.render_mode = render_mode
        self._verdict: Verdict | None = None
        self.action_space = spaces.Box(0.0, 1.0, (2,), np.float64)
        shape = (len(self._task.objects), 2)
        self.observation_space = spaces.Box(0.0, 1.0, shape, np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Lay the table, at random unless told how.

        Args:
            seed: Of this episode and those after it; goes on from the last one if None.
            options: May have a `layout`, shape (K, 2), in table units.

        Returns:
            The observation, and no further information.

        Raises:
            InvalidLayout: If the layout cannot be set up.
        """
        super().reset(seed=seed)
        wanted = (options or {}).get("layout")
        if wanted is None:
            layout = self._space.sample(1, rng=self.np_random)[0]
        else:
            layout = np.array(wanted, dtype=np.float64)
            self._space.check(layout)
        self._scene.reset(layout)
        self._verdict = Verdict(self._task, layout)
        return self._observed(), {}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Put the item at a placement, shape (2,), in table units.

        Raises:
            ValueError: If the action is not a pair of finite numbers.
            gymnasium.error.ResetNeeded: If the episode is over.
        """
        if self._verdict is None:
            raise gymnasium.error.ResetNeeded(
                "an episode is one placement long; call `reset` before the next"
            )
        placement = np.array(action, dtype=np.float64)
        if placement.shape != (2,) or not np.isfinite(placement).all():
            raise ValueError(f"an action is two finite numbers; got {action}")
        verdict, self._verdict = self._verdict, None
        outcome = self._carry_out(placement)
        settled = self._settled(outcome)
        reward, info = verdict.of(outcome, settled, self._layout())
        touched = outcome.touched if isinstance(outcome, Execution) else ()
        info["touched"] = ", ".join(sorted(touched))
        info["error_mm"] = self._distance_mm(settled, placement)
        return self._observed(), reward, True, False, info

    def render(self) -> Pixels | None:
        """Draw the table, shape (480, 640, 3); None without a render mode."""
        return self._painter.draw(self._scene.data)

    def close(self) -> None:
        """Free the graphics card."""
        self._painter.close()

    def _carry_out(self, placement: Array) -> Execution | Refusal:
        if ((placement < 0.0) | (placement > 1.0)).any():
            detail = f"{placement.tolist()} is off the unit square"
            return Refusal(Reason.OUTSIDE, detail)
        return run_to_end(place(self._scene, self._scene.frame.to_world(placement)))

    def _settled(self, outcome: Execution | Refusal) -> Array:
        """Where the item is, shape (2,), in table units."""
        if isinstance(outcome, Execution):
            return self._scene.frame.from_world(outcome.settled)
        return self._scene.frame.from_world(self._scene.position(self._task.item)[:2])

    def _distance_mm(self, first: Array, second: Array) -> float:
        points = self._scene.frame.to_world(np.stack([first, second]))
        return 1e3 * float(np.linalg.norm(points[0] - points[1]))

    def _layout(self) -> Array:
        """Where the objects are, shape (K, 2), in table units."""
        positions = [self._scene.position(name)[:2] for name in self._task.objects]
        return self._scene.frame.from_world(np.array(positions))

    def _observed(self) -> Array:
        return np.clip(self._layout(), 0.0, 1.0)


def _own_scene(task: PlacementTask, timestep: float) -> Scene:
    """Copy a scene, so that no other environment changes it."""
    scene = _compiled(task.objects, task.item, timestep)
    # The view of the bodies cannot be copied, and need not be: it is read-only.
    return copy.deepcopy(scene, {id(scene.body_ids): scene.body_ids})


@cache
def _compiled(objects: tuple[str, ...], item: str, timestep: float) -> Scene:
    return Scene(objects, item, timestep=timestep)
