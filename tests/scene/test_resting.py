import mujoco
import numpy as np
import pytest

from tablesetting.reward.tasks import SPOON, VASE
from tablesetting.scene.props import PROPS
from tablesetting.scene.resting import RestingItem
from tablesetting.scene.table import TableFrame


def put(scene, position, quaternion=(1.0, 0.0, 0.0, 0.0)):
    """Pose the item, and everything else as it is."""
    scene.data.qpos[scene.pose_slice(scene.item)] = [*position, *quaternion]
    mujoco.mj_forward(scene.model, scene.data)


def tilted(degrees):
    half = np.radians(degrees) / 2.0
    return np.cos(half), np.sin(half), 0.0, 0.0


@pytest.fixture
def vase(vase_scene):
    put(vase_scene, (0.0, 0.05, 0.0))
    return RestingItem(vase_scene.model, VASE, vase_scene.frame)


@pytest.fixture
def spoon(spoon_scene):
    return RestingItem(spoon_scene.model, SPOON, spoon_scene.frame)


def dofs_of_item(scene):
    first = scene.model.body_dofadr[scene.body_ids[scene.item]]
    return slice(first, first + 6)


def test_an_item_on_the_table_is_where_its_footprint_is(vase, vase_scene):
    np.testing.assert_allclose(vase.placement(vase_scene.data), [0.5, 0.6])


@pytest.mark.parametrize(
    ("axis", "speed", "rests"),
    [(0, 0.009, True), (0, 0.011, False), (5, 0.09, True), (5, 0.11, False)],
)
def test_an_item_that_moves_does_not_rest(vase, vase_scene, axis, speed, rests):
    vase_scene.data.qvel[:] = 0.0
    vase_scene.data.qvel[dofs_of_item(vase_scene)][axis] = speed
    assert (vase.placement(vase_scene.data) is not None) == rests


@pytest.mark.parametrize(
    ("height", "degrees", "rests"),
    [
        (0.004, 0.0, True),
        (0.006, 0.0, False),
        (0.0, 4.9, True),
        (0.0, 5.1, False),
        (0.0, 180.0, False),
    ],
)
def test_an_item_rests_where_it_stands(vase, vase_scene, height, degrees, rests):
    put(vase_scene, (0.0, 0.05, height), tilted(degrees))
    assert (vase.placement(vase_scene.data) is not None) == rests


@pytest.mark.parametrize(("x", "rests"), [(0.249, True), (0.251, False)])
def test_an_item_rests_on_the_square_alone(vase, vase_scene, x, rests):
    put(vase_scene, (x, 0.05, 0.0))
    assert (vase.placement(vase_scene.data) is not None) == rests


def test_an_item_that_the_robot_touches_is_not_put_down(vase, vase_scene):
    data, model = vase_scene.data, vase_scene.model
    foot = model.body("jaco/").pos[:2]
    wide = TableFrame(size=(4.0, 4.0))  # With the foot of the arm on the square.
    resting = RestingItem(model, VASE, wide)
    put(vase_scene, (*(foot + [0.3, 0.0]), 0.0))
    assert resting.placement(data) is not None
    put(vase_scene, (*(foot + [0.05, 0.0]), 0.0))
    assert resting.placement(data) is None


def test_in_a_receptacle_the_center_of_mass_counts(spoon, spoon_scene):
    bowl = spoon_scene.position("bowl")
    put(spoon_scene, bowl + [0.0, 0.0, 0.03], tilted(30.0))
    center = spoon_scene.center_of_mass("spoon")
    placement = spoon.placement(spoon_scene.data)
    np.testing.assert_allclose(placement, spoon_scene.frame.from_world(center[:2]))


def test_beside_or_above_a_receptacle_is_not_in_it(spoon, spoon_scene):
    bowl, spec = spoon_scene.position("bowl"), PROPS["bowl"]
    for offset in ([0.0, 0.0, spec.height + 0.05], [spec.radius + 0.05, 0.0, 0.05]):
        put(spoon_scene, bowl + offset)
        assert spoon.placement(spoon_scene.data) is None


def test_the_vase_is_not_put_into_the_bowl(vase, vase_scene):
    put(vase_scene, vase_scene.position("bowl") + [0.0, 0.0, 0.01])
    assert vase.placement(vase_scene.data) is None
