import mujoco
import numpy as np
import pytest

from tablesetting.scene.jaw import MAX_OPENING
from tablesetting.scene.robot import HOME, RobotIndex, robot_model


@pytest.fixture
def robot():
    model = robot_model()
    data = mujoco.MjData(model)
    index = RobotIndex.of(model)
    index.set_posture(data, HOME, MAX_OPENING / 2)
    data.ctrl[index.arm_ctrl] = HOME
    data.ctrl[index.jaw_ctrl] = MAX_OPENING / 2
    mujoco.mj_forward(model, data)
    return model, data, index


def test_at_home_the_tool_points_down_and_nothing_touches(robot):
    _, data, index = robot
    np.testing.assert_allclose(data.site_xmat[index.tcp][6:], [0, 0, -1], atol=2e-3)
    assert data.site_xpos[index.tcp][1] > -0.41  # In front of its own foot.
    assert data.ncon == 0


def test_servos_hold_the_tool_against_gravity(robot):
    model, data, index = robot
    before = data.site_xpos[index.tcp].copy()
    mujoco.mj_step(model, data, 1000)
    assert np.linalg.norm(data.site_xpos[index.tcp] - before) < 2e-4


@pytest.mark.parametrize("opening", [0.0, 0.02, MAX_OPENING])
def test_both_fingers_follow_the_commanded_opening(robot, opening):
    model, data, index = robot
    data.ctrl[index.jaw_ctrl] = opening
    mujoco.mj_step(model, data, 500)
    np.testing.assert_allclose(data.qpos[index.jaw_qpos], opening, atol=5e-4)


def test_tool_centre_lies_between_the_pads(robot):
    model, data, index = robot
    pads = [data.geom(f"jaco/jaw/{side}_pad").xpos for side in ("left", "right")]
    np.testing.assert_allclose(np.mean(pads, axis=0), data.site_xpos[index.tcp])
    gap = (
        np.linalg.norm(pads[0] - pads[1]) - 2 * model.geom("jaco/jaw/left_pad").size[1]
    )
    assert gap == pytest.approx(MAX_OPENING)


def test_only_neighbouring_links_ignore_each_other(robot):
    model, _, _ = robot
    pairs = {
        tuple(sorted(model.body(int(s) >> k & 0xFFFF).name for k in (0, 16)))
        for s in model.exclude_signature
    }
    assert pairs == {
        ("jaco/b_1", "jaco/b_base"),
        ("jaco/jaw/left", "jaco/jaw/right"),
    }


def test_robot_alone_and_in_the_scene_are_the_same(robot, vase_scene):
    _, data, index = robot
    scene_data = mujoco.MjData(vase_scene.model)
    vase_scene.robot.set_posture(scene_data, HOME, MAX_OPENING / 2)
    mujoco.mj_kinematics(vase_scene.model, scene_data)
    np.testing.assert_allclose(
        scene_data.site_xpos[vase_scene.robot.tcp], data.site_xpos[index.tcp]
    )
