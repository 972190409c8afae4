import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.planner.grasp import GRASPS, Hold, ToolPose
from tablesetting.scene.robot import BASE_POSITION

angles = st.floats(-3.0, 3.0)
points = st.tuples(*[st.floats(-0.5, 0.5)] * 3).map(np.array)


@given(angles)
def test_the_tool_points_straight_down(yaw):
    rotation = ToolPose(np.zeros(3), yaw).rotation
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_array_equal(rotation[:, 2], [0.0, 0.0, -1.0])


@given(points, angles, points, angles)
def test_a_measured_hold_leads_back_to_the_tool(position, yaw, item_position, item_yaw):
    tool = ToolPose(position, yaw)
    hold = Hold.measure(tool, item_position, item_yaw)
    back = hold.tool_pose(item_position, item_yaw - hold.yaw)
    np.testing.assert_allclose(back.position, position, atol=1e-12)
    assert back.yaw == pytest.approx(yaw)


@pytest.mark.parametrize("grasp", GRASPS["spoon"])
def test_fingers_close_across_the_handle(grasp):
    tool = grasp.tool_pose(np.array([0.1, 0.2]))
    closing_direction = tool.rotation[:, 1]
    np.testing.assert_allclose(closing_direction, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(tool.position, [0.1, 0.2 + grasp.along, grasp.height])


@given(points)
def test_a_vase_is_held_in_line_with_the_arm(point):
    (grasp,) = GRASPS["vase"]
    tool = grasp.tool_pose(point[:2])
    outward = point[:2] - BASE_POSITION[:2]
    across = tool.rotation[:2, 1] @ outward
    assert across == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(tool.position, [*point[:2], grasp.height])
