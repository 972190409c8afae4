import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.planner.grasp import GRASPS, Hold, ToolPose
from tablesetting.scene.jaw import WRIST_OFFSET
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
    (tool,) = grasp.tool_poses(np.array([0.1, 0.2, 0.0]), 0.0)
    closing_direction = np.abs(tool.rotation[:, 1])
    np.testing.assert_allclose(closing_direction, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(tool.position, [0.1, 0.2 + grasp.along, grasp.height])


@given(angles)
def test_a_turned_spoon_is_held_by_a_turned_hand(yaw):
    for grasp in GRASPS["spoon"]:
        (straight,), (turned,) = (
            grasp.tool_poses(np.zeros(3), each) for each in (0.0, yaw)
        )
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(
            turned.position, turn @ straight.position, atol=1e-12
        )
        np.testing.assert_allclose(
            turned.rotation, turn @ straight.rotation, atol=1e-12
        )


def test_the_wrist_is_on_one_side_of_the_spoon_or_the_other():
    (near,), (far,) = (
        grasp.tool_poses(np.zeros(3), 0.0) for grasp in GRASPS["spoon"][:2]
    )
    assert far.wrist[1] - near.wrist[1] == pytest.approx(2.0 * WRIST_OFFSET)


@given(points)
def test_a_vase_is_held_from_all_sides(point):
    (grasp,) = GRASPS["vase"]
    tools = grasp.tool_poses(np.array([*point[:2], 0.0]), 0.3)
    for tool in tools:
        np.testing.assert_allclose(tool.position, [*point[:2], grasp.height])
    outwards = point[:2] - BASE_POSITION[:2]
    first = tools[0].rotation[:2, 0]
    np.testing.assert_allclose(
        first * np.linalg.norm(outwards), outwards, atol=1e-12
    )  # Where the arm reaches furthest.
    headings = np.unwrap([tool.yaw for tool in tools])
    np.testing.assert_allclose(np.diff(headings), np.radians(15.0))
