import numpy as np
import pytest

from tablesetting.experiments.arm import Arm
from tablesetting.experiments.config import ArmConfig
from tablesetting.reward.tasks import SPOON, VASE

LAYOUT = np.array([[0.2, 0.3], [0.7, 0.7], [0.2, 0.75], [0.75, 0.25]])
SPOON_LAYOUT = np.array(
    [[0.2, 0.8], [0.75, 0.7], [0.7, 0.1], [0.1, 0.1], [0.1, 0.5], [0.25, 0.4]]
)


@pytest.fixture(scope="module")
def arm():
    return Arm(VASE.objects, VASE.item)


def attempt(arm, layout, placement):
    rng = np.random.default_rng(0)
    return arm.place(layout, np.array(placement), lambda episode: episode, rng=rng)


def test_a_taken_place_is_refused_with_its_reason(arm):
    found = attempt(arm, LAYOUT, LAYOUT[0])
    assert found.is_refused
    assert (found.settled, found.error_mm, found.tilt_deg) == (None, None, None)
    assert found.failure.startswith("refused, occupied: the vase would stand")


def test_an_attempt_is_in_table_units(arm):
    found = attempt(arm, LAYOUT, (0.5, 0.4))
    assert (found.failure, found.receptacle) == (None, None)
    np.testing.assert_allclose(found.settled, (0.5, 0.4), atol=1e-3)
    distance = 500.0 * np.linalg.norm(found.settled - found.commanded)
    assert found.error_mm == pytest.approx(distance, abs=1e-9)


def test_a_spoon_in_the_bowl_has_a_receptacle_and_no_tilt():
    arm = Arm(SPOON.objects, SPOON.item, ArmConfig(fast=True))
    found = attempt(arm, SPOON_LAYOUT, SPOON_LAYOUT[0])
    assert (found.failure, found.receptacle) == (None, "bowl")
    assert found.tilt_deg is None
    assert np.linalg.norm(found.settled - SPOON_LAYOUT[0]) < 0.01


def test_options_choose_servos_and_timestep(arm):
    other = Arm(("cup",), "vase", ArmConfig(servos="real", fast=True))
    assert (arm.scene.servos.name, other.scene.servos.name) == ("stiff", "real")
    assert 2.0 * arm.scene.model.opt.timestep == other.scene.model.opt.timestep


def test_noise_is_of_every_look_and_in_the_units_of_its_options():
    config = ArmConfig(item_noise_mm=3.0, item_noise_deg=6.0, layout_noise_mm=1.0)
    arm = Arm(("cup",), "vase", config)
    arm.lay(LAYOUT[:1], rng=np.random.default_rng(0))
    camera = arm.camera(rng=np.random.default_rng(0))
    looks = [camera.look() for _ in range(1000)]
    for name, std in (("vase", 0.003), ("cup", 0.001)):
        found = np.std([each.position(name)[:2] for each in looks], axis=0)
        np.testing.assert_allclose(found, std, rtol=0.1)
    turns = [each.yaw("vase") for each in looks]
    assert np.degrees(np.std(turns)) == pytest.approx(6.0, rel=0.1)


def test_props_are_varied_for_one_layout_alone():
    arm = Arm(("cup",), "vase", ArmConfig(mass_spread=0.5, friction_spread=0.5))

    def masses(seed):
        arm.lay(LAYOUT[:1], rng=np.random.default_rng(seed))
        return arm.scene.model.body_mass.copy()

    first, other, again = masses(0), masses(1), masses(0)
    assert (first != other).any()
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
@pytest.mark.parametrize(
    ("option", "most"),
    [
        ("item-noise-mm", 100),
        ("item-noise-deg", 90),
        ("layout-noise-mm", 100),
        ("mass-spread", 10),
        ("friction-spread", 10),
    ],
)
def test_an_arm_of_senseless_options_is_refused(option, most, value):
    message = rf"--{option} must be in \[0, {most}\]; got {value}"
    name = option.replace("-", "_")
    with pytest.raises(ValueError, match=message):
        ArmConfig(**{name: value})
    with pytest.raises(ValueError, match=rf"--{option} must be"):
        ArmConfig(**{name: 1.01 * most})
    assert getattr(ArmConfig(**{name: float(most)}), name) == most
