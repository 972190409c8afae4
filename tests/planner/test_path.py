import numpy as np
import pytest

from tablesetting.planner.grasp import ToolPose
from tablesetting.planner.load import Load, Overload
from tablesetting.planner.path import Path, Unreachable, home_pose, tool_pose_at
from tablesetting.scene.robot import BASE_POSITION, HOME
from tablesetting.scene.servos import STIFF

GOAL = ToolPose(np.array([0.2, 0.1, 0.1]), 0.5)


@pytest.fixture
def path():
    return Path(np.array(HOME), home_pose(), 0.02, Load(STIFF))


def poses_along(step):
    return [tool_pose_at(configuration) for configuration in step.positions]


def test_a_move_ends_at_its_goal(path):
    path.move("reach", GOAL)
    (step,) = path.steps
    end = tool_pose_at(step.positions[-1])
    np.testing.assert_allclose(end.position, GOAL.position, atol=1e-4)
    assert end.yaw == pytest.approx(GOAL.yaw, abs=1e-3)
    assert (step.phase, step.opening) == ("reach", 0.02)
    assert path.pose == GOAL
    np.testing.assert_array_equal(path.configuration, step.positions[-1])


def test_a_level_move_stays_level_and_goes_around_the_foot(path):
    path.move("reach", GOAL)
    path.move("transfer", ToolPose(np.array([-0.2, 0.1, 0.1]), 2.6))
    poses = poses_along(path.steps[-1])
    heights = [pose.position[2] for pose in poses]
    np.testing.assert_allclose(heights, 0.1, atol=1e-3)
    radii = [np.hypot(*pose.wrist) for pose in poses]
    ends = sorted((np.hypot(*GOAL.wrist), radii[-1]))
    assert ends[0] - 1e-3 < min(radii) <= max(radii) < ends[1] + 1e-3


def test_the_heading_turns_the_short_way(path):
    path.move("reach", ToolPose(np.array([0.0, 0.1, 0.2]), 3.0))
    path.move("turn", ToolPose(np.array([0.0, 0.1, 0.2]), -3.0))
    yaws = np.unwrap([pose.yaw for pose in poses_along(path.steps[-1])])
    assert np.ptp(yaws) < 2.0 * np.pi - 6.0 + 1e-2


def test_going_up_moves_nothing_sideways(path):
    path.move("reach", GOAL)
    path.move("lift", GOAL.raised_to(0.25))
    for pose in poses_along(path.steps[-1]):
        np.testing.assert_allclose(pose.position[:2], GOAL.position[:2], atol=1e-3)
        assert pose.yaw == pytest.approx(GOAL.yaw, abs=5e-3)


def test_fingers_and_time_are_added_where_the_arm_stands(path):
    path.move("reach", GOAL)
    path.grip("close", 0.0, 0.4)
    path.wait("settle", 0.08)
    close, settle = path.steps[1:]
    assert (len(close.positions), len(settle.positions)) == (50, 10)
    assert close.opening == settle.opening == path.opening == 0.0
    np.testing.assert_array_equal(close.positions[0], path.configuration)


def test_a_place_out_of_reach_is_named_with_the_phase(path):
    far = ToolPose(np.array([BASE_POSITION[0], 0.9, 0.1]), np.pi / 2)
    with pytest.raises(Unreachable, match=r"transfer: the arm does not reach") as error:
        path.move("transfer", far)
    assert error.value.phase == "transfer"
    assert path.steps == []
    assert path.pose == home_pose()


def test_a_load_that_is_too_heavy_is_not_moved(path):
    path.load = Load(STIFF, mass=100.0)
    with pytest.raises(Overload, match="joint 2 would have to bear"):
        path.move("lift", GOAL)
