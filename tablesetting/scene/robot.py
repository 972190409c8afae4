"""The arm: a Kinova Jaco with a parallel jaw, on the near side of the table.

The meshes and inertias are those of dm_control's Jaco. Unless asked for, its velocity
servos give way to stiff position servos, because a placement within half a millimetre
needs a tool that stands still; its three-finger hand gives way to a parallel jaw, because
splaying fingers push the neighbours of an item over.
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
from tablesetting.scene.servos import STIFF, Servos
from tablesetting.scene.table import TIMESTEP

BASE_POSITION: Final = (0.0, -0.42, 0.02)
"""Where the foot of the arm stands in the world, in [m]; it faces +y."""
HOME: Final[tuple[float, ...]] = (5.333, 3.473, 1.319, 5.967, 1.158, -2.051)
"""Arm posture between two placements: tool down, away from singularities; [rad]."""
TCP_SITE: Final = "jaco/jaw/tcp"
"""Name of the tool centre point, midway between the finger pads; z points out."""

_JOINTS: Final = tuple(f"joint_{i}" for i in range(1, 7))
_FOOT_RADIUS: Final = 0.06  # [m]


class Jaco(composer.Entity):
    """A Jaco arm with servos, a parallel jaw and a foot."""

    def _build(
        self, name: str = "jaco", servos: Servos = STIFF, timestep: float = TIMESTEP
    ) -> None:
        path = os.path.join(assets_path.KINOVA_ROOT, "jaco_arm.xml")
        self._root = mjcf.from_path(path)
        self._root.model = name
        # The flag would switch the collision detection of the whole scene.
        del self._root.option.flag.nativeccd
        self._joints = [self._root.find("joint", joint) for joint in _JOINTS]
        for joint in self._joints:
            servos.drive(self._root, joint)
        self._add_foot()
        self._jaw = ParallelJaw(timestep=timestep)
        for part in (self._root, self._jaw.mjcf_model):
            for body in part.find_all("body"):
                body.gravcomp = float(servos.is_gravity_compensated)
        self.attach(self._jaw, self._root.find("site", "wristsite"))

    @property
    def mjcf_model(self) -> Any:
        """The root element of the arm's model."""
        return self._root

    @property
    def joints(self) -> list[Any]:
        """The six joints of the arm, from the foot to the wrist."""
        return self._joints

    @property
    def jaw(self) -> ParallelJaw:
        """The jaw at its wrist."""
        return self._jaw

    def _add_foot(self) -> None:
        half_height = BASE_POSITION[2] / 2
        self._root.worldbody.add(
            "geom",
            name="foot",
            type="cylinder",
            size=(_FOOT_RADIUS, half_height),
            pos=(0, 0, -half_height),
            rgba=(0.35, 0.35, 0.37, 1),
        )


@dataclass(frozen=True)
class RobotIndex:
    """Where the robot is found in the arrays of a compiled model.

    Attributes:
        arm_qpos: Addresses of the arm joints in `qpos`, shape (6,).
        arm_ctrl: Addresses of the arm servos in `ctrl`, shape (6,).
        arm_dofs: Addresses of the arm joints in `qvel`, shape (6,).
        jaw_qpos: Addresses of the two fingers in `qpos`, shape (2,).
        jaw_ctrl: Address of the jaw's opening in `ctrl`.
        tcp: Id of the tool centre point among the sites.
    """

    arm_qpos: Indices
    arm_dofs: Indices
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
            arm_dofs=_addresses(joint.dofadr for joint in joints),
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


def add_robot(
    arena: composer.Arena, servos: Servos = STIFF, timestep: float = TIMESTEP
) -> Jaco:
    """Stand a robot at its place on the table, facing +y."""
    robot = Jaco(servos=servos, timestep=timestep)
    frame = arena.attach(robot)
    frame.pos = BASE_POSITION
    frame.quat = (0, 0, 0, 1)  # Half a turn: the arm as modelled faces -y.
    return robot


@cache
def robot_model(servos: Servos = STIFF) -> mujoco.MjModel:
    """Compile the robot standing alone, to plan with; nobody may change it."""
    arena = composer.Arena()
    add_robot(arena, servos)
    return compile_model(arena)


def compile_model(arena: composer.Arena) -> mujoco.MjModel:
    """Compile all that stands in an arena."""
    root = arena.mjcf_model
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())


def _addresses(parts: Any) -> Indices:
    return np.array([int(part[0]) for part in parts])
