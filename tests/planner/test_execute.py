from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tablesetting.planner.execute import execute, is_inside, outer_points, run_to_end
from tablesetting.planner.pick_place import plan
from tablesetting.planner.watchdog import Failure, Fault
from tablesetting.scene.perception import Camera
from tablesetting.scene.props import PROPS

FREE = np.array([0.02, -0.05])


def place(scene, target=FREE):
    return run_to_end(execute(scene, plan(scene, target)))


def run_until(scene, phase, target=FREE):
    """Start a placement and stop at the first snapshot of a phase."""
    running = execute(scene, plan(scene, target))
    while next(running).phase != phase:
        pass
    return running


def opening_during(found, phase, opening):
    """The same plan with another command to the fingers in one phase."""
    steps = (
        replace(s, opening=opening) if s.phase == phase else s for s in found.picking
    )
    return replace(found, picking=tuple(steps))


def test_a_frame_rate_is_positive(vase_scene):
    with pytest.raises(ValueError, match=r"positive, in \[Hz\]; got 0"):
        next(execute(vase_scene, plan(vase_scene, FREE), frame_rate=0.0))


@pytest.mark.parametrize("target", [FREE, (0.24, 0.20), (-0.24, -0.24)])
def test_a_vase_is_placed_upright_to_half_a_millimetre(vase_scene, target):
    vase_scene.reset(np.array([[0.2, 0.3], [0.7, 0.65], [0.2, 0.75], [0.75, 0.25]]))
    execution = place(vase_scene, target)
    assert execution.success, execution.failure
    np.testing.assert_array_equal(execution.commanded, target)
    assert execution.error_mm < 0.6
    assert execution.tilt_deg < 0.1
    assert execution.max_bystander_shift_mm < 0.1
    settled = vase_scene.position("vase")
    np.testing.assert_array_equal(execution.settled, settled[:2])


@pytest.mark.parametrize(
    ("target", "yaw"), [(FREE, 0.0), ((-0.02, 0.1), 2.0), ((0.2, 0.15), -0.7)]
)
def test_a_spoon_is_laid_flat_with_any_heading(spoon_scene, target, yaw):
    spoon_scene.reset(
        np.array(
            [[0.2, 0.8], [0.85, 0.4], [0.9, 0.1], [0.1, 0.1], [0.1, 0.5], [0.3, 0.4]]
        )
    )
    execution = run_to_end(execute(spoon_scene, plan(spoon_scene, target, yaw)))
    assert execution.success, execution.failure
    assert spoon_scene.yaw("spoon") == pytest.approx(yaw, abs=2e-3)
    assert execution.error_mm < 0.6
    assert execution.yaw_error_deg < 0.1
    assert execution.tilt_deg < 0.5
    assert execution.max_bystander_shift_mm < 0.1


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.012, 0.0), (-0.006, 0.014)])
def test_a_spoon_comes_to_rest_in_the_bowl(spoon_scene, offset):
    target = spoon_scene.position("bowl")[:2] + offset
    execution = place(spoon_scene, target)
    assert execution.success, execution.failure
    assert execution.receptacle == "bowl"
    assert is_inside(spoon_scene, "bowl")
    center = spoon_scene.center_of_mass("spoon")[:2]
    np.testing.assert_array_equal(execution.settled, center)
    assert np.linalg.norm(center - target) < 0.006
    assert not execution.touched
    assert execution.max_bystander_shift_mm < 0.1


def test_a_placement_stays_within_the_limits_and_touches_nothing(vase_scene):
    execution = place(vase_scene)
    assert not execution.touched
    assert 0.5 < execution.effort.speed <= 1.0
    assert 0.01 < execution.effort.torque < 0.5
    assert execution.effort.overrun == 0.0


def test_the_arm_returns_home(vase_scene):
    home = vase_scene.data.qpos[vase_scene.robot.arm_qpos].copy()
    place(vase_scene)
    away = vase_scene.data.qpos[vase_scene.robot.arm_qpos] - home
    assert np.abs(away).max() < 5e-3


