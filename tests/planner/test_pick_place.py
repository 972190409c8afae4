from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tablesetting.planner.goal import Reason, Refusal
from tablesetting.planner.grasp import Hold
from tablesetting.planner.path import tool_pose_at
from tablesetting.planner.pick_place import Plan, plan, replan_placing
from tablesetting.scene.jaw import TIP_REACH
from tablesetting.scene.perception import Camera
from tablesetting.scene.props import PROPS
from tablesetting.scene.robot import HOME
from tablesetting.scene.scene import Scene

FREE = (0.02, -0.05)


@pytest.mark.parametrize("target", [(0.0, np.nan), (0.0, 0.0, 0.0), (0.1,)])
def test_a_target_is_two_finite_numbers(vase_scene, target):
    with pytest.raises(ValueError, match="two finite numbers"):
        plan(vase_scene, target)


def test_a_heading_is_finite(spoon_scene):
    with pytest.raises(ValueError, match="`yaw` must be finite"):
        plan(spoon_scene, FREE, np.inf)


def test_an_item_that_nobody_can_hold_is_refused():
    scene = Scene((), "cup")
    scene.reset(np.empty((0, 2)))
    refusal = plan(scene, FREE)
    assert refusal.reason == Reason.NO_GRASP
    assert "only: vase, spoon" in refusal.detail


