import numpy as np
import pytest

from tablesetting.planner.ik import IkConfig, IkSolver
from tablesetting.scene.robot import HOME, TCP_SITE, robot_model
from tablesetting.scene.servos import STIFF

POSTURE = np.array([*HOME, 0.0, 0.0])
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def solver():
    return IkSolver(robot_model(STIFF), TCP_SITE, POSTURE)


def test_tolerances_must_be_positive():
    with pytest.raises(ValueError, match="must be positive; got 0"):
        IkConfig(position_tol=0.0)


def test_an_unknown_site_is_refused():
    with pytest.raises(ValueError, match="no site 'nose'"):
        IkSolver(robot_model(STIFF), "nose", POSTURE)


def test_a_posture_of_the_wrong_length_is_refused():
    with pytest.raises(ValueError, match=r"shape \(8,\); got \(6,\)"):
        IkSolver(robot_model(STIFF), TCP_SITE, np.array(HOME))


@pytest.mark.parametrize("seed", range(10))
def test_solution_brings_the_site_to_the_pose(solver, seed):
    rng = np.random.default_rng(seed)
    hidden = POSTURE + np.append(rng.uniform(-0.5, 0.5, 6), [0.0, 0.0])
    position, rotation = solver.forward(hidden)
    result = solver.solve(position, rotation)
    assert result.is_solved
    reached, turned = solver.forward(result.configuration)
    assert np.linalg.norm(reached - position) <= 1e-4
    assert np.arccos(min(1.0, (np.trace(turned.T @ rotation) - 1) / 2)) <= 2e-3


def test_solution_stays_within_the_joint_limits(solver):
    model = robot_model(STIFF)
    for x in np.linspace(-0.3, 0.3, 7):
        result = solver.solve(np.array([x, -0.1, 0.1]), DOWN)
        limited = model.jnt_limited == 1
        low, high = model.jnt_range[limited].T
        assert (result.configuration[limited] >= low - 1e-6).all()
        assert (result.configuration[limited] <= high + 1e-6).all()


def test_joints_without_limits_stay_on_the_turn_they_start_on(solver):
    position, rotation = solver.forward(POSTURE)
    start = POSTURE + 2 * np.pi * np.array([1, 0, 0, -1, 0, 2, 0, 0])
    result = solver.solve(position + [0.02, 0.0, 0.0], rotation, start)
    assert result.is_solved
    assert np.abs(result.configuration - start).max() < 0.5


def test_out_of_reach_is_reported_and_not_raised(solver):
    result = solver.solve(np.array([0.0, 2.0, 0.2]), DOWN)
    assert not result.is_solved
    # The stretched arm ends somewhere between 0.5 and 1.2 m from its foot.
    assert 1.2 < result.position_error < 2.0


def test_same_question_has_the_same_answer(solver):
    target = np.array([0.2, 0.3, 0.3])
    first = solver.solve(target, DOWN)
    solver.solve(np.array([-0.1, 0.0, 0.1]), DOWN)
    second = solver.solve(target, DOWN)
    np.testing.assert_array_equal(first.configuration, second.configuration)


def test_restarts_find_what_one_descent_misses():
    twisted = POSTURE + np.array([-0.1, 1.9, 2.2, -0.7, 0.4, -0.9, 0.0, 0.0])
    target = np.array([0.06, -0.05, 0.15])
    once = IkSolver(robot_model(STIFF), TCP_SITE, POSTURE, IkConfig(num_restarts=0))
    assert not once.solve(target, DOWN, twisted).is_solved
    often = IkSolver(robot_model(STIFF), TCP_SITE, POSTURE)
    assert often.solve(target, DOWN, twisted).is_solved
