import numpy as np
import pytest

from tablesetting.planner.goal import find_goals
from tablesetting.planner.grasp import GRASPS
from tablesetting.planner.grip import best_grips
from tablesetting.planner.pick_place import transfer_heights
from tablesetting.scene.perception import Camera
from tablesetting.scene.props import PROPS

FREE = np.array([0.02, -0.05])
MIDDLE = np.array([0.02, 0.0])


def grips_of(scene, seen, target, yaw=None):
    goals = find_goals(scene, seen, np.asarray(target), yaw)
    heights = transfer_heights(scene, GRASPS[scene.item][0])
    return best_grips(scene, seen, goals, heights)


def with_glass(scene, offset):
    """See the glass at an offset from the middle."""
    seen = Camera(scene).look()
    seen.poses["glass"][:2] = MIDDLE + offset
    return seen


def test_the_best_grip_comes_first_and_each_way_once(vase_scene):
    grips = grips_of(vase_scene, Camera(vase_scene).look(), FREE)
    scores = [grip.score for grip in grips]
    assert scores == sorted(scores, reverse=True)
    assert len({grip.place.yaw for grip in grips}) == len(grips) == 24


def test_every_goal_can_be_got_to_with_every_grasp(spoon_scene):
    seen = Camera(spoon_scene).look()
    bowl = seen.position("bowl")[:2]
    goals = find_goals(spoon_scene, seen, bowl, None)
    grips = grips_of(spoon_scene, seen, bowl)
    ways = {(grip.grasp, grip.goal.yaw) for grip in grips}
    assert len(ways) == len(grips) == len(goals) * len(GRASPS["spoon"])


def test_a_grip_holds_the_item_where_it_is_and_where_it_goes(spoon_scene):
    seen = Camera(spoon_scene).look()
    for grip in grips_of(spoon_scene, seen, MIDDLE, 0.7):
        stand = seen.position("spoon") * [1, 1, 0]
        for tool, origin, yaw in (
            (grip.pick, stand, seen.yaw("spoon")),
            (grip.place, grip.goal.release, 0.7),
        ):
            held = tool.position + tool.rotation @ grip.grasp.hold.offset
            np.testing.assert_allclose(held, origin, atol=1e-12)
            turn = tool.yaw + grip.grasp.hold.yaw - yaw
            assert np.cos(turn) == pytest.approx(1.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("end", [-1.0, 1.0])
def test_a_spoon_beside_a_glass_is_held_away_from_it(spoon_scene, end, side):
    # Beside the inner or the outer end of the handle, to either side of it.
    seen = with_glass(spoon_scene, [0.058 * side, 0.06 * end - 0.02])
    best = grips_of(spoon_scene, seen, MIDDLE, 0.0)[0]
    glass = seen.position("glass")[:2]
    wrist = best.place.position[:2] - 0.05 * best.place.rotation[:2, 0]
    other_wrist = best.place.position[:2] + 0.05 * best.place.rotation[:2, 0]
    assert np.linalg.norm(wrist - glass) > np.linalg.norm(other_wrist - glass) + 0.03


def test_room_to_spare_is_worth_no_more(spoon_scene):
    near, far, further = (
        [grip.score for grip in grips_of(spoon_scene, seen, MIDDLE, 0.0)]
        for seen in (with_glass(spoon_scene, [x, -0.02]) for x in (0.058, 0.2, 0.25))
    )
    assert max(near) < max(far)
    assert far == further


def test_a_place_within_comfortable_reach_is_better(vase_scene):
    seen = Camera(vase_scene).look()
    scores = [
        grips_of(vase_scene, seen, target)[0].score
        for target in (FREE, (0.55, 0.1), (0.6, 0.2))
    ]
    assert scores[0] > scores[1] > 0.0 > scores[2]  # The last is out of reach.


def test_neighbours_that_are_lower_than_the_hand_are_of_no_matter(vase_scene):
    seen = Camera(vase_scene).look()
    alone = [grip.score for grip in grips_of(vase_scene, seen, FREE)]
    for name in vase_scene.objects:
        seen.poses[name][:2] = FREE + [0.0, 0.01 + PROPS[name].radius + 0.045]
    crowded = [grip.score for grip in grips_of(vase_scene, seen, FREE)]
    assert crowded == alone
