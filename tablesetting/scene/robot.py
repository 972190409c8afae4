"""The arm: a Kinova Jaco with a parallel jaw, on a pedestal behind the table.

The meshes and inertias are those of dm_control's Jaco. Its velocity servos give way to
stiff position servos, because a placement within half a millimetre needs a tool that
stands still; its three-finger hand gives way to a parallel jaw, because splaying
fingers push the neighbours of an item over.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.entities.manipulators.kinova import assets_path

from tablesetting.irl.arrays import Array, Indices
from tablesetting.scene.jaw import ParallelJaw

BASE_POSITION: Final = (0.0, -0.41, 0.10)
"""Where the foot of the arm stands in the world, in [m]; it faces +y."""
HOME: Final[tuple[float, ...]] = (5.304, 3.648, 1.281, 6.045, 0.903, -1.966)
"""Arm posture between two placements: tool down, away from singularities; [rad]."""
TCP_SITE: Final = "jaco/jaw/tcp"
"""Name of the tool centre point, midway between the finger pads; z points out."""

_JOINTS: Final = tuple(f"joint_{i}" for i in range(1, 7))
_PEDESTAL_RADIUS: Final = 0.045  # [m]


@dataclass(frozen=True)
class _Servo:
    """Position servo of one joint, tuned for a static tool error below 0.2 mm."""

    armature: float
    stiffness: float
    max_torque: float


_LARGE_SERVO: Final = _Servo(armature=1.0, stiffness=4000.0, max_torque=150.0)
_SMALL_SERVO: Final = _Servo(armature=0.3, stiffness=1500.0, max_torque=60.0)


class Jaco(composer.Entity):
    """A Jaco arm with position servos, a parallel jaw and a pedestal."""

    def _build(self, name: str = "jaco") -> None:
        path = os.path.join(assets_path.KINOVA_ROOT, "jaco_arm.xml")
        self._root = mjcf.from_path(path)
        self._root.model = name
        # The flag would switch the collision detection of the whole scene.
        del self._root.option.flag.nativeccd
        for joint in _JOINTS:
            self._add_servo(self._root.find("joint", joint), _servo_of(joint))
        for body in self._root.find_all("body"):
            body.gravcomp = 1
        self._add_pedestal()
        self.attach(ParallelJaw(), self._root.find("site", "wristsite"))

    @property
    def mjcf_model(self) -> Any:
        """The root element of the arm's model."""
        return self._root

    def _add_servo(self, joint: Any, servo: _Servo) -> None:
        joint.armature = servo.armature
        joint.damping = 1
        joint.frictionloss = 0
        self._root.actuator.add(
            "position",
            name=joint.name,
            joint=joint,
            kp=servo.stiffness,
            dampratio=1,
            forcelimited=True,
            forcerange=(-servo.max_torque, servo.max_torque),
        )

    def _add_pedestal(self) -> None:
        half_height = BASE_POSITION[2] / 2
        self._root.worldbody.add(
            "geom",
            name="pedestal",
            type="cylinder",
            size=(_PEDESTAL_RADIUS, half_height),
            pos=(0, 0, -half_height),
            rgba=(0.35, 0.35, 0.37, 1),
        )


@dataclass(frozen=True)
class RobotIndex:
    """Where the robot is found in the arrays of a compiled model.

    Attributes:
        arm_qpos: Addresses of the arm joints in `qpos`, shape (6,).
        arm_ctrl: Addresses of the arm servos in `ctrl`, shape (6,).
        jaw_qpos: Addresses of the two fingers in `qpos`, shape (2,).
        jaw_ctrl: Address of the jaw's opening in `ctrl`.
        tcp: Id of the tool centre point among the sites.
    """

    arm_qpos: Indices
    arm_ctrl: Indices
    jaw_qpos: Indices
    jaw_ctrl: int
    tcp: int

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "RobotIndex":
        """Look the robot up by name in a model that holds one `Jaco`."""
        joints = [model.joint(f"jaco/{name}") for name in _JOINTS]
        fingers = [model.joint(f"jaco/jaw/{name}") for name in ("left", "right")]
        return cls(
            arm_qpos=_addresses(joint.qposadr for joint in joints),
            arm_ctrl=np.array([model.actuator(f"jaco/{n}").id for n in _JOINTS]),
            jaw_qpos=_addresses(finger.qposadr for finger in fingers),
            jaw_ctrl=model.actuator("jaco/jaw/opening").id,
            tcp=model.site(TCP_SITE).id,
        )

    def set_posture(
        self,
        data: mujoco.MjData,
        configuration: Sequence[float] | Array,
        opening: float,
    ) -> None:
        """Write the arm joints (6,) in [rad] and each finger's travel in [m]."""
        data.qpos[self.arm_qpos] = configuration
        data.qpos[self.jaw_qpos] = opening


def add_robot(arena: composer.Arena) -> Jaco:
    """Stand a robot at its place behind the table, facing +y."""
    robot = Jaco()
    frame = arena.attach(robot)
    frame.pos = BASE_POSITION
    frame.quat = (0, 0, 0, 1)  # Half a turn: the arm as modelled faces -y.
    return robot


@cache
def robot_model() -> mujoco.MjModel:
    """Compile the robot standing alone, for kinematics; nobody may change it."""
    arena = composer.Arena()
    add_robot(arena)
    return compile_model(arena)


def compile_model(arena: composer.Arena) -> mujoco.MjModel:
    """Compile all that stands in an arena."""
    root = arena.mjcf_model
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())


def _servo_of(joint: str) -> _Servo:
    return _LARGE_SERVO if joint in _JOINTS[:3] else _SMALL_SERVO


def _addresses(parts: Any) -> Indices:
    return np.array([int(part[0]) for part in parts])
