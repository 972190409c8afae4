"""Whether a motion would touch anything: kinematics and contacts, no dynamics."""

import copy
from typing import Final

import mujoco
import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.grasp import Hold
from tablesetting.scene.scene import Scene

_MARGIN: Final = 0.002
"""Robot and held item keep this far from bystanders, the robot from itself; [m]."""
_TOUCH: Final = 0.0005
"""How deep the item may sink into the table and the pads into the item, in [m]."""


class CollisionChecker:
    """Poses a copy of a scene and looks for contacts of the robot and the item."""

    def __init__(self, scene: Scene) -> None:
        """Copy the scene as it stands."""
        self._model = _inflated(scene)
        self._data = mujoco.MjData(self._model)
        self._data.qpos[:] = scene.data.qpos
        self._robot = scene.robot
        self._owners = _owners(scene)
        self._bystanders = frozenset(scene.objects)
        item = self._model.body(scene.body_ids[scene.item])
        start = int(self._model.jnt_qposadr[item.jntadr[0]])
        self._item_qpos = slice(start, start + 7)

    def rest_item(self, position: Array) -> None:
        """Stand the item, yaw 0, at a position of shape (3,), in [m]."""
        self._data.qpos[self._item_qpos] = [*position, 1.0, 0.0, 0.0, 0.0]

    def first_contact(
        self, configurations: Array, opening: float, hold: Hold | None
    ) -> str | None:
        """Name what touches first along a path.

        Args:
            configurations: Arm joints, shape (T, 6), in [rad].
            opening: Travel of each finger, in [m].
            hold: Where the tool holds the item; None if the item stays where it is.

        Returns:
            Who hits whom and by how much, or None if the path is free.
        """
        for configuration in configurations:
            self._robot.set_posture(self._data, configuration, opening)
            mujoco.mj_kinematics(self._model, self._data)
            if hold is not None:
                self._carry_item(hold)
                mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
            contact = self._forbidden_contact()
            if contact is not None:
                return contact
        return None

    def _carry_item(self, hold: Hold) -> None:
        rotation = self._data.site_xmat[self._robot.tcp].reshape(3, 3)
        position = self._data.site_xpos[self._robot.tcp] + rotation @ hold.offset
        half_yaw = (np.arctan2(rotation[1, 0], rotation[0, 0]) + hold.yaw) / 2
        quaternion = [np.cos(half_yaw), 0.0, 0.0, np.sin(half_yaw)]
        self._data.qpos[self._item_qpos] = [*position, *quaternion]

    def _forbidden_contact(self) -> str | None:
        contact = self._data.contact
        for k in np.argsort(contact.dist):
            names = (self._owners[geom] for geom in contact.geom[k])
            mover, other = sorted(names, key=self._bystanders.__contains__)
            distance = float(contact.dist[k])
            must_keep_away = other == mover or other in self._bystanders
            if distance < (_MARGIN if must_keep_away else -_TOUCH):
                return _describe(mover, other, distance)
        return None


def _owners(scene: Scene) -> list[str]:
    """Name what each geom belongs to: a prop, the arm or the table."""
    names = {body: name for name, body in scene.body_ids.items()}
    names[scene.model.body("jaco/").id] = "arm"
    roots = scene.model.body_rootid[scene.model.geom_bodyid]
    return [names.get(int(root), "table") for root in roots]


def _inflated(scene: Scene) -> mujoco.MjModel:
    """Copy a model so that contacts are those, and near misses, of robot and item."""
    model = copy.deepcopy(scene.model)
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    roots = model.body_rootid[model.geom_bodyid]
    is_mover = np.isin(roots, [model.body("jaco/").id, scene.body_ids[scene.item]])
    model.geom_margin[is_mover] = _MARGIN
    model.body_margin[model.geom_bodyid[is_mover]] = _MARGIN  # For the broad phase.
    model.geom_contype[~is_mover] = 0  # What stands may touch what else stands.
    return model


def _describe(first: str, second: str, distance: float) -> str:
    if first == second:
        return f"the {first} would get in its own way"
    if distance < 0.0:
        return f"{first} and {second} would meet, {-1e3 * distance:.1f} mm deep"
    return f"{first} and {second} would pass at {1e3 * distance:.1f} mm"
