"""From where the arm should be to what its servos are told."""

from typing import Final

import mujoco

from tablesetting.irl.arrays import Array
from tablesetting.scene.robot import RobotIndex
from tablesetting.scene.servos import Servos

_POSITION_GAIN: Final = 8.0  # Of the loop around velocity servos, in [1/s].


class ArmController:
    """Tells the servos of a scene's arm what to do, once every control period."""

    def __init__(self, model: mujoco.MjModel, robot: RobotIndex, servos: Servos):
        """Look up what the servos need to be told ahead."""
        self._robot = robot
        self._servos = servos
        gain = model.actuator_gainprm[robot.arm_ctrl, 0]
        damping = -model.actuator_biasprm[robot.arm_ctrl, 2]
        # A position servo lags by damping / stiffness; commanding ahead cancels it.
        self._lead = damping / gain
        self._gain = gain

    def track(
        self, data: mujoco.MjData, position: Array, velocity: Array, torque: Array
    ) -> None:
        """Command one moment of a motion.

        Args:
            data: Its controls are written.
            position: Where the joints should be, shape (6,), in [rad].
            velocity: How fast they should move, shape (6,), in [rad/s].
            torque: What that takes by the model of the arm, shape (6,), in [Nm]; of no
                effect on position servos, whose stiffness makes up for it.
        """
        if self._servos.is_position_servo:
            command = position + self._lead * velocity
        else:
            lag = position - data.qpos[self._robot.arm_qpos]
            command = velocity + torque / self._gain + _POSITION_GAIN * lag
        data.ctrl[self._robot.arm_ctrl] = command

    def hold(self, data: mujoco.MjData, position: Array) -> None:
        """Command the arm to stand still at a position (6,), in [rad]."""
        weight = data.qfrc_bias - data.qfrc_passive
        torque = weight[self._robot.arm_dofs]
        self.track(data, position, 0.0 * position, torque)
