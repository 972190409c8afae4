import mujoco
import numpy as np
import pytest

from tablesetting.scene.controller import ArmController
from tablesetting.scene.jaw import MAX_OPENING
from tablesetting.scene.robot import HOME, RobotIndex, robot_model
from tablesetting.scene.servos import REAL, SERVOS, STIFF

PERIOD, SUBSTEPS = 0.008, 4


class Bench:
    """The arm alone with its controller."""

    def __init__(self, servos):
        self.model = robot_model(servos)
        self.data = mujoco.MjData(self.model)
        self.robot = RobotIndex.of(self.model)
        self.controller = ArmController(self.model, self.robot, servos)
        self.robot.set_posture(self.data, HOME, MAX_OPENING / 2)
        self.data.ctrl[self.robot.jaw_ctrl] = MAX_OPENING / 2
        mujoco.mj_forward(self.model, self.data)

    @property
    def position(self):
        return self.data.qpos[self.robot.arm_qpos].copy()

    @property
    def tool(self):
        return self.data.site_xpos[self.robot.tcp].copy()

    def step(self):
        mujoco.mj_step(self.model, self.data, SUBSTEPS)


@pytest.fixture(params=SERVOS.values(), ids=SERVOS)
def bench(request):
    return Bench(request.param)


def test_the_arm_stands_still_under_its_weight(bench):
    before = bench.tool
    for _ in range(250):
        bench.controller.hold(bench.data, np.array(HOME))
        bench.step()
    assert np.linalg.norm(bench.tool - before) < 5e-4


@pytest.mark.parametrize("servos", [STIFF, REAL], ids=["stiff", "real"])
def test_a_smooth_motion_is_followed(servos):
    """A quarter of the speed limit at most, half a second up and half down."""
    bench = Bench(servos)
    times = np.arange(1, 251) * PERIOD
    swing = 0.25 * servos.speed_limits / np.pi
    lags = []
    for time in times:
        offset = swing * (1.0 - np.cos(np.pi * time)) / 2.0
        velocity = swing * np.pi * np.sin(np.pi * time) / 2.0
        target = np.array(HOME) + offset
        weight = bench.data.qfrc_bias - bench.data.qfrc_passive
        torque = weight[bench.robot.arm_dofs]
        bench.controller.track(bench.data, target, velocity, torque)
        bench.step()
        lags.append(np.abs(bench.position - target).max())
    assert max(lags) < 0.02
    assert lags[-1] < 5e-3


@pytest.mark.parametrize("servos", [STIFF, REAL], ids=["stiff", "real"])
def test_servos_are_clipped_at_their_torque(servos):
    bench = Bench(servos)
    far = np.array(HOME) + [1.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    speed = servos.speed_limits
    bench.controller.track(bench.data, far, speed, 10.0 * servos.torque_limits)
    bench.step()
    forces = bench.data.actuator_force[bench.robot.arm_ctrl]
    assert (np.abs(forces) <= servos.torque_limits * (1.0 + 1e-9)).all()
    assert np.isclose(np.abs(forces), servos.torque_limits).any()


def test_servos_of_a_name_are_found_by_it():
    assert SERVOS == {"stiff": STIFF, "real": REAL}


def test_the_real_servos_are_those_of_the_data_sheet():
    assert REAL.torque_limits.tolist() == [30.5, 30.5, 30.5, 6.8, 6.8, 6.8]
    np.testing.assert_allclose(np.degrees(REAL.speed_limits), 3 * [36.0] + 3 * [48.0])
