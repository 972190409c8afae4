import numpy as np
import pytest

from tablesetting.scene.perception import Camera, Percept, SensorNoise

NOISE = SensorNoise(item_std=0.002, item_yaw_std=0.05, layout_std=0.004)


def looks(scene, noise, num=2000):
    camera = Camera(scene, noise, rng=np.random.default_rng(0))
    return [camera.look() for _ in range(num)]


def test_without_noise_everything_is_seen_where_it_is(spoon_scene):
    seen = Camera(spoon_scene).look()
    for name in (*spoon_scene.objects, spoon_scene.item):
        np.testing.assert_allclose(
            seen.position(name), spoon_scene.position(name), atol=1e-12
        )
        assert seen.yaw(name) == pytest.approx(spoon_scene.yaw(name), abs=1e-12)
        assert seen.tilt(name) == pytest.approx(spoon_scene.tilt(name), abs=1e-7)


def test_what_was_seen_does_not_change_with_the_scene(vase_scene):
    seen = Camera(vase_scene).look()
    before = seen.position("cup").copy()
    vase_scene.data.qpos[vase_scene.pose_slice("cup")][0] += 0.1
    np.testing.assert_array_equal(seen.position("cup"), before)


def test_errors_have_the_standard_deviation_that_is_said(spoon_scene):
    found = looks(spoon_scene, NOISE)
    for name, std in (("spoon", 0.002), ("bowl", 0.004), ("knife", 0.004)):
        errors = [each.position(name) - spoon_scene.position(name) for each in found]
        np.testing.assert_allclose(np.std(errors, axis=0)[:2], std, rtol=0.08)
        np.testing.assert_allclose(np.mean(errors, axis=0)[:2], 0.0, atol=std / 10)
        assert np.abs(np.array(errors)[:, 2]).max() < 1e-12
    assert np.std([each.yaw("spoon") for each in found]) == pytest.approx(
        0.05, rel=0.08
    )
    assert np.ptp([each.yaw("bowl") for each in found]) == 0.0


def test_a_heading_seen_wrongly_is_still_a_heading(spoon_scene):
    for seen in looks(spoon_scene, NOISE, num=5):
        assert np.linalg.norm(seen.poses["spoon"][3:]) == pytest.approx(1.0)
        assert seen.tilt("spoon") == pytest.approx(spoon_scene.tilt("spoon"), abs=1e-6)


def test_the_same_random_numbers_make_the_same_errors(vase_scene):
    first, second = looks(vase_scene, NOISE, 3), looks(vase_scene, NOISE, 3)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.poses["vase"], other.poses["vase"])
    assert (first[0].poses["vase"] != first[1].poses["vase"]).any()


def test_a_half_turned_thing_is_seen_so():
    pose = np.array([0.0, 0.0, 0.0, np.cos(0.6), 0.0, 0.0, np.sin(0.6)])
    assert Percept({"fork": pose}).yaw("fork") == pytest.approx(1.2)
    lying = np.array([0.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])
    assert Percept({"vase": lying}).tilt("vase") == pytest.approx(np.pi / 2)


def test_noise_needs_a_source(vase_scene):
    with pytest.raises(ValueError, match="`rng` must be given"):
        Camera(vase_scene, NOISE)


@pytest.mark.parametrize("value", [-0.001, np.inf, np.nan])
def test_noise_is_no_less_than_none(value):
    with pytest.raises(ValueError, match="`layout_std` must be 0 or more; got"):
        SensorNoise(layout_std=value)
