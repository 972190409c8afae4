import numpy as np
import pytest

from tablesetting.planner.goal import Goal, Reason, Refusal, find_goals, gap_at
from tablesetting.planner.receptacle import RECEPTACLES
from tablesetting.scene.perception import Camera
from tablesetting.scene.props import PROPS

FREE = np.array([0.02, -0.05])
SPOON, BOWL = PROPS["spoon"], PROPS["bowl"]


def goals_of(scene, target, yaw=None):
    return find_goals(scene, Camera(scene).look(), np.asarray(target), yaw)


def gap(scene, target, yaw, name):
    return gap_at(scene, Camera(scene).look(), np.asarray(target), yaw, name)


def test_round_things_are_as_far_apart_as_their_centers_less_both_radii(vase_scene):
    cup = vase_scene.position("cup")[:2]
    away = gap(vase_scene, cup + [0.06, 0.08], 0.7, "cup")
    assert away == pytest.approx(0.1 - PROPS["cup"].radius - PROPS["vase"].radius)


@pytest.mark.parametrize(
    ("offset", "yaw", "distance"),
    [
        ((0.1, 0.0), 0.0, 0.1),
        ((0.1, 0.0), np.pi / 2, 0.1 - SPOON.half_length),
        ((0.0, 0.2), 0.0, 0.2 - SPOON.half_length),
        ((0.0, 0.0), 0.3, 0.0),
    ],
)
def test_a_spoon_is_as_near_as_the_nearest_point_along_it(
    spoon_scene, offset, yaw, distance
):
    bowl = spoon_scene.position("bowl")[:2]
    found = gap(spoon_scene, bowl + offset, yaw, "bowl")
    assert found == pytest.approx(distance - SPOON.radius - BOWL.radius, abs=1e-4)


def test_a_turned_neighbour_is_as_near_as_it_is_turned(spoon_scene):
    seen = Camera(spoon_scene).look()
    knife = seen.poses["knife"]
    target = knife[:2] + [0.1, 0.0]
    beside = gap_at(spoon_scene, seen, target, 0.0, "knife")
    knife[3:] = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    before = gap_at(spoon_scene, seen, target, 0.0, "knife")
    assert beside - before == pytest.approx(PROPS["knife"].half_length, abs=1e-4)


def test_a_free_place_is_the_one_goal(vase_scene):
    (goal,) = goals_of(vase_scene, FREE, 0.4)
    assert (goal.yaw, goal.receptacle) == (0.4, None)
    np.testing.assert_array_equal(goal.rest, [*FREE, 0.0])
    assert 0.0 < goal.release[2] < 0.003


def test_the_end_of_the_table_is_further_for_a_spoon_across(spoon_scene):
    edge = 0.65 - SPOON.radius
    assert isinstance(goals_of(spoon_scene, (edge - 1e-3, 0.0)), list)
    assert goals_of(spoon_scene, (edge + 1e-3, 0.0)).reason == Reason.OUTSIDE
    across = goals_of(spoon_scene, (edge - 1e-3, 0.0), np.pi / 2)
    assert across.reason == Reason.OUTSIDE
    assert "would not lie on the table" in across.detail


def test_a_taken_place_is_refused_by_how_much_is_lacking(vase_scene):
    touching = PROPS["vase"].radius + PROPS["glass"].radius
    target = vase_scene.position("glass")[:2] + [touching - 0.004, 0.0]
    refusal = goals_of(vase_scene, target)
    assert refusal == Refusal(
        Reason.OCCUPIED, "the vase would stand 4.0 mm in the glass"
    )


def test_over_the_bowl_the_spoon_may_have_many_headings(spoon_scene):
    center = spoon_scene.position("bowl")[:2]
    goals = goals_of(spoon_scene, center)
    assert len({goal.yaw for goal in goals}) == len(goals) > 6
    for goal in goals:
        assert goal.receptacle == "bowl"
        assert goal.release[2] > BOWL.height
        np.testing.assert_array_equal(goal.target, center)


def test_a_heading_that_is_commanded_is_kept(spoon_scene):
    (goal,) = goals_of(spoon_scene, spoon_scene.position("bowl")[:2], 1.1)
    assert goal.yaw == 1.1


def test_a_heading_that_ends_on_the_rim_is_refused(spoon_scene):
    ahead = spoon_scene.position("bowl")[:2] + [0.0, 0.015]
    refusal = goals_of(spoon_scene, ahead, 0.0)  # Its head would be on the far rim.
    assert refusal.reason == Reason.OCCUPIED
    assert "on the rim of the bowl" in refusal.detail
    assert isinstance(goals_of(spoon_scene, ahead), list)


def test_the_bowl_is_reached_into_near_its_middle_alone(spoon_scene):
    reach = RECEPTACLES["spoon", "bowl"].radius
    center = spoon_scene.position("bowl")[:2]
    # A little more, as the bowl may not be quite where it was thought.
    assert isinstance(goals_of(spoon_scene, center + [reach + 4e-3, 0.0]), list)
    refusal = goals_of(spoon_scene, center + [reach + 6e-3, 0.0])
    assert refusal.reason == Reason.OCCUPIED
    assert "within 20 mm of its centre, not 26 mm" in refusal.detail


def test_a_handle_that_leans_out_keeps_away_from_tall_neighbours(spoon_scene):
    seen = Camera(spoon_scene).look()
    bowl = seen.position("bowl")[:2]
    everywhere = find_goals(spoon_scene, seen, bowl, None)
    seen.poses["glass"][:2] = bowl + [BOWL.radius + PROPS["glass"].radius + 0.005, 0.0]
    left = find_goals(spoon_scene, seen, bowl, None)
    assert 0 < len(left) < len(everywhere)
    for goal in left:
        handle = [np.sin(goal.yaw), -np.cos(goal.yaw)]
        assert handle[0] < 0.9, "towards the glass"
    refusal = find_goals(spoon_scene, seen, bowl, np.pi / 2)
    assert refusal.reason == Reason.TOO_TALL
    assert "glass" in refusal.detail


def test_only_a_spoon_goes_into_a_bowl(vase_scene):
    refusal = goals_of(vase_scene, vase_scene.position("bowl")[:2])
    assert refusal.reason == Reason.OCCUPIED


def test_in_a_receptacle_the_item_rests_where_it_is_let_go():
    release = np.array([0.1, 0.2, 0.08])
    goal = Goal(np.array([0.1, 0.19]), 0.0, release, "bowl")
    np.testing.assert_array_equal(goal.rest, release)
