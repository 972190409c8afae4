import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.planner.trajectory import CONTROL_PERIOD, move_through, wait

SPEED = np.array([1.6, 1.6, 1.6, 2.2, 2.2, 2.2])
ACCELERATION = 8.0


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
    step = move_through("lift", points, 0.01)
    np.testing.assert_allclose(step.positions[-1], points[-1], atol=1e-9)
    np.testing.assert_allclose(step.velocities[-1], 0.0, atol=1e-9)


@given(waypoints())
def test_velocities_are_the_rates_of_the_positions(points):
    step = move_through("lift", points, 0.01)
    positions = np.vstack([points[0], step.positions])
    velocities = np.vstack([np.zeros(6), step.velocities])
    travelled = 0.5 * CONTROL_PERIOD * (velocities[1:] + velocities[:-1])
    np.testing.assert_allclose(np.diff(positions, axis=0), travelled, atol=5e-4)


@given(waypoints())
def test_joint_limits_are_respected_and_one_of_them_is_used(points):
    step = move_through("lift", points, 0.01)
    speed = np.abs(step.velocities) / SPEED
    acceleration = np.abs(np.diff(step.velocities, axis=0)) / CONTROL_PERIOD
    assert speed.max() <= 1.02
    assert acceleration.max() <= 1.1 * ACCELERATION
    assert speed.max() > 0.9 or acceleration.max() > 0.6 * ACCELERATION


@given(waypoints())
def test_a_move_passes_every_waypoint(points):
    step = move_through("lift", points, 0.01)
    path = np.vstack([points[0], step.positions])
    gaps = np.linalg.norm(points[:, None] - path, axis=2).min(axis=1)
    longest_tick = np.linalg.norm(np.diff(path, axis=0), axis=1).max()
    assert gaps.max() <= longest_tick


def test_a_straight_move_reaches_half_way_in_half_the_time():
    step = move_through("lift", np.array([np.zeros(6), np.full(6, 0.6)]), 0.01)
    middle = len(step.positions) // 2
    if len(step.positions) % 2 == 0:
        np.testing.assert_allclose(step.positions[middle - 1], 0.3, atol=1e-9)
    np.testing.assert_allclose(step.positions, step.positions[:, :1] * np.ones(6))


def test_waiting_keeps_the_arm_where_it_is():
    step = wait("close", np.arange(6.0), 0.0, 0.35)
    assert step.positions.shape == (35, 6)
    np.testing.assert_array_equal(step.positions, np.tile(np.arange(6.0), (35, 1)))
    assert not step.velocities.any()
