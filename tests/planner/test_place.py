import subprocess
import sys

import numpy as np
import pytest

from tablesetting.planner.execute import run_to_end
from tablesetting.planner.goal import Reason, Refusal
from tablesetting.planner.place import place
from tablesetting.planner.watchdog import Fault
from tablesetting.scene.perception import Camera, SensorNoise
from tablesetting.scene.scene import Scene
from tablesetting.scene.servos import REAL
from tablesetting.scene.table import FAST_TIMESTEP

FREE = np.array([0.02, -0.05])
VASE_LAYOUT = np.array([[0.2, 0.3], [0.7, 0.7], [0.2, 0.75], [0.75, 0.25]])


def watch(running, phase, disturb, times=1):
    """Let something happen at the first snapshot of a phase, in the first tries."""
    last = None
    while True:
        try:
            now = next(running).phase
        except StopIteration as stop:
            return stop.value
        if now == phase and last != phase and times > 0:
            disturb()
            times -= 1
        last = now


def slip(scene):
    """Make the pads as slippery as if they were wet, and heavier what they hold."""
    pose = scene.pose_slice(scene.item)
    scene.data.qpos[pose][2] -= 0.03


def test_an_item_that_slipped_is_put_back_and_taken_again(vase_scene):
    outcome = watch(place(vase_scene, FREE), "transfer", lambda: slip(vase_scene))
    assert outcome.success, outcome.failure
    assert outcome.num_tries == 2
    assert outcome.error_mm < 0.6
    assert not outcome.touched


def test_an_item_that_slips_twice_is_a_failure(vase_scene):
    disturb = lambda: slip(vase_scene)  # noqa: E731
    outcome = watch(place(vase_scene, FREE), "transfer", disturb, times=2)
    assert outcome.failure.fault == Fault.LOST_GRIP
    assert outcome.num_tries == 2


def test_a_vase_that_fell_over_is_left_alone(vase_scene):
    def knock():
        pose = vase_scene.pose_slice("vase")
        vase_scene.data.qpos[pose] = [0.46, 0.0, 0.05, 0.0, 1.0, 0.0, 0.0]
        vase_scene.data.qpos[pose][3:] = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]

    outcome = watch(place(vase_scene, FREE), "transfer", knock)
    assert outcome.failure.fault == Fault.LOST_GRIP
    assert "no grasp: the vase is tilted" in outcome.failure.detail


def test_a_refused_placement_moves_nothing(vase_scene):
    before = vase_scene.data.qpos.copy()
    outcome = run_to_end(place(vase_scene, vase_scene.position("cup")[:2]))
    assert isinstance(outcome, Refusal)
    assert outcome.reason == Reason.OCCUPIED
    assert vase_scene.data.time == 0.0
    np.testing.assert_array_equal(vase_scene.data.qpos, before)


def test_noise_of_the_item_is_the_error_of_the_placement(vase_scene):
    noise = SensorNoise(item_std=0.003)
    camera = Camera(vase_scene, noise, rng=np.random.default_rng(1))
    outcome = run_to_end(place(vase_scene, FREE, camera=camera))
    assert outcome.success, outcome.failure
    assert 0.5 < outcome.error_mm < 9.0


@pytest.mark.parametrize("options", [{"timestep": FAST_TIMESTEP}, {"servos": REAL}])
def test_other_steps_and_servos_place_as_well(options):
    scene = Scene(("plate", "bowl", "glass", "cup"), "vase", **options)
    scene.reset(VASE_LAYOUT)
    outcome = run_to_end(place(scene, FREE))
    assert outcome.success, outcome.failure
    assert outcome.error_mm < 1.0
    assert outcome.effort.torque < 0.9
    assert not outcome.touched


def test_two_processes_end_in_the_same_state_bit_for_bit():
    code = """
import numpy as np
from tablesetting.planner.execute import run_to_end
from tablesetting.planner.place import place
from tablesetting.scene.scene import Scene
scene = Scene(("cup",), "vase")
scene.reset(np.array([[0.2, 0.3]]))
run_to_end(place(scene, (0.02, -0.05)))
print(scene.data.qpos.tobytes().hex())
"""
    ends = [
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        for _ in range(2)
    ]
    assert len(ends[0]) > 100
    assert ends[0] == ends[1]
