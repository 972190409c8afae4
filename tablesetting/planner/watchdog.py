"""Looks at the simulation while the arm moves, and breaks off what goes wrong."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import mujoco
import numpy as np

from tablesetting.irl.arrays import Array, Booleans
from tablesetting.scene.scene import Scene, geom_owners

_MAX_LAG: Final = 0.2  # Of a joint behind its command, in [rad].
_POSITION_TOL: Final = 2e-3  # Beyond the range of a joint, in [rad].
_TORQUE_TOL: Final = 1e-6  # As a share of the limit; servos are clipped there.
_MAX_STRAIN: Final = 12  # Checks in a row with a torque at its limit: 0.1 s.
_TOUCH: Final = 0.0  # Things that are this far apart do not touch, in [m].
_DIVERGENCE: Final = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
]


class Fault(StrEnum):
    """What kind of thing went wrong."""

    DIVERGED = "diverged"
    """The numbers of the simulation are none."""
    HELD_UP = "held up"
    """The arm does not follow its commands."""
    TABLE_TOUCHED = "table touched"
    """The arm touched the table."""
    LIMIT = "limit"
    """A joint went beyond its range or speed, or stayed at its largest torque."""
    LOST_GRIP = "lost grip"
    """The item slipped or fell out of the jaw."""
    NO_CORRECTION = "no correction"
    """The item sits in the jaw such that it cannot be put down where it should."""
    MISPLACED = "misplaced"
    """The motion was completed, but the item is not where or as it should be."""
    DISTURBED = "disturbed"
    """The item is well, but something else was moved."""


@dataclass(frozen=True)
class Failure:
    """Why a placement did not succeed."""

    fault: Fault
    detail: str

    def __str__(self) -> str:
        """Say what went wrong."""
        return self.detail


@dataclass
class Effort:
    """How far a motion went towards the limits, as shares of them.

    Attributes:
        speed: Largest speed of a joint.
        torque: Largest torque of a servo.
        overrun: Furthest beyond the range of a joint, in [rad]; 0 within.
    """

    speed: float = 0.0
    torque: float = 0.0
    overrun: float = 0.0


class Watchdog:
    """Checks the state of a scene after every control period.

    Attributes:
        effort: The most that was seen.
        touched: Bystanders that arm or item have touched.
    """

    def __init__(self, scene: Scene, receptacle: str | None = None) -> None:
        """Look up what belongs to what.

        Args:
            scene: To be looked at.
            receptacle: What the item may touch.
        """
        self.effort = Effort()
        self.touched: set[str] = set()
        self._scene = scene
        self._names = ("table", "arm", *scene.body_ids)
        self._owners = geom_owners(scene, self._names)
        self._is_watched = self._watched_pairs(receptacle)
        joints = [scene.model.joint(f"jaco/joint_{k}") for k in range(1, 7)]
        limited = np.array([bool(joint.limited[0]) for joint in joints])
        ranges = np.array([joint.range for joint in joints])
        self._low = np.where(limited, ranges[:, 0], -np.inf)
        self._high = np.where(limited, ranges[:, 1], np.inf)
        self._speed_limits = scene.servos.speed_limits
        self._torque_limits = scene.servos.torque_limits
        self._strain = 0

    def check(self, commanded: Array) -> Failure | None:
        """Look at the state; `commanded` is where the joints should be, shape (6,)."""
        data = self._scene.data
        if data.warning.number[_DIVERGENCE].any():
            return Failure(Fault.DIVERGED, "the simulation diverged")
        position = data.qpos[self._scene.robot.arm_qpos]
        if np.abs(position - commanded).max() > _MAX_LAG:
            return Failure(Fault.HELD_UP, "the arm is held up")
        return self._check_contacts() or self._check_limits(position)

    def _watched_pairs(self, receptacle: str | None) -> Booleans:
        """Which two owners should not touch, a symmetric matrix."""
        scene, num = self._scene, len(self._names)
        index = {name: k for k, name in enumerate(self._names)}
        is_watched = np.zeros((num, num), dtype=bool)
        is_watched[index["arm"], index["table"]] = True
        for name in scene.objects:
            is_watched[index["arm"], index[name]] = True
            is_watched[index[scene.item], index[name]] = name != receptacle
        return is_watched | is_watched.T

    def _check_contacts(self) -> Failure | None:
        contact = self._scene.data.contact
        owners = self._owners[contact.geom]
        is_watched = self._is_watched[owners[:, 0], owners[:, 1]]
        is_watched &= contact.dist < _TOUCH
        if not is_watched.any():
            return None
        touching = {self._names[owner] for owner in owners[is_watched].flat}
        self.touched |= touching.intersection(self._scene.objects)
        if "table" in touching:
            return Failure(Fault.TABLE_TOUCHED, "the arm touches the table")
        return None

    def _check_limits(self, position: Array) -> Failure | None:
        scene, effort = self._scene, self.effort
        speeds = np.abs(scene.data.qvel[scene.robot.arm_dofs]) / self._speed_limits
        forces = scene.data.actuator_force[scene.robot.arm_ctrl]
        torques = np.abs(forces) / self._torque_limits
        overruns = np.maximum(self._low - position, position - self._high)
        effort.speed = max(effort.speed, float(speeds.max()))
        effort.torque = max(effort.torque, float(torques.max()))
        effort.overrun = max(effort.overrun, float(overruns.max()))
        is_strained = torques.max() > 1.0 - _TORQUE_TOL
        self._strain = self._strain + 1 if is_strained else 0
        for is_too_much, shares, what in (
            (effort.speed > 1.0, speeds, "is beyond its speed"),
            (effort.overrun > _POSITION_TOL, overruns, "is beyond its range"),
            (self._strain > _MAX_STRAIN, torques, "stays at its largest torque"),
        ):
            if is_too_much:
                return Failure(Fault.LIMIT, f"joint {int(shares.argmax()) + 1} {what}")
        return None


def held(scene: Scene) -> Booleans:
    """Tell which of the two pads touch the item, shape (2,)."""
    model, contact = scene.model, scene.data.contact
    is_item = model.geom_bodyid[contact.geom] == scene.body_ids[scene.item]
    with_item = contact.geom[is_item.any(axis=1)]
    pads = [model.geom(f"jaco/jaw/{side}_pad").id for side in ("left", "right")]
    return np.array([bool((with_item == pad).any()) for pad in pads])