@pytest.mark.parametrize(
    ("target", "reason", "detail"),
    [
        ((2.0, 0.0), Reason.OUTSIDE, "not lie on the table"),
        ((0.6, 0.3), Reason.UNREACHABLE, "does not reach"),
        ((0.1, 0.1), Reason.OCCUPIED, "in the bowl"),
        ((-0.13, 0.14), Reason.OCCUPIED, "in the glass"),
        ((0.29, 0.27), Reason.TOO_TALL, "transfer: the arm does not reach"),
        ((-0.18, 0.02), Reason.BLOCKED, "lower: vase and plate would pass"),
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


def test_a_vase_can_stand_at_all_ends_of_the_square(vase_scene):
    vase_scene.reset(np.array([[0.3, 0.3], [0.7, 0.7], [0.3, 0.7], [0.7, 0.3]]))
    for corner in product((-0.25, 0.0, 0.25), repeat=2):
        assert isinstance(plan(vase_scene, corner), Plan), corner


@pytest.mark.parametrize("yaw", np.linspace(-np.pi, np.pi, 9))
def test_a_spoon_can_be_laid_with_any_heading(spoon_scene, yaw):
    found = plan(spoon_scene, FREE, yaw)
    assert isinstance(found, Plan)
    # Not a turn further on: the wrist has no stops.
    np.testing.assert_allclose(found.steps[-1].positions[-1], HOME, atol=1e-3)
    assert found.goal.yaw == yaw


def test_a_spoon_needs_room_for_the_fingers(spoon_scene):
    glass = spoon_scene.position("glass")[:2]
    spoon, glass_radius = 0.016, 0.034
    tight = glass - [spoon + glass_radius + 0.002, 0.0]
    refusal = plan(spoon_scene, tight)
    assert isinstance(refusal, Refusal)
    assert refusal.reason == Reason.TOO_TALL
    assert "arm and glass" in refusal.detail


def test_a_fallen_vase_is_not_picked_up(vase_scene):
    pose = vase_scene.data.qpos[vase_scene.pose_slice("vase")]
    pose[3:] = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    refusal = plan(vase_scene, FREE)
    assert refusal.reason == Reason.NO_GRASP
    assert "tilted by 90 degrees" in refusal.detail


def test_a_vase_that_leans_on_a_glass_is_not_picked_up(vase_scene):
    seen = Camera(vase_scene).look()
    touching = PROPS["vase"].radius + PROPS["glass"].radius
    seen.poses["glass"][:2] = seen.poses["vase"][:2] - [touching - 0.01, 0.0]
    refusal = plan(vase_scene, FREE, seen=seen)
    assert refusal.reason == Reason.NO_GRASP
    assert "vase and glass would meet" in refusal.detail


def test_a_spoon_without_room_for_a_finger_is_not_picked_up(spoon_scene):
    seen = Camera(spoon_scene).look()
    spoon = seen.poses["spoon"][:2]
    seen.poses["glass"][:2] = spoon + [0.052, -0.02]
    seen.poses["cup"][:2] = spoon + [-0.062, -0.02]
    refusal = plan(spoon_scene, FREE, seen=seen)
    assert refusal.reason == Reason.NO_GRASP
    assert refusal.detail.startswith("descend: arm and ")


def test_what_is_seen_counts_not_what_is(vase_scene):
    seen = Camera(vase_scene).look()
    seen.poses["cup"][:2] = FREE
    refusal = plan(vase_scene, FREE, seen=seen)
    assert refusal.reason == Reason.OCCUPIED
    assert "in the cup" in refusal.detail


def test_weak_joints_are_too_heavily_loaded(vase_scene, monkeypatch):
    weak = replace(vase_scene.servos, max_torques=(0.5, 0.5))
    weak = replace(weak, is_gravity_compensated=False)
    monkeypatch.setattr(vase_scene, "servos", weak)
    assert plan(vase_scene, FREE).reason == Reason.TOO_HEAVY


def test_every_step_begins_where_the_last_one_ended(vase_scene):
    found = plan(vase_scene, FREE)
    assert isinstance(found, Plan)
    path = np.vstack([HOME, *(step.positions for step in found.steps)])
    assert np.abs(np.diff(path, axis=0)).max() <= 0.0193  # 2.4 rad/s for 8 ms.
    np.testing.assert_allclose(path[-1], HOME, atol=5e-3)


def test_the_phases_tell_the_story(vase_scene):
    phases = [step.phase for step in plan(vase_scene, FREE).steps]
    assert (
        phases
        == (
            "reach descend close lift transfer hold lower release retreat home settle"
        ).split()
    )


def test_the_item_weighs_on_the_joints_while_it_is_held(vase_scene):
    found = plan(vase_scene, FREE)
    steps = {step.phase: step for step in found.steps}
    weight = PROPS["vase"].mass * 9.81
    shoulder = np.abs(steps["hold"].torques[:, 1])
    assert (0.2 * weight < shoulder).all()  # By a lever of some decimetres.
    assert (shoulder < 0.8 * weight).all()
    assert np.abs(steps["settle"].torques).max() < 1e-3


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


def test_replanning_for_weak_joints_is_refused(vase_scene, monkeypatch):
    found = plan(vase_scene, FREE)
    weak = replace(vase_scene.servos, max_torques=(0.5, 0.5))
    monkeypatch.setattr(vase_scene, "servos", weak)
    refusal = replan_placing(vase_scene, found, found.grasp.hold)
    assert refusal.reason == Reason.TOO_HEAVY


def test_replanning_minds_the_neighbours(vase_scene):
    found = plan(vase_scene, FREE)
    found.seen.poses["glass"][:2] = FREE
    refusal = replan_placing(vase_scene, found, found.grasp.hold)
    assert refusal.reason == Reason.BLOCKED
    assert refusal.detail.startswith("lower: vase and glass would")


def test_an_item_that_is_held_askew_ends_where_it_should(spoon_scene):
    found = plan(spoon_scene, FREE, 0.3)
    hold = found.grasp.hold
    askew = Hold(hold.offset + [0.002, 0.0, -0.001], hold.yaw + 0.1)
    placing = replan_placing(spoon_scene, found, askew)
    lower = next(step for step in placing if step.phase == "lower")
    tool = tool_pose_at(lower.positions[-1])
    origin = tool.position + tool.rotation @ askew.offset
    np.testing.assert_allclose(origin, found.goal.release, atol=2e-4)
    assert np.cos(tool.yaw + askew.yaw - 0.3) == pytest.approx(1.0, abs=1e-6)


def test_the_hand_passes_over_everything(vase_scene):
    found = plan(vase_scene, FREE)
    tallest = PROPS["vase"].height
    for step in found.steps:
        if step.phase in ("reach", "transfer", "home"):
            path = [tool_pose_at(position) for position in step.positions]
            lowest = min(pose.position[2] for pose in path) - TIP_REACH
            over = 0.03 if step.phase == "transfer" else tallest
            assert lowest >= over, step.phase


def test_the_spoon_goes_into_the_bowl_from_a_side_that_is_free(spoon_scene):
    bowl = spoon_scene.position("bowl")[:2]
    found = plan(spoon_scene, bowl)
    assert found.goal.receptacle == "bowl"
    np.testing.assert_array_equal(found.goal.target, bowl)
