import numpy as np
import pytest

from tablesetting.scene.scene import Scene
from tablesetting.scene.variation import Variation

NAMES = ("cup", "plate", "vase")


@pytest.fixture(scope="module")
def scene():
    return Scene(NAMES[:2], NAMES[2])


def masses(scene):
    return scene.model.body_mass[[scene.body_ids[name] for name in NAMES]].copy()


def draws(scene, variation, num=300):
    rng, found = np.random.default_rng(0), []
    for _ in range(num):
        scene.dynamics.draw(variation, rng=rng)
        found.append(masses(scene))
    scene.dynamics.restore()
    return np.array(found)


def test_masses_are_spread_evenly_over_the_range_each_by_itself(scene):
    nominal = masses(scene)
    factors = draws(scene, Variation(mass=0.5)) / nominal
    assert factors.min() == pytest.approx(1 / 1.5, rel=0.02)
    assert factors.max() == pytest.approx(1.5, rel=0.02)
    np.testing.assert_allclose(np.log(factors).mean(axis=0), 0.0, atol=0.05)
    correlations = np.corrcoef(factors.T)[np.triu_indices(3, 1)]
    assert np.abs(correlations).max() < 0.2


def test_friction_is_varied_apart_from_mass(scene):
    nominal, friction = masses(scene), scene.model.geom_friction.copy()
    scene.dynamics.draw(Variation(friction=0.5), rng=np.random.default_rng(1))
    np.testing.assert_array_equal(masses(scene), nominal)
    table = scene.model.geom("top").id
    assert scene.model.geom_friction[table, 0] == 0.0  # The greater of two counts.
    friction[table] = scene.model.geom_friction[table] = 1.0
    factors = scene.model.geom_friction / friction
    assert ((factors[:, 0] >= 1 / 1.5) & (factors[:, 0] <= 1.5)).all()
    np.testing.assert_array_equal(factors[:, 1:], 1.0)
    pads = [scene.model.geom(f"jaco/jaw/{side}_pad").id for side in ("left", "right")]
    assert factors[pads[0], 0] == factors[pads[1], 0] != 1.0
    scene.dynamics.restore()


@pytest.mark.parametrize("seed", range(4))
def test_a_slick_prop_slides_further(scene, seed):
    """As far as its own friction lets it, against the table's in the model."""

    def slide():
        scene.reset(np.array([[0.2, 0.2], [0.6, 0.6]]))
        plate = scene.pose_slice("plate")
        start = scene.position("plate")[0]
        joint = scene.model.body_jntadr[scene.body_ids["plate"]]
        scene.data.qvel[scene.model.jnt_dofadr[joint]] = 0.5
        scene.step(200)
        return scene.data.qpos[plate][0] - start

    nominal = slide()
    geoms = np.flatnonzero(scene.model.geom_bodyid == scene.body_ids["plate"])
    before = scene.model.geom_friction[[*geoms, scene.model.geom("top").id], 0].max()
    scene.dynamics.draw(Variation(friction=0.9), rng=np.random.default_rng(seed))
    factor = scene.model.geom_friction[geoms, 0].max() / before
    varied = slide()
    scene.dynamics.restore()
    assert varied * factor == pytest.approx(nominal, rel=0.2)


def test_restoring_leaves_no_trace(scene):
    model = scene.model
    before = [model.body_mass.copy(), model.geom_friction.copy()]
    before += [model.body_inertia.copy(), model.dof_invweight0.copy()]
    variation = Variation(mass=0.5, friction=0.5)
    scene.dynamics.draw(variation, rng=np.random.default_rng(2))
    assert (model.body_inertia != before[2]).any()
    scene.dynamics.restore()
    after = [model.body_mass, model.geom_friction]
    after += [model.body_inertia, model.dof_invweight0]
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("name", "value"), [("mass", -0.1), ("friction", 11.0)])
def test_a_spread_is_within_its_range(name, value):
    with pytest.raises(ValueError, match=rf"`{name}` must be in \[0, 10\]; got"):
        Variation(**{name: value})
