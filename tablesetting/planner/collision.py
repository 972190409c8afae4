"""Whether a motion would touch anything: kinematics and contacts, no dynamics."""

import copy
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.grasp import Hold
from tablesetting.scene.perception import Percept
from tablesetting.scene.scene import Scene, geom_owners

_MARGIN: Final = 0.002
"""Robot and held item keep this far from bystanders, the robot from itself; [m]."""
_STRIDE: Final = 0.025
"""How far a joint may move from one check to the next, in [rad]."""
_TOUCH: Final = 0.0005
"""How deep the item may sink into the table and the pads into the item, in [m]."""


@dataclass(frozen=True)
class Contact:
    """Two things that touch, or pass too near.

    Attributes:
        mover: "arm" or the item.
        other: The same, a bystander or "table".
        distance: Between them, in [m]; negative for a depth.
    """

    mover: str
    other: str
    distance: float

    def __str__(self) -> str:
        """Say who hits whom and by how much."""
        if self.mover == self.other:
            return f"the {self.mover} would get in its own way"
        if self.distance < 0.0:
            depth = -1e3 * self.distance
            return f"{self.mover} and {self.other} would meet, {depth:.1f} mm deep"
        gap = 1e3 * self.distance
        return f"{self.mover} and {self.other} would pass at {gap:.1f} mm"


class CollisionChecker:
    """Poses a copy of a scene and looks for contacts of the robot and the item."""

    def __init__(
        self, scene: Scene, seen: Percept, may_touch_item: bool = False
    ) -> None:
        """Copy the scene.

        Args:
            scene: What there is.
            seen: Where it was seen.
            may_touch_item: Whether the robot is known to have the item in hand, whatever
                was seen.
        """
        self._model = _inflated(scene)
        self._data = mujoco.MjData(self._model)
        for name, pose in seen.poses.items():
            self._data.qpos[scene.pose_slice(name)] = pose
        self._robot = scene.robot
        self._names = ("table", "arm", *scene.body_ids)
        self._owners = geom_owners(scene, self._names)
        self._bystanders = frozenset(scene.objects)
        self._least = self._least_distances(scene.item, may_touch_item)
        self._item_qpos = scene.pose_slice(scene.item)

    def rest_item(self, position: Array, yaw: float) -> None:
        """Stand the item at a position of shape (3,), in [m], with a heading."""
        self._data.qpos[self._item_qpos] = _upright(position, yaw)

    def first_contact(
        self, configurations: Array, opening: float, hold: Hold | None
    ) -> Contact | None:
        """Find what touches first along a path.

        Args:
            configurations: Arm joints, shape (T, 6), in [rad]; those that differ little
                from the one before are passed over.
            opening: Travel of each finger, in [m].
            hold: Where the tool holds the item; None if the item stays where it is.

        Returns:
            Who touches whom, or None if the path is free.
        """
        for configuration in _apart(configurations):
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

    def _least_distances(self, item: str, may_touch_item: bool) -> Array:
        """How near any two owners may come, a symmetric matrix, in [m]."""
        num = len(self._names)
        least = np.full((num, num), -_TOUCH)
        must_keep_away = [name in self._bystanders for name in self._names]
        least[must_keep_away, :] = least[:, must_keep_away] = _MARGIN
        np.fill_diagonal(least, _MARGIN)
        if may_touch_item:
            pair = [self._names.index(name) for name in ("arm", item)]
            least[pair, pair[::-1]] = -np.inf
        return least

    def _carry_item(self, hold: Hold) -> None:
        rotation = self._data.site_xmat[self._robot.tcp].reshape(3, 3)
        position = self._data.site_xpos[self._robot.tcp] + rotation @ hold.offset
        yaw = float(np.arctan2(rotation[1, 0], rotation[0, 0])) + hold.yaw
        self._data.qpos[self._item_qpos] = _upright(position, yaw)

    def _forbidden_contact(self) -> Contact | None:
        contact = self._data.contact
        owners = self._owners[contact.geom]
        is_forbidden = contact.dist < self._least[owners[:, 0], owners[:, 1]]
        if not is_forbidden.any():
            return None
        nearest = int(np.where(is_forbidden, contact.dist, np.inf).argmin())
        names = [self._names[owner] for owner in owners[nearest]]
        mover, other = sorted(names, key=self._bystanders.__contains__)
        return Contact(mover, other, float(contact.dist[nearest]))


def _apart(configurations: Array) -> Array:
    """Thin a path out, keeping its end, so that joints move little more than the stride."""
    moved = np.abs(np.diff(configurations, axis=0)).max(axis=1)
    strides = np.ceil(np.cumsum(moved[::-1])[::-1] / _STRIDE)
    is_kept = np.append(np.diff(strides, append=0.0) < 0.0, True)
    return configurations[is_kept]


def _upright(position: Array, yaw: float) -> Array:
    return np.array([*position, np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)])


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
