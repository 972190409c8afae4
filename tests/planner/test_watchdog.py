import mujoco
import numpy as np
import pytest

from tablesetting.planner.watchdog import Fault, Watchdog, held
from tablesetting.scene.props import PROPS
from tablesetting.scene.robot import HOME


def check(watchdog, scene):
    """Look while the joints are where they should be."""
    return watchdog.check(scene.data.qpos[scene.robot.arm_qpos])


def touch(scene, first, second):
    """Let two geoms touch, whatever the physics."""
    positions = [scene.position(name)[:2] for name in scene.objects]
    scene.lay(scene.frame.from_world(np.array(positions)))  # Awake, with contacts.
    scene.data.contact.dist[0] = -0.001
    scene.data.contact.geom[0] = [
        scene.model.geom(name).id if isinstance(name, str) else name
        for name in (first, second)
    ]


def geom_of(scene, name):
    return int(scene.model.body_geomadr[scene.body_ids[name]])


def test_a_table_at_rest_is_well(vase_scene):
    watchdog = Watchdog(vase_scene)
    assert check(watchdog, vase_scene) is None
    assert watchdog.touched == set()
    assert watchdog.effort.overrun == 0.0


def test_a_joint_far_behind_its_command_is_held_up(vase_scene):
    failure = Watchdog(vase_scene).check(np.array(HOME) + [0.0, 0.3, 0, 0, 0, 0])
    assert failure.fault == Fault.HELD_UP


def test_a_small_lag_is_no_matter(vase_scene):
    commanded = np.array(HOME) + [0.0, 0.15, 0.0, 0.0, 0.0, 0.0]
    assert Watchdog(vase_scene).check(commanded) is None


@pytest.mark.parametrize("state", ["qpos", "qvel"])
def test_a_state_that_is_no_number_has_diverged(vase_scene, state):
    watchdog = Watchdog(vase_scene)
    getattr(vase_scene.data, state)[vase_scene.robot.arm_dofs[2]] = np.nan
    vase_scene.step()
    assert watchdog.check(np.array(HOME)).fault == Fault.DIVERGED


def test_a_reset_forgets_a_divergence(vase_scene):
    layout = [vase_scene.position(name)[:2] for name in vase_scene.objects]
    vase_scene.data.qvel[0] = np.nan
    vase_scene.step()
    vase_scene.reset(vase_scene.frame.from_world(np.array(layout)))
    assert check(Watchdog(vase_scene), vase_scene) is None


@pytest.mark.parametrize("joint", range(6))
def test_a_joint_that_is_too_fast_is_beyond_its_limit(vase_scene, joint):
    limit = vase_scene.servos.speed_limits[joint]
    dof = vase_scene.robot.arm_dofs[joint]
    watchdog = Watchdog(vase_scene)
    vase_scene.data.qvel[dof] = -0.99 * limit
    assert check(watchdog, vase_scene) is None
    assert watchdog.effort.speed == pytest.approx(0.99)
    vase_scene.data.qvel[dof] = 1.01 * limit
    failure = check(watchdog, vase_scene)
    assert failure.fault == Fault.LIMIT
    assert failure.detail == f"joint {joint + 1} is beyond its speed"


def test_a_servo_may_be_at_its_most_for_a_moment(vase_scene):
    """As when the jaw closes on something that is not quite where it was seen."""
    servo, watchdog = vase_scene.robot.arm_ctrl[1], Watchdog(vase_scene)
    force, most = vase_scene.data.actuator_force, vase_scene.servos.torque_limits[1]
    force[servo] = -most
    assert not any(check(watchdog, vase_scene) for _ in range(12))
    force[servo] = 0.9 * most
    assert check(watchdog, vase_scene) is None
    force[servo] = most
    assert not any(check(watchdog, vase_scene) for _ in range(12))
    failure = check(watchdog, vase_scene)
    assert failure.fault == Fault.LIMIT
    assert failure.detail == "joint 2 stays at its largest torque"
    assert watchdog.effort.torque == 1.0