def test_snapshots_come_evenly_and_tell_the_phase(vase_scene):
    found = plan(vase_scene, FREE)
    snapshots = list(execute(vase_scene, found, frame_rate=25.0))
    times = np.array([snapshot.time for snapshot in snapshots])
    np.testing.assert_allclose(np.diff(times), 0.04, atol=1e-9)
    phases = list(dict.fromkeys(snapshot.phase for snapshot in snapshots))
    assert phases == [step.phase for step in found.steps]


def test_the_same_placement_twice_ends_bit_identically(spoon_scene):
    layout = spoon_scene.frame.from_world(
        np.array([spoon_scene.position(name)[:2] for name in spoon_scene.objects])
    )
    ends = []
    for _ in range(2):
        spoon_scene.reset(layout)
        place(spoon_scene)
        ends.append(spoon_scene.data.qpos.copy())
    np.testing.assert_array_equal(ends[0], ends[1])


def test_the_item_is_lifted_off_the_table_between_the_pads_alone(vase_scene):
    run_until(vase_scene, "hold")
    item = vase_scene.body_ids["vase"]
    assert vase_scene.position("vase")[2] > 0.1
    touching = set()
    for geoms in vase_scene.data.contact.geom:
        bodies = vase_scene.model.geom_bodyid[geoms]
        if item in bodies:
            (other,) = geoms[bodies != item]
            touching.add(vase_scene.model.geom(other).name)
    assert touching == {"jaco/jaw/left_pad", "jaco/jaw/right_pad"}


@pytest.mark.parametrize("phase", ["lift", "transfer"])
def test_an_item_that_is_let_go_is_reported(vase_scene, phase):
    found = opening_during(plan(vase_scene, FREE), phase, 0.03)
    execution = run_to_end(execute(vase_scene, found))
    assert not execution.success
    assert execution.failure.fault == Fault.LOST_GRIP
    assert execution.failure.detail.startswith(f"{phase}: the vase slipped")


def test_a_jaw_that_never_closes_lifts_nothing(spoon_scene):
    found = opening_during(plan(spoon_scene, FREE), "close", 0.02)
    found = opening_during(found, "lift", 0.02)
    execution = run_to_end(execute(spoon_scene, found))
    assert execution.failure.detail.startswith("lift: the spoon slipped")


def test_what_slips_in_the_hand_is_made_good(vase_scene):
    running = run_until(vase_scene, "transfer")
    vase = vase_scene.model.body("vase/").jntadr[0]
    address = vase_scene.model.jnt_qposadr[vase]
    vase_scene.data.qpos[address + 2] += 0.004  # The jaw holds it lower now.
    execution = run_to_end(running)
    assert execution.success, execution.failure
    assert execution.error_mm < 0.6


def test_what_slips_too_far_is_lost_though_it_is_held(vase_scene):
    running = run_until(vase_scene, "transfer")
    vase_scene.data.qpos[vase_scene.pose_slice("vase")][2] += 0.015
    execution = run_to_end(running)
    assert execution.failure.fault == Fault.LOST_GRIP
    assert "the vase slipped 15 mm in the jaw" in execution.failure.detail


def test_a_moved_bystander_is_a_failure(vase_scene):
    running = run_until(vase_scene, "settle")
    cup = vase_scene.model.body("cup/").jntadr[0]
    vase_scene.data.qpos[vase_scene.model.jnt_qposadr[cup]] += 0.005
    execution = run_to_end(running)
    assert execution.failure == Failure(Fault.DISTURBED, "the cup was moved by 5.0 mm")


@pytest.mark.parametrize(
    ("name", "turn", "moved"),
    [
        ("fork", [np.cos(0.25), 0.0, 0.0, np.sin(0.25)], 0.5),
        ("cup", [1, 0, 0.02, 0], 0.04),
    ],
)
def test_to_turn_or_tip_a_bystander_is_to_move_it(spoon_scene, name, turn, moved):
    before = outer_points(spoon_scene)
    spoon_scene.data.qpos[spoon_scene.pose_slice(name)][3:] = turn
    mujoco.mj_kinematics(spoon_scene.model, spoon_scene.data)
    after = outer_points(spoon_scene)
    shifts = {
        name: np.linalg.norm(after[name] - before[name], axis=1).max() for name in after
    }
    lever = PROPS[name].half_length or PROPS[name].height
    assert shifts.pop(name) == pytest.approx(moved * lever, rel=0.05)
    assert max(shifts.values()) == 0.0


