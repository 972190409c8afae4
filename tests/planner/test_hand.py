import numpy as np
import pytest

from tablesetting.planner.goal import find_goals
from tablesetting.planner.grasp import GRASPS, ToolPose
from tablesetting.planner.grip import best_grips
from tablesetting.planner.hand import clearances
from tablesetting.planner.pick_place import transfer_heights
from tablesetting.scene.jaw import FINGER_DEPTH, FINGER_HALF_WIDTH, PALM_HEIGHT
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
    assert across == pytest.approx(
        np.hypot(away - OPENING - FINGER_DEPTH, 0.0) - radius
    )
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
    behind = 0.15 - 0.05 - 0.02 - PROPS["glass"].radius
    assert near == pytest.approx(behind)


def test_many_poses_are_judged_as_one_by_one(seen):
    tools = [ToolPose(np.array([0.0, y, 0.05]), yaw) for y, yaw in ((0, 0), (0.1, 1))]
    together = clearances(tools, OPENING, seen, ["glass", "cup", "bowl"])
    alone = [clearances([t], OPENING, seen, ["glass", "cup", "bowl"])[0] for t in tools]
    np.testing.assert_array_equal(together, alone)


def grips_of(scene, seen, target, yaw=None):
    goals = find_goals(scene, seen, np.asarray(target), yaw)
    heights = transfer_heights(scene, GRASPS[scene.item][0])
    return best_grips(scene, seen, goals, heights)


def test_the_best_grip_comes_first_and_each_way_once(vase_scene, seen):
    grips = grips_of(vase_scene, seen, (0.02, -0.05))
    scores = [grip.score for grip in grips]
    assert scores == sorted(scores, reverse=True)
    assert len({grip.place.yaw for grip in grips}) == len(grips) == 24


def test_a_spoon_beside_a_glass_is_held_on_the_free_half(spoon_scene):
    seen = Camera(spoon_scene).look()
    target = np.array([0.02, 0.0])
    for end in (-1.0, 1.0):
        # The handle's outer half, or its inner one.
        seen.poses["glass"][:2] = target + [0.058, -0.02 + 0.06 * end]
        best = grips_of(spoon_scene, seen, target, 0.0)[0]
        offsets = best.place.position[:2] - seen.position("glass")[:2]
        others = [
            grip.place.position[:2] - seen.position("glass")[:2]
            for grip in grips_of(spoon_scene, seen, target, 0.0)
        ]
        distances = np.linalg.norm(others, axis=1)
        assert np.linalg.norm(offsets) > np.median(distances)
