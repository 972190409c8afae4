"""What a motion asks of the joints: inverse dynamics against their limits."""

import copy
from functools import cache
from typing import Final

import mujoco
import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.scene.robot import RobotIndex, robot_model
from tablesetting.scene.servos import Servos

_GRAVITY: Final = 9.81  # [m/s^2]
_TORQUE_SHARE: Final = 0.9  # Of the limit that a plan may use.
_STRIDE: Final = 4  # Commands from one evaluation of the dynamics to the next.


class Overload(Exception):
    """The joints are too weak, even for standing still; the message says where."""


class Load:
    """The arm with its servos, and what it carries."""

    def __init__(self, servos: Servos, mass: float = 0.0) -> None:
        """Take up a load.

        Args:
            servos: What drives the joints.
            mass: Of what the jaw holds, in [kg].
        """
        self.servos = servos
        self._mass = mass
        self._model, self._data = _free_robot(servos)
        self._robot = RobotIndex.of(self._model)

    def torques(
        self,
        positions: Array,
        velocities: Array,
        period: float,
        before: Array | None = None,
    ) -> Array:
        """Torque of every joint along a motion, shape (T, 6), in [Nm].

        Args:
            positions: Arm joints, shape (T, 6), in [rad].
            velocities: Their rates, shape (T, 6), in [rad/s].
            period: Between two rows, in [s].
            before: Rates before the first row, shape (6,); at rest if None.
        """
        num_ticks = len(positions)
        first = np.zeros(positions.shape[1]) if before is None else before
        padded = np.vstack([first, velocities])
        accelerations = np.diff(padded, axis=0) / period
        ticks = np.unique([*range(0, num_ticks, _STRIDE), num_ticks - 1])
        known = np.array(
            [
                self._inverse(positions[t], velocities[t], accelerations[t])
                for t in ticks
            ]
        )
        every = np.arange(num_ticks)
        return np.stack([np.interp(every, ticks, column) for column in known.T], axis=1)

    def weight(self, configuration: Array) -> Array:
        """Torque that it takes to stand still, shape (6,), in [Nm]."""
        rest = np.zeros(6)
        return self._inverse(configuration, rest, rest)

    def excess(self, torques: Array) -> float:
        """Largest share of what a plan may use, over motion and joints."""
        return float(np.max(np.abs(torques) / self._allowed))

    def slowdown(self, positions: Array, torques: Array) -> float:
        """How much slower a motion must be for its torques to suffice.

        What is not weight or dry friction falls with the square of the duration.

        Raises:
            Overload: If weight and friction alone are too much.
        """
        weights = np.array([self.weight(q) for q in positions[::_STRIDE]])
        friction = np.repeat(self.servos.frictions, 3)
        always = np.abs(weights) + friction
        spare = self._allowed - always
        if spare.min() <= 0.0:
            joint = int(spare.min(axis=0).argmin())
            raise Overload(
                f"joint {joint + 1} would have to bear {always[:, joint].max():.1f} Nm "
                f"of weight and friction; it is planned with {self._allowed[joint]:.1f} "
                "Nm at most"
            )
        moving = np.abs(torques[::_STRIDE] - weights) - friction
        return max(1.05, float(np.sqrt(max(0.0, np.max(moving / spare)))))

    @property
    def _allowed(self) -> Array:
        return _TORQUE_SHARE * self.servos.torque_limits

    def _inverse(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        model, data, robot = self._model, self._data, self._robot
        data.qpos[robot.arm_qpos] = position
        data.qvel[robot.arm_dofs] = velocity
        data.qacc[robot.arm_dofs] = acceleration
        mujoco.mj_inverse(model, data)
        torque = data.qfrc_inverse[robot.arm_dofs].copy()
        if self._mass > 0.0:
            jacobian = np.empty((3, model.nv))
            mujoco.mj_jacSite(model, data, jacobian, None, robot.tcp)
            torque += self._mass * _GRAVITY * jacobian[2, robot.arm_dofs]
        return torque


@cache
def _free_robot(servos: Servos) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The arm without stops and contacts; only its joints are ever written."""
    model = copy.deepcopy(robot_model(servos))
    flags = mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.disableflags |= int(flags)
    data = mujoco.MjData(model)
    data.qpos[RobotIndex.of(model).jaw_qpos] = 0.02
    return model, data