def test_an_arm_that_is_blocked_stops(vase_scene):
    running = run_until(vase_scene, "transfer")
    dof = vase_scene.model.joint("jaco/joint_1").dofadr[0]
    try:
        vase_scene.model.dof_damping[dof] += 1e4
        execution = run_to_end(running)
    finally:
        vase_scene.model.dof_damping[dof] -= 1e4
    detail = "transfer: joint 1 stays at its largest torque"
    assert execution.failure == Failure(Fault.LIMIT, detail)


def test_a_diverging_simulation_is_broken_off(vase_scene):
    running = run_until(vase_scene, "transfer")
    vase_scene.data.qvel[0] = np.nan
    execution = run_to_end(running)
    assert execution.failure.fault == Fault.DIVERGED


def test_an_item_that_ends_elsewhere_is_misplaced(vase_scene):
    running = run_until(vase_scene, "settle")
    vase_scene.data.qpos[vase_scene.pose_slice("vase")][0] += 0.012
    execution = run_to_end(running)
    assert execution.failure.fault == Fault.MISPLACED
    assert "stands 12." in execution.failure.detail


def test_an_item_that_ends_on_its_side_is_misplaced(vase_scene):
    running = run_until(vase_scene, "settle")
    vase = vase_scene.data.qpos[vase_scene.pose_slice("vase")]
    vase[2:] = [0.05, np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    execution = run_to_end(running)
    assert execution.failure.fault == Fault.MISPLACED
    assert "the vase is tilted by 90" in execution.failure.detail
    assert execution.tilt_deg == pytest.approx(90.0, abs=5.0)


def test_a_spoon_that_ends_turned_is_misplaced(spoon_scene):
    running = run_until(spoon_scene, "settle")
    spoon = spoon_scene.data.qpos[spoon_scene.pose_slice("spoon")]
    spoon[3:] = [np.cos(np.radians(5.0)), 0.0, 0.0, np.sin(np.radians(5.0))]
    execution = run_to_end(running)
    assert execution.failure.fault == Fault.MISPLACED
    assert "the spoon is turned by 10." in execution.failure.detail
    assert execution.yaw_error_deg == pytest.approx(10.0, abs=0.1)


def test_a_vase_that_ends_turned_is_well(vase_scene):
    running = run_until(vase_scene, "settle")
    vase = vase_scene.data.qpos[vase_scene.pose_slice("vase")]
    vase[3:] = [np.cos(1.0), 0.0, 0.0, np.sin(1.0)]
    execution = run_to_end(running)
    assert execution.success, execution.failure
    assert execution.yaw_error_deg == 0.0


def test_a_spoon_that_ends_beside_the_bowl_is_not_in_it(spoon_scene):
    running = run_until(spoon_scene, "settle", spoon_scene.position("bowl")[:2])
    spoon = spoon_scene.data.qpos[spoon_scene.pose_slice("spoon")]
    spoon[:] = [*FREE, 0.002, 1.0, 0.0, 0.0, 0.0]
    execution = run_to_end(running)
    assert not is_inside(spoon_scene, "bowl")
    assert execution.failure.fault == Fault.MISPLACED
    assert "the spoon is not in the bowl" in execution.failure.detail


def test_a_spoon_above_the_rim_is_not_in_the_bowl(spoon_scene):
    spoon = spoon_scene.data.qpos[spoon_scene.pose_slice("spoon")]
    spoon[:3] = spoon_scene.position("bowl") + [0.0, 0.0, PROPS["bowl"].height]
    mujoco.mj_kinematics(spoon_scene.model, spoon_scene.data)
    assert not is_inside(spoon_scene, "bowl")
    spoon[2] -= 0.03
    mujoco.mj_kinematics(spoon_scene.model, spoon_scene.data)
    assert is_inside(spoon_scene, "bowl")


def test_a_hold_that_cannot_be_made_good_is_reported(vase_scene):
    found = plan(vase_scene, FREE)

    class Blind(Camera):
        def look(self):
            seen = super().look()
            seen.poses["vase"][2] += 1.0
            return seen

    execution = run_to_end(execute(vase_scene, found, camera=Blind(vase_scene)))
    assert execution.failure.fault == Fault.NO_CORRECTION
