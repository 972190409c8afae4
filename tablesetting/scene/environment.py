"""The table as a dm_control environment, which moves the arm's joints."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from dm_control import composer
from dm_control.composer.observation import observable

from tablesetting.errors import TableSettingError
from tablesetting.irl.arrays import Array
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.preference import true_reward
from tablesetting.reward.tasks import TASKS, PlacementTask
from tablesetting.scene.jaw import MAX_OPENING
from tablesetting.scene.props import make_prop
from tablesetting.scene.resting import RestingItem
from tablesetting.scene.robot import HOME, RobotIndex, add_robot
from tablesetting.scene.scene import STAGING
from tablesetting.scene.table import TIMESTEP, Table

CONTROL_TIMESTEP: Final = 0.04
"""Time between two actions, in [s]."""
TIME_LIMIT: Final = 20.0
"""Length of an episode, in [s]; a placement takes 6 to 9."""


def load(task: str, seed: int | None = None) -> composer.Environment:
    """Set up a task as an environment.

    Each episode lays the objects at random, stands the item beside the square and the
    arm at home. An action has the targets of the six joints, in [rad], and the opening
    of the jaw, each finger's travel in [m]. The reward of a step is that of the task's
    person for where the item has been put down; 0 unless it has been.

    Args:
        task: One of `TASKS`.
        seed: Of all layouts; one from the operating system if None.

    Returns:
        The environment; an episode whose simulation diverges ends with discount 0.

    Raises:
        TableSettingError: If there is no task of that name.
    """
    return composer.Environment(
        SetTable(find_task(task)),
        # Half a step short, as the clock's sum of time steps is inexact.
        time_limit=TIME_LIMIT - 0.5 * CONTROL_TIMESTEP,
        random_state=seed,
        raise_exception_on_physics_error=False,
        strip_singleton_obs_buffer_dim=True,
        recompile_mjcf_every_episode=False,
    )


def find_task(name: str) -> PlacementTask:
    """Return the task of a name; raise a `TableSettingError` if there is none."""
    if name not in TASKS:
        raise TableSettingError(
            f"there is no task called {name!r}; choose one of {', '.join(TASKS)}"
        )
    return TASKS[name]


class SetTable(composer.Task):
    """Put the item where the person wants it, among objects that stand anywhere.

    Observed are, in [m], [rad] and the world's frame: `arm_position` and `arm_velocity`
    (6,), `jaw_opening` (1,), `tool_position` (3,) midway between the pads,
    `item_position` (3,), `item_quaternion` (4,) as wxyz, and `object_positions` (K, 3)
    in the order of a layout.
    """

    def __init__(self, task: PlacementTask) -> None:
        """Stand everything on a table."""
        self._task = task
        self._space = LayoutSpace.of_task(task, are_points=False)
        self._arena = Table()
        add_robot(self._arena)
        self._props = [make_prop(name) for name in (*task.objects, task.item)]
        for prop in self._props:
            self._arena.add_free_entity(prop)
        self.set_timesteps(CONTROL_TIMESTEP, TIMESTEP)
        self._observables = _enabled(self._views())

    @property
    def root_entity(self) -> Table:
        """The table, with everything on it."""
        return self._arena

    @property
    def task_observables(self) -> dict[str, observable.Observable]:
        """What is observed, by name."""
        return self._observables

    def after_compile(self, physics: Any, random_state: np.random.RandomState) -> None:
        """Look up where everything is in the compiled model."""
        model = physics.model.ptr
        names = (*self._task.objects, self._task.item)
        *self._objects, self._item = (model.body(f"{name}/").id for name in names)
        self._robot = RobotIndex.of(model)
        self._resting = RestingItem(model, self._task, self._arena.frame)

    def initialize_episode(
        self, physics: Any, random_state: np.random.RandomState
    ) -> None:
        """Lay the table at random; the arm is at home with its jaw half open."""
        rng = np.random.default_rng(random_state.randint(2**32, dtype=np.uint32))
        layout = self._space.sample(1, rng=rng)[0]
        spots = [*self._arena.frame.to_world(layout), np.array(STAGING)]
        for prop, (x, y) in zip(self._props, spots, strict=True):
            prop.set_pose(physics, (x, y, 0.0), (1.0, 0.0, 0.0, 0.0))
        data, opening = physics.data.ptr, MAX_OPENING / 2
        self._robot.set_posture(data, HOME, opening)
        data.ctrl[self._robot.arm_ctrl] = HOME
        data.ctrl[self._robot.jaw_ctrl] = opening

    def get_reward(self, physics: Any) -> float:
        """What the person thinks of where the item has been put down, or 0."""
        placement = self._resting.placement(physics.data.ptr)
        if placement is None:
            return 0.0
        layout = self._arena.frame.from_world(physics.data.xpos[self._objects, :2])
        return true_reward(self._task, placement, layout)

    def _views(self) -> dict[str, Callable[[Any], Array]]:
        return {
            "arm_position": lambda physics: physics.data.qpos[self._robot.arm_qpos],
            "arm_velocity": lambda physics: physics.data.qvel[self._robot.arm_dofs],
            "jaw_opening": lambda physics: physics.data.qpos[self._robot.jaw_qpos].mean(
                keepdims=True
            ),
            "tool_position": lambda physics: physics.data.site_xpos[self._robot.tcp],
            "item_position": lambda physics: physics.data.xpos[self._item],
            "item_quaternion": lambda physics: physics.data.xquat[self._item],
            "object_positions": lambda physics: physics.data.xpos[self._objects],
        }


def _enabled(
    views: dict[str, Callable[[Any], Array]],
) -> dict[str, observable.Observable]:
    observables = {name: observable.Generic(view) for name, view in views.items()}
    for each in observables.values():
        each.enabled = True
    return observables
