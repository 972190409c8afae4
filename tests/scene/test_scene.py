import mujoco
import numpy as np
import pytest

from tablesetting.errors import InvalidLayout, TableSettingError
from tablesetting.scene.robot import HOME
from tablesetting.scene.scene import STAGING, Scene

LAYOUT = np.array([[0.2, 0.3], [0.7, 0.7], [0.2, 0.75], [0.75, 0.25]])


def turn(scene, name, quaternion):
    start = scene.model.body(f"{name}/").jntadr[0]
    address = scene.model.jnt_qposadr[start]
    scene.data.qpos[address + 3 : address + 7] = quaternion
    mujoco.mj_forward(scene.model, scene.data)


def moved(row, center):
    layout = LAYOUT.copy()
    layout[row] = center
    return layout


@pytest.mark.parametrize(
    ("layout", "complaint"),
    [
        (LAYOUT[:3], r"plate, bowl, glass, cup has shape \(4, 2\); got \(3, 2\)"),
        (moved(1, (0.5, np.nan)), r"bowl is off the table at \[0\.5, nan\]"),
        (moved(2, (1.2, 0.5)), r"glass is off the table at \[1\.2, 0\.5\]; both"),
        (moved(3, (0.2, 0.35)), "plate and cup stand .* inside each other; move"),
    ],
)
def test_a_bad_layout_is_refused_by_name_and_value(vase_scene, layout, complaint):
    with pytest.raises(InvalidLayout, match=complaint):
        vase_scene.reset(layout)


def test_a_prop_may_occur_once():
    with pytest.raises(ValueError, match=r"\['cup', 'vase', 'vase'\]"):
        Scene(("cup", "vase"), "vase")


def test_an_unknown_prop_is_refused():
    with pytest.raises(TableSettingError, match="'teapot'"):
        Scene(("teapot",), "vase")


def test_reset_stands_everything_where_it_belongs(vase_scene):
    for name, center in zip(vase_scene.objects, LAYOUT, strict=True):
        position = vase_scene.frame.from_world(vase_scene.position(name)[:2])
        np.testing.assert_allclose(position, center, atol=1e-5)
        assert abs(vase_scene.position(name)[2]) < 5e-4
        assert vase_scene.tilt(name) < np.radians(0.2)
    np.testing.assert_allclose(vase_scene.position("vase")[:2], STAGING, atol=1e-6)
    arm = vase_scene.data.qpos[vase_scene.robot.arm_qpos]
    np.testing.assert_allclose(arm, HOME, atol=1e-3)
    np.testing.assert_array_equal(
        vase_scene.data.ctrl[vase_scene.robot.arm_ctrl], np.array(HOME)
    )
    assert vase_scene.data.time == 0.0


def test_reset_forgets_what_happened_before(vase_scene):
    before = vase_scene.data.qpos.copy(), vase_scene.data.qvel.copy()
    vase_scene.data.ctrl[:] = 0.3
    vase_scene.data.qfrc_applied[:] = 1.0
    vase_scene.step(50)
    vase_scene.reset(LAYOUT)
    np.testing.assert_array_equal(vase_scene.data.qpos, before[0])
    np.testing.assert_array_equal(vase_scene.data.qvel, before[1])


def test_a_laid_table_stays_as_it_is(spoon_scene):
    before = spoon_scene.snapshot()
    spoon_scene.step(500)
    after = spoon_scene.snapshot()
    assert after.time == pytest.approx(1.0)
    np.testing.assert_allclose(after.positions, before.positions, atol=5e-5)


def test_a_snapshot_does_not_change_afterwards(vase_scene):
    snapshot = vase_scene.snapshot("lift")
    copies = snapshot.positions.copy(), snapshot.quaternions.copy()
    turn(vase_scene, "vase", (0.0, 0.0, 0.0, 1.0))
    assert snapshot.phase == "lift"
    assert snapshot.positions.shape == (vase_scene.model.nbody, 3)
    np.testing.assert_array_equal(snapshot.positions, copies[0])
    np.testing.assert_array_equal(snapshot.quaternions, copies[1])


def test_yaw_and_tilt_are_the_angles_of_the_turn(vase_scene):
    angle = 0.7
    turn(vase_scene, "vase", (np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)))
    assert vase_scene.yaw("vase") == pytest.approx(angle)
    assert vase_scene.tilt("vase") == pytest.approx(0.0, abs=1e-7)
    turn(vase_scene, "vase", (np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0))
    assert vase_scene.tilt("vase") == pytest.approx(angle)


def test_only_contacts_can_move_a_prop(spoon_scene):
    model = spoon_scene.model
    assert model.nmocap == 0
    constrained = set(model.eq_obj1id) | set(model.eq_obj2id)
    fingers = {model.joint(f"jaco/jaw/{name}").id for name in ("left", "right")}
    assert (model.eq_type == mujoco.mjtEq.mjEQ_JOINT).all()
    assert constrained == fingers
    excluded = {int(s) >> 16 for s in model.exclude_signature}
    excluded |= {int(s) & 0xFFFF for s in model.exclude_signature}
    assert excluded.isdisjoint(spoon_scene.body_ids.values())