@pytest.mark.parametrize(("side", "sign"), [(0, -1), (1, 1)])
def test_a_joint_beyond_its_range_is_beyond_its_limit(vase_scene, side, sign):
    joint = vase_scene.model.joint("jaco/joint_2")
    vase_scene.data.qpos[joint.qposadr[0]] = joint.range[side] + sign * 0.001
    watchdog = Watchdog(vase_scene)
    assert check(watchdog, vase_scene) is None  # Stops are a little soft.
    assert watchdog.effort.overrun == pytest.approx(0.001)
    vase_scene.data.qpos[joint.qposadr[0]] += sign * 0.002
    assert check(watchdog, vase_scene).detail == "joint 2 is beyond its range"


def test_the_arm_may_not_touch_the_table(vase_scene):
    touch(vase_scene, "top", "jaco/jaw/left_pad")
    failure = check(Watchdog(vase_scene), vase_scene)
    assert failure.fault == Fault.TABLE_TOUCHED


def test_what_arm_or_item_touch_is_remembered(vase_scene):
    watchdog = Watchdog(vase_scene)
    touch(vase_scene, geom_of(vase_scene, "cup"), "jaco/jaw/left_pad")
    assert check(watchdog, vase_scene) is None
    touch(vase_scene, geom_of(vase_scene, "vase"), geom_of(vase_scene, "glass"))
    assert check(watchdog, vase_scene) is None
    assert watchdog.touched == {"cup", "glass"}


def test_an_item_that_stands_in_a_bystander_touches_it(vase_scene):
    watchdog = Watchdog(vase_scene)
    vase = vase_scene.data.qpos[vase_scene.pose_slice("vase")]
    beside = PROPS["vase"].radius + PROPS["cup"].radius
    vase[:2] = vase_scene.position("cup")[:2] + [beside + 0.001, 0.0]
    mujoco.mj_forward(vase_scene.model, vase_scene.data)
    check(watchdog, vase_scene)
    assert watchdog.touched == set()
    vase[0] -= 0.004
    mujoco.mj_forward(vase_scene.model, vase_scene.data)
    check(watchdog, vase_scene)
    assert watchdog.touched == {"cup"}


def test_the_most_that_was_seen_is_remembered(vase_scene):
    watchdog, dof = Watchdog(vase_scene), vase_scene.robot.arm_dofs[0]
    for share in (0.2, 0.6, 0.3):
        vase_scene.data.qvel[dof] = share * vase_scene.servos.speed_limits[0]
        assert check(watchdog, vase_scene) is None
    assert watchdog.effort.speed == pytest.approx(0.6)


def test_things_that_are_near_do_not_touch(vase_scene):
    watchdog = Watchdog(vase_scene)
    touch(vase_scene, geom_of(vase_scene, "cup"), "jaco/jaw/left_pad")
    vase_scene.data.contact.dist[0] = 1e-6
    check(watchdog, vase_scene)
    touch(vase_scene, geom_of(vase_scene, "cup"), geom_of(vase_scene, "glass"))
    check(watchdog, vase_scene)
    touch(vase_scene, geom_of(vase_scene, "vase"), "jaco/jaw/left_pad")
    check(watchdog, vase_scene)
    assert watchdog.touched == set()


def test_a_receptacle_may_be_touched_by_what_goes_into_it_alone(spoon_scene):
    watchdog = Watchdog(spoon_scene, receptacle="bowl")
    bowl = geom_of(spoon_scene, "bowl")
    touch(spoon_scene, geom_of(spoon_scene, "spoon"), bowl)
    check(watchdog, spoon_scene)
    assert watchdog.touched == set()
    touch(spoon_scene, "jaco/jaw/left_pad", bowl)
    check(watchdog, spoon_scene)
    assert watchdog.touched == {"bowl"}


def test_nothing_is_held_on_the_table(vase_scene):
    assert not held(vase_scene).any()
    touch(vase_scene, geom_of(vase_scene, "vase"), "jaco/jaw/left_pad")
    assert held(vase_scene).tolist() == [True, False]
