from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tablesetting.planner.load import Load, Overload
from tablesetting.planner.trajectory import move_through
from tablesetting.scene.robot import HOME, RobotIndex, robot_model
from tablesetting.scene.servos import REAL, STIFF

POSTURE = np.array(HOME)


def test_the_stiff_arm_carries_its_own_weight_for_nothing():
    np.testing.assert_allclose(Load(STIFF).weight(POSTURE), 0.0, atol=1e-4)


def test_the_real_arm_bears_what_gravity_asks_for():
    model = robot_model(REAL)
    robot, data = RobotIndex.of(model), mujoco.MjData(model)
    robot.set_posture(data, HOME, 0.02)
    mujoco.mj_forward(model, data)
    asked = data.qfrc_bias[robot.arm_dofs]
    np.testing.assert_allclose(Load(REAL).weight(POSTURE), asked, atol=1e-4)
    assert np.abs(asked).max() > 1.0


def test_what_is_carried_weighs_on_the_shoulder_by_its_lever():
    light, heavy = Load(STIFF), Load(STIFF, 0.5)
    model = robot_model(STIFF)
    robot, data = RobotIndex.of(model), mujoco.MjData(model)
    robot.set_posture(data, HOME, 0.02)
    mujoco.mj_kinematics(model, data)
    axis, anchor = (
        data.xaxis[model.joint("jaco/joint_2").id],
        data.xanchor[model.joint("jaco/joint_2").id],
    )
    pull = np.array([0.0, 0.0, 0.5 * 9.81])
    lever = np.cross(data.site_xpos[robot.tcp] - anchor, pull) @ axis
    added = heavy.weight(POSTURE) - light.weight(POSTURE)
    assert added[1] == pytest.approx(lever, rel=1e-6)


def test_torques_along_a_motion_are_those_of_newton():
    period, times = 0.008, np.arange(1, 41) * 0.008
    rates = np.array([0.5, 0.3, -0.2, 0.1, 0.4, -0.3])
    positions = POSTURE + 0.5 * np.outer(times**2, rates)
    velocities = np.outer(times, rates)
    found = Load(STIFF).torques(positions, velocities, period)
    model = robot_model(STIFF)
    robot, data = RobotIndex.of(model), mujoco.MjData(model)
    for tick in (0, 20, 39):
        robot.set_posture(data, positions[tick], 0.02)
        data.qvel[robot.arm_dofs] = velocities[tick]
        data.qacc[:] = 0.0
        data.qacc[robot.arm_dofs] = rates
        mujoco.mj_inverse(model, data)
        expected = data.qfrc_inverse[robot.arm_dofs]
        np.testing.assert_allclose(found[tick], expected, rtol=1e-6, atol=1e-3)


def test_the_excess_is_the_largest_share_of_nine_tenths_of_a_limit():
    torques = np.zeros((3, 6))
    torques[1, 4] = -0.45 * STIFF.torque_limits[4]
    assert Load(STIFF).excess(torques) == pytest.approx(0.5)


def test_four_times_too_much_torque_takes_twice_the_time():
    still = np.tile(POSTURE, (9, 1))
    allowed = np.tile(0.9 * STIFF.torque_limits, (9, 1))
    load = Load(STIFF)
    assert load.slowdown(still, 4.0 * allowed) == pytest.approx(2.0, rel=1e-4)
    assert load.slowdown(still, 0.1 * allowed) == 1.05


@pytest.mark.parametrize(
    "servos",
    [
        replace(STIFF, max_torques=(4.0, 4.0)),
        replace(REAL, max_torques=(14.0, 6.0), frictions=(0.0, 0.0)),
    ],
)
def test_slowing_down_spares_the_joints(servos):
    load = Load(servos, mass=0.3)
    there = np.array([0.5, 0.3, 0.3, 0.0, 0.0, 0.0])

    def swing(duration):
        times = np.arange(1, round(duration / 0.008) + 1)[:, None] * 0.008
        angles = np.pi * times / duration
        positions = POSTURE + there * (1.0 - np.cos(angles)) / 2.0
        velocities = there * np.sin(angles) * np.pi / duration / 2.0
        return positions, load.torques(positions, velocities, 0.008)

    duration = 0.4
    positions, torques = swing(duration)
    assert load.excess(torques) > 1.5
    # Damping falls more slowly than inertia, so that once may not do.
    for _ in range(2):
        duration *= load.slowdown(positions, torques)
        positions, torques = swing(duration)
    assert 0.7 < load.excess(torques) <= 1.0


def test_a_weight_that_is_too_much_is_no_matter_of_speed():
    weak = replace(REAL, max_torques=(1.0, 1.0))
    load, still = Load(weak), np.tile(POSTURE, (5, 1))
    torques = load.torques(still, 0.0 * still, 0.008)
    assert load.excess(torques) > 1.0
    with pytest.raises(Overload, match=r"joint \d would have to bear .* at most"):
        load.slowdown(still, torques)


def test_dry_friction_does_not_fall_with_the_speed():
    """Weight alone would leave a little to move by; with friction nothing is left."""
    shoulder = np.abs(Load(REAL).weight(POSTURE))[:3].max()
    weak = replace(REAL, max_torques=((shoulder + 1.0) / 0.9, 6.8))
    with pytest.raises(Overload, match="of weight and friction"):
        move_through("lift", np.array([POSTURE, POSTURE + 0.1]), 0.0, Load(weak))


def test_stops_of_the_joints_bear_no_load():
    beyond = np.zeros(6)  # Outside the range of joints 2 and 3.
    assert np.abs(Load(STIFF).weight(beyond)).max() < 1e-3
