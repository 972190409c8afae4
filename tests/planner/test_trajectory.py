from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.planner.load import Load
from tablesetting.planner.trajectory import (
    CONTROL_PERIOD,
    brake,
    move_through,
    reverse,
    wait,
)
from tablesetting.scene.robot import HOME
from tablesetting.scene.servos import REAL, STIFF

LOAD = Load(STIFF)


@st.composite
def waypoints(draw):
    """Paths that bend, but not back, as solutions of nearby poses do."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    num_steps = draw(st.integers(1, 12))
    onward = rng.normal(0.0, 0.15, 6)
    steps = onward * rng.uniform(0.7, 1.3, (num_steps, 1))
    steps += rng.normal(0.0, 0.04, (num_steps, 6))
    return np.vstack([np.zeros(6), np.cumsum(steps, axis=0)])


@given(waypoints())
def test_a_move_ends_at_rest_at_the_last_waypoint(points):
    step = move_through("lift", points, 0.01, LOAD)
    np.testing.assert_allclose(step.positions[-1], points[-1], atol=1e-9)
    np.testing.assert_allclose(step.velocities[-1], 0.0, atol=1e-9)


@given(waypoints())
def test_velocities_are_the_rates_of_the_positions(points):
    step = move_through("lift", points, 0.01, LOAD)
    positions = np.vstack([points[0], step.positions])
    velocities = np.vstack([np.zeros(6), step.velocities])
    travelled = 0.5 * CONTROL_PERIOD * (velocities[1:] + velocities[:-1])
    np.testing.assert_allclose(np.diff(positions, axis=0), travelled, atol=5e-4)


@given(waypoints())
def test_joint_limits_are_respected_and_one_of_them_is_used(points):
    step = move_through("lift", points, 0.01, LOAD)
    speed = np.abs(step.velocities) / (0.9 * STIFF.speed_limits)
    acceleration = np.abs(np.diff(step.velocities, axis=0)) / CONTROL_PERIOD
    assert speed.max() <= 1.02
    acceleration /= STIFF.acceleration_limits
    assert acceleration.max() <= 1.2  # It jumps at waypoints, between two samples.
    torque = np.abs(step.torques) / (0.9 * STIFF.torque_limits)
    assert torque.max() <= 1.0
    assert speed.max() > 0.9 or acceleration.max() > 0.6 or torque.max() > 0.8


@given(waypoints())
def test_a_move_passes_every_waypoint(points):
    step = move_through("lift", points, 0.01, LOAD)
    path = np.vstack([points[0], step.positions])
    gaps = np.linalg.norm(points[:, None] - path, axis=2).min(axis=1)
    longest_tick = np.linalg.norm(np.diff(path, axis=0), axis=1).max()
    assert gaps.max() <= longest_tick


def test_a_straight_move_reaches_half_way_in_half_the_time():
    step = move_through("lift", np.array([np.zeros(6), np.full(6, 0.6)]), 0.01, LOAD)
    middle = len(step.positions) // 2
    if len(step.positions) % 2 == 0:
        np.testing.assert_allclose(step.positions[middle - 1], 0.3, atol=1e-9)
    np.testing.assert_allclose(step.positions, step.positions[:, :1] * np.ones(6))


def test_waiting_keeps_the_arm_where_it_is():
    step = wait("close", np.arange(6.0), 0.0, 0.4, LOAD)
    assert step.positions.shape == (50, 6)
    np.testing.assert_array_equal(step.positions, np.tile(np.arange(6.0), (50, 1)))
    assert not step.velocities.any()


def test_a_weak_arm_takes_its_time():
    weak = replace(STIFF, max_torques=(4.0, 4.0))
    there = np.array(HOME) + [0.5, 0.3, 0.3, 0.0, 0.0, 0.0]
    waypoints = np.array([HOME, there])
    fast, slow = (
        move_through("lift", waypoints, 0.01, Load(servos)) for servos in (STIFF, weak)
    )
    assert len(slow.positions) > 1.2 * len(fast.positions)
    shares = np.abs(slow.torques) / (0.9 * weak.torque_limits)
    assert 0.8 < shares.max() <= 1.0
    np.testing.assert_allclose(slow.positions[-1], there, atol=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_a_step_that_is_broken_off_comes_to_rest_along_its_path(share):
    there = np.array(HOME) + [0.5, 0.3, 0.3, 0.2, -0.2, 0.4]
    step = move_through("lift", np.array([HOME, there]), 0.01, LOAD)
    tick = int(share * (len(step.positions) - 1))
    stop = brake(step, tick, LOAD)
    assert not stop.velocities[-1].any()
    path = np.vstack([step.positions[tick], stop.positions])
    rates = np.vstack([step.velocities[tick], stop.velocities])
    travelled = 0.5 * CONTROL_PERIOD * (rates[1:] + rates[:-1])
    np.testing.assert_allclose(np.diff(path, axis=0), travelled, atol=5e-4)
    assert np.abs(np.diff(rates, axis=0)).max() / CONTROL_PERIOD <= 1.2 * 8.0
    along = (path - HOME) @ (there - HOME) / np.square(there - HOME).sum()
    straight = np.array(HOME) + np.outer(along, there - HOME)
    np.testing.assert_allclose(path, straight, atol=1e-9)
    assert (np.diff(along) >= 0.0).all()
    assert along[-1] <= 1.0


def test_a_step_is_gone_back_as_it_was_gone_forth():
    there = np.array(HOME) + [0.5, 0.3, 0.3, 0.2, -0.2, 0.4]
    step = move_through("lift", np.array([HOME, there]), 0.01, Load(REAL, 0.3))
    back = reverse(step, "go back", Load(REAL, 0.3))
    np.testing.assert_array_equal(back.positions, step.positions[::-1])
    np.testing.assert_array_equal(back.velocities, -step.velocities[::-1])
    assert (np.abs(back.torques) <= REAL.torque_limits).all()
    middle = len(step.positions) // 2
    friction = 0.5 * (step.torques[middle] - back.torques[-middle - 1])
    moving = np.abs(step.velocities[middle]) > 0.01
    expected = np.repeat(REAL.frictions, 3) * np.sign(step.velocities[middle])
    np.testing.assert_allclose(friction[moving], expected[moving], rtol=0.1)
