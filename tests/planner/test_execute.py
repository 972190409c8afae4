from dataclasses import replace

import numpy as np
import pytest

from tablesetting.planner.execute import execute, run_to_end
from tablesetting.planner.pick_place import plan

FREE = np.array([0.02, -0.05])


def place(scene, target=FREE):
    return run_to_end(execute(scene, plan(scene, target)))


def run_until(scene, phase):
    """Start a placement and stop at the first snapshot of a phase."""
    running = execute(scene, plan(scene, FREE))
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


@pytest.mark.parametrize("target", [FREE, (-0.07, 0.23), (0.2, 0.15)])
def test_a_spoon_is_laid_flat_and_straight(spoon_scene, target):
    spoon_scene.reset(
        np.array(
            [[0.2, 0.8], [0.8, 0.45], [0.9, 0.1], [0.1, 0.1], [0.1, 0.5], [0.3, 0.4]]
        )
    )
    execution = place(spoon_scene, target)
    assert execution.success, execution.failure
    assert execution.error_mm < 0.6
    assert execution.yaw_error_deg < 0.1
    assert execution.tilt_deg < 0.5
    assert execution.max_bystander_shift_mm < 0.1


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
def test_an_item_that_is_let_go_falls_and_is_reported(vase_scene, phase):
    found = opening_during(plan(vase_scene, FREE), phase, 0.03)
    execution = run_to_end(execute(vase_scene, found))
    assert not execution.success
    assert execution.failure.startswith(f"{phase}: the vase slipped")
    assert vase_scene.position("vase")[2] < 0.1


def test_a_jaw_that_never_closes_lifts_nothing(spoon_scene):
    found = opening_during(plan(spoon_scene, FREE), "close", 0.02)
    found = opening_during(found, "lift", 0.02)
    execution = run_to_end(execute(spoon_scene, found))
    assert execution.failure.startswith("lift: the spoon slipped")


def test_what_slips_in_the_hand_is_made_good(vase_scene):
    running = run_until(vase_scene, "transfer")
    vase = vase_scene.model.body("vase/").jntadr[0]
    address = vase_scene.model.jnt_qposadr[vase]
    vase_scene.data.qpos[address + 2] += 0.004  # The jaw holds it lower now.
    execution = run_to_end(running)
    assert execution.success, execution.failure
    assert execution.error_mm < 0.6


def test_a_moved_bystander_is_a_failure(vase_scene):
    running = run_until(vase_scene, "settle")
    cup = vase_scene.model.body("cup/").jntadr[0]
    vase_scene.data.qpos[vase_scene.model.jnt_qposadr[cup]] += 0.005
    execution = run_to_end(running)
    assert execution.failure == "the cup was moved by 5.0 mm"


def test_an_arm_that_is_held_up_stops(vase_scene):
    running = run_until(vase_scene, "transfer")
    dof = vase_scene.model.joint("jaco/joint_1").dofadr[0]
    vase_scene.data.qfrc_applied[dof] = -1000.0
    execution = run_to_end(running)
    assert execution.failure == "transfer: the arm is held up"


def test_a_diverging_simulation_is_broken_off(vase_scene):
    running = run_until(vase_scene, "transfer")
    vase_scene.data.qvel[0] = np.nan
    execution = run_to_end(running)
    assert execution.failure == "transfer: the simulation diverged"
