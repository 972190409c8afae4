import numpy as np
import pytest

from tablesetting.planner.grasp import ToolPose
from tablesetting.planner.hand import clearances
from tablesetting.scene.jaw import (
    FINGER_DEPTH,
    FINGER_HALF_WIDTH,
    PALM_HEIGHT,
    WRIST_OFFSET,
)
from tablesetting.scene.perception import Camera
from tablesetting.scene.props import PROPS

OPENING = 0.02


@pytest.fixture
def seen(vase_scene):
    return Camera(vase_scene).look()


def room(seen, offset, height, yaw=0.0, name="glass"):
    position = np.array([*(seen.position(name)[:2] + offset), height])
    return clearances([ToolPose(position, yaw)], OPENING, seen, [name])[0]


def test_fingers_that_open_towards_a_neighbour_have_less_room(seen):
    radius, away = PROPS["glass"].radius, 0.15
    across = room(seen, [0.0, away], 0.05)
    assert across == pytest.approx(away - OPENING - FINGER_DEPTH - radius)
    along = room(seen, [-away, 0.0], 0.05)
    assert along == pytest.approx(np.hypot(away - FINGER_HALF_WIDTH, OPENING) - radius)


def test_a_hand_above_its_neighbours_has_all_the_room(seen):
    above = PROPS["glass"].height + 0.02
    assert room(seen, [0.0, 0.0], above) == np.inf
    assert room(seen, [0.0, 0.0], above - 0.01) < 0.0


def test_the_palm_counts_where_only_it_is_low_enough(seen):
    far = PROPS["plate"].radius + 0.06
    assert room(seen, [0.0, far], 0.05, name="plate") == np.inf
    palm_alone = PROPS["glass"].height - PALM_HEIGHT - 0.001
    near = room(seen, [0.15, 0.0], palm_alone)
    behind = 0.15 - WRIST_OFFSET - 0.02 - PROPS["glass"].radius
    assert near == pytest.approx(behind)
    assert room(seen, [0.15, 0.0], palm_alone + 0.002) > near


def test_many_poses_are_judged_as_one_by_one(seen):
    tools = [ToolPose(np.array([0.0, y, 0.05]), yaw) for y, yaw in ((0, 0), (0.1, 1))]
    together = clearances(tools, OPENING, seen, ["glass", "cup", "bowl"])
    alone = [clearances([t], OPENING, seen, ["glass", "cup", "bowl"])[0] for t in tools]
    np.testing.assert_array_equal(together, alone)


def test_the_nearest_neighbour_is_the_one_that_counts(seen):
    position = np.array([*(seen.position("glass")[:2] + [0.15, 0.0]), 0.05])
    tools = [ToolPose(position, 0.0)]
    names = ["glass", "cup", "bowl", "plate"]
    together = clearances(tools, OPENING, seen, names)
    each = [clearances(tools, OPENING, seen, [name]) for name in names]
    np.testing.assert_array_equal(together, np.min(each, axis=0))
    backwards = clearances(tools, OPENING, seen, names[::-1])
    np.testing.assert_array_equal(together, backwards)
    assert clearances(tools, OPENING, seen, []) == np.inf


def test_a_turned_neighbour_is_met_where_its_ends_are(spoon_scene):
    seen = Camera(spoon_scene).look()
    position = np.array([*(seen.position("knife")[:2] + [0.14, 0.0]), 0.0185])
    tools = [ToolPose(position, 0.0)]
    beside = clearances(tools, OPENING, seen, ["knife"])[0]
    seen.poses["knife"][3:] = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    before = clearances(tools, OPENING, seen, ["knife"])[0]
    assert before < beside - 0.05
