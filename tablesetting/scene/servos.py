"""The servos of the arm: stiff ones for accuracy, or the Jaco's own."""

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from tablesetting.irl.arrays import Array

ServoName = Literal["stiff", "real"]

_LARGE_JOINTS: Final = ("joint_1", "joint_2", "joint_3")


@dataclass(frozen=True)
class Servos:
    """What drives the joints, and what they may not exceed.

    Attributes:
        name: Short name, on the command line.
        is_position_servo: Whether the joints are commanded positions; else velocities.
        gains: Stiffness in [Nm/rad] of position servos, damping in [Nm s/rad] of
            velocity servos; of the three large joints and the three small ones, as in
            the following.
        max_torques: In [Nm].
        max_speeds: In [rad/s].
        max_accelerations: In [rad/s^2].
        armatures: Inertia of the motors behind their gears, in [kg m^2].
        frictions: Dry friction of the joints, in [Nm].
        is_gravity_compensated: Whether the weight of the arm is carried for nothing.
    """

    name: ServoName
    is_position_servo: bool
    gains: tuple[float, float]
    max_torques: tuple[float, float]
    max_speeds: tuple[float, float]
    max_accelerations: tuple[float, float]
    armatures: tuple[float, float]
    frictions: tuple[float, float]
    is_gravity_compensated: bool

    @property
    def torque_limits(self) -> Array:
        """Largest torque of every joint, shape (6,), in [Nm]."""
        return np.repeat(self.max_torques, 3)

    @property
    def speed_limits(self) -> Array:
        """Largest speed of every joint, shape (6,), in [rad/s]."""
        return np.repeat(self.max_speeds, 3)

    @property
    def acceleration_limits(self) -> Array:
        """Largest acceleration of every joint, shape (6,), in [rad/s^2]."""
        return np.repeat(self.max_accelerations, 3)

    def drive(self, root: Any, joint: Any) -> None:
        """Equip a joint of an MJCF model.

        Args:
            root: The model.
            joint: The joint; it gives its name to its servo.
        """
        size = 0 if joint.name in _LARGE_JOINTS else 1
        joint.armature = self.armatures[size]
        joint.frictionloss = self.frictions[size]
        torque = self.max_torques[size]
        limits = {"forcelimited": True, "forcerange": (-torque, torque)}
        if self.is_position_servo:
            joint.damping = 1
            low, high = joint.range if joint.limited else (-4 * np.pi, 4 * np.pi)
            root.actuator.add(
                "position",
                name=joint.name,
                joint=joint,
                kp=self.gains[size],
                dampratio=1,
                ctrllimited=True,
                ctrlrange=(low, high),
                **limits,
            )
        else:
            speed = self.max_speeds[size]
            root.actuator.add(
                "velocity",
                name=joint.name,
                joint=joint,
                kv=self.gains[size],
                ctrllimited=True,
                ctrlrange=(-speed, speed),
                **limits,
            )


STIFF: Final = Servos(
    name="stiff",
    is_position_servo=True,
    gains=(4000.0, 1500.0),
    max_torques=(150.0, 60.0),
    max_speeds=(1.75, 2.4),
    max_accelerations=(8.0, 8.0),
    armatures=(1.0, 0.3),
    frictions=(0.0, 0.0),
    is_gravity_compensated=True,
)
"""Position servos, stronger and faster than the real ones, with a static error of the
tool below 0.2 mm."""

REAL: Final = Servos(
    name="real",
    is_position_servo=False,
    gains=(500.0, 500.0),
    max_torques=(30.5, 6.8),
    max_speeds=(float(np.deg2rad(36.0)), float(np.deg2rad(48.0))),
    max_accelerations=(2.0, 1.5),
    armatures=(4.0, 2.0),
    frictions=(2.0, 1.0),
    is_gravity_compensated=False,
)
"""The velocity servos of dm_control's Jaco: torques and speeds of Kinova's data sheet,
its armatures and friction, and its weight to be carried."""

SERVOS: Final[dict[ServoName, Servos]] = {
    servos.name: servos for servos in (STIFF, REAL)
}
"""All servos, by name."""
