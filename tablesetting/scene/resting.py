"""Whether the item has been put down, and where."""

from typing import Final

import mujoco
import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward.tasks import PlacementTask
from tablesetting.scene.props import PROPS
from tablesetting.scene.table import TableFrame

_MAX_SPEED: Final = 0.01  # Of an item at rest, in [m/s].
_MAX_TURN_RATE: Final = 0.1  # The same, in [rad/s].
_MAX_HEIGHT: Final = 0.005  # Of the underside of an item on the table, in [m].
_MIN_UPRIGHT: Final = float(np.cos(np.radians(5.0)))  # Of its axis, along z.


class RestingItem:
    """Looks for the item of a task in a simulation of it."""

    def __init__(
        self, model: mujoco.MjModel, task: PlacementTask, frame: TableFrame
    ) -> None:
        """Look up what belongs to what.

        Args:
            model: Holds the robot, and a free body "NAME/" for every prop of the task.
            task: Says what the item is, and into what it may be put.
            frame: Maps table units to the world.
        """
        self._frame = frame
        self._item = model.body(f"{task.item}/").id
        first = int(model.body_dofadr[self._item])
        self._dofs = slice(first, first + 6)
        self._receptacles = {
            model.body(f"{name}/").id: PROPS[name] for name in task.receptacles
        }
        roots = model.body_rootid[model.geom_bodyid]
        self._is_item = roots == self._item
        self._is_robot = roots == model.body("jaco/").id

    def placement(self, data: mujoco.MjData) -> Array | None:
        """Tell where the item has been put down.

        Args:
            data: State of the simulation.

        Returns:
            Its placement, shape (2,), in table units: the centre of its footprint or, in
            a receptacle, its centre of mass. None if it moves, is touched by the robot,
            does not stand on the table or is off the unit square.
        """
        if not self._is_still(data) or self._is_touched(data):
            return None
        point = self._support(data)
        if point is None:
            return None
        placement = self._frame.from_world(point)
        is_on_square = ((placement >= 0.0) & (placement <= 1.0)).all()
        return placement if is_on_square else None

    def _is_still(self, data: mujoco.MjData) -> bool:
        velocity = data.qvel[self._dofs]
        speed, turn_rate = np.linalg.norm(velocity.reshape(2, 3), axis=1)
        return bool(speed < _MAX_SPEED and turn_rate < _MAX_TURN_RATE)

    def _is_touched(self, data: mujoco.MjData) -> bool:
        geoms = data.contact.geom[data.contact.dist < 0.0]
        with_item = geoms[self._is_item[geoms].any(axis=1)]
        return bool(self._is_robot[with_item].any())

    def _support(self, data: mujoco.MjData) -> Array | None:
        """Where the item is in a receptacle or stands on the table, shape (2,), in [m]."""
        center = data.xipos[self._item]
        for body, spec in self._receptacles.items():
            offset = center - data.xpos[body]
            if np.hypot(*offset[:2]) < spec.radius and 0.0 < offset[2] < spec.height:
                return center[:2].copy()
        position, up = data.xpos[self._item], data.xmat[self._item, 8]
        stands = abs(position[2]) < _MAX_HEIGHT and up > _MIN_UPRIGHT
        return position[:2].copy() if stands else None
