import numpy as np
import pytest

from tablesetting.planner.grasp import Hold
from tablesetting.planner.pick_place import (
    Plan,
    Reason,
    Refusal,
    plan,
    replan_placing,
)
from tablesetting.scene.robot import HOME
from tablesetting.scene.scene import Scene

FREE = (0.02, -0.05)


@pytest.mark.parametrize("target", [(0.0, np.nan), (0.0, 0.0, 0.0), (0.1,)])
def test_a_target_is_two_finite_numbers(vase_scene, target):
    with pytest.raises(ValueError, match="two finite numbers"):
        plan(vase_scene, target)


def test_an_item_that_nobody_can_hold_is_refused():
    scene = Scene((), "cup")
    scene.reset(np.empty((0, 2)))
    with pytest.raises(ValueError, match="no grasp for 'cup'; choose one of vase"):
        plan(scene, FREE)


@pytest.mark.parametrize(
    ("target", "reason", "detail"),
    [
        ((2.0, 0.0), Reason.BLOCKED, "off the table"),
        ((0.5, 0.3), Reason.UNREACHABLE, "does not reach"),
        ((0.25, 0.25), Reason.UNREACHABLE, "does not reach"),
        ((0.1, 0.1), Reason.BLOCKED, "bowl"),
        ((-0.15, 0.06), Reason.BLOCKED, "vase and glass"),
    ],
)
def test_what_cannot_be_done_is_refused_with_a_reason(
    vase_scene, target, reason, detail
):
    before = vase_scene.data.qpos.copy()
    refusal = plan(vase_scene, target)
    assert isinstance(refusal, Refusal)
    assert refusal.reason == reason
    assert detail in refusal.detail
    np.testing.assert_array_equal(vase_scene.data.qpos, before)


def test_a_spoon_needs_room_for_the_fingers(spoon_scene):
    glass = spoon_scene.position("glass")[:2]
    spoon, glass_radius = 0.016, 0.034
    tight = glass + [spoon + glass_radius + 0.008, 0.0]
    refusal = plan(spoon_scene, tight)
    assert isinstance(refusal, Refusal)
    assert "arm and glass" in refusal.detail


def test_every_step_begins_where_the_last_one_ended(vase_scene):
    found = plan(vase_scene, FREE)
    assert isinstance(found, Plan)
    path = np.vstack([HOME, *(step.positions for step in found.steps)])
    assert np.abs(np.diff(path, axis=0)).max() <= 0.025  # 2.2 rad/s for 10 ms.
    np.testing.assert_allclose(path[-1], HOME, atol=5e-3)


def test_the_phases_tell_the_story(vase_scene):
    phases = [step.phase for step in plan(vase_scene, FREE).steps]
    assert (
        phases
        == (
            "reach descend close lift transfer hold lower release retreat home settle"
        ).split()
    )


def test_planning_is_repeatable(spoon_scene):
    first, second = plan(spoon_scene, FREE), plan(spoon_scene, FREE)
    for one, other in zip(first.steps, second.steps, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)


def test_replanning_for_the_nominal_hold_changes_nothing(vase_scene):
    found = plan(vase_scene, FREE)
    again = replan_placing(vase_scene, found, found.grasp.hold)
    for one, other in zip(found.placing, again, strict=True):
        np.testing.assert_allclose(one.positions, other.positions, atol=1e-9)


def test_replanning_an_absurd_hold_is_refused(vase_scene):
    found = plan(vase_scene, FREE)
    far_away = Hold(np.array([0.0, 0.0, 1.0]), 0.0)
    refusal = replan_placing(vase_scene, found, far_away)
    assert isinstance(refusal, Refusal)
    assert refusal.reason == "unreachable"


def test_a_spoon_is_held_where_the_arm_can_reach_it(spoon_scene):
    layout = [[0.2, 0.8], [0.8, 0.45], [0.5, 0.7], [0.1, 0.1], [0.1, 0.5], [0.3, 0.4]]
    spoon_scene.reset(np.array(layout))
    near, far = plan(spoon_scene, (0.09, -0.24)), plan(spoon_scene, (0.24, 0.24))
    assert near.grasp.along > 0.0 > far.grasp.along
