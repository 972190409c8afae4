import numpy as np
import pytest
from dm_control import mjcf
from hypothesis import given, settings
from hypothesis import strategies as st

from tablesetting.errors import TableSettingError
from tablesetting.reward.tasks import FOOTPRINTS
from tablesetting.scene.props import PROPS, make_prop
from tablesetting.scene.table import Table, TableFrame

SPECS = PROPS.values()
MILLIMETRE = 1e-3
STANDING = (1.0, 0.0, 0.0, 0.0)


class Stage:
    """One prop on a table."""

    def __init__(self, name):
        table, self.prop = Table(), make_prop(name)
        table.add_free_entity(self.prop)
        self.physics = mjcf.Physics.from_mjcf_model(table.mjcf_model)
        self.joint = self.physics.bind(mjcf.get_frame_freejoint(self.prop.mjcf_model))

    def release(self, position, quaternion, seconds):
        """Put the prop down, let go, and return its position and tilt in degrees."""
        self.physics.reset()
        self.joint.qpos = [*position, *quaternion]
        while self.physics.time() < seconds:
            self.physics.step()
        _, x, y = self.joint.qpos[3:6]
        return self.joint.qpos[:3], np.degrees(2.0 * np.arcsin(np.hypot(x, y)))

    def collision_points(self):
        """Return points that span the hull of every collision shape, shape (P, 3)."""
        self.release((0.0, 0.0, 0.0), STANDING, seconds=0.0)
        self.physics.forward()
        geoms = self.physics.bind(self.prop.mjcf_model.find_all("geom"))
        solid = np.flatnonzero(geoms.contype)
        assert solid.size
        return np.concatenate(
            [
                hull_points(geoms.type[i], geoms.size[i])
                @ geoms.xmat[i].reshape(3, 3).T
                + geoms.xpos[i]
                for i in solid
            ]
        )


def hull_points(geom_type, size):
    cylinder, box, ellipsoid = 5, 6, 4
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), -1).reshape(-1, 3)
    azimuth = np.linspace(0.0, 2.0 * np.pi, 361)
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    if geom_type == box:
        return signs * size
    if geom_type == cylinder:
        rims = [
            np.column_stack([circle * size[0], 0 * azimuth + s * size[1]])
            for s in (-1, 1)
        ]
        return np.concatenate(rims)
    assert geom_type == ellipsoid
    polar = np.linspace(0.0, np.pi, 91)[:, None, None]
    sphere = np.sin(polar) * circle
    height = np.broadcast_to(np.cos(polar), (*sphere.shape[:2], 1))
    return np.concatenate([sphere, height], axis=-1).reshape(-1, 3) * size


def distance_to_spine(points, half_length):
    """Return how far points are from the footprint's segment, seen from above."""
    beyond = np.maximum(np.abs(points[:, 1]) - half_length, 0.0)
    return np.hypot(points[:, 0], beyond)


@pytest.fixture(scope="module", params=list(PROPS))
def stage(request):
    return Stage(request.param)


def test_unknown_prop_is_refused_with_the_names_to_choose_from():
    with pytest.raises(TableSettingError, match=r"'candle'.*plate, bowl, cup, glass"):
        make_prop("candle")


@pytest.mark.parametrize(
    ("name", "radius", "half_length", "height", "mass"),
    [
        ("plate", 0.090, 0.0, 0.020, 0.35),
        ("bowl", 0.070, 0.0, 0.055, 0.30),
        ("cup", 0.047, 0.0, 0.085, 0.25),
        ("glass", 0.034, 0.0, 0.110, 0.20),
        ("vase", 0.033, 0.0, 0.180, 0.30),
        ("fork", 0.012, 0.078, 0.010, 0.05),
        ("knife", 0.010, 0.090, 0.010, 0.07),
        ("spoon", 0.016, 0.059, 0.011, 0.04),
    ],
)
def test_specs_are_the_agreed_ones(name, radius, half_length, height, mass):
    spec = PROPS[name]
    assert spec.name == name
    assert (spec.radius, spec.half_length) == (radius, half_length)
    assert (spec.height, spec.mass) == (height, mass)


def test_collision_shapes_fill_the_footprint_and_no_more(stage):
    spec, points = stage.prop.spec, stage.collision_points()
    reach = distance_to_spine(points, spec.half_length).max()
    assert reach == pytest.approx(spec.radius, abs=MILLIMETRE)
    if spec.half_length:
        length = np.ptp(points[:, 1])
        whole = 2.0 * (spec.half_length + spec.radius)
        assert whole - 6.0 * MILLIMETRE < length <= whole


def test_collision_shapes_stand_on_zero_and_reach_the_height(stage):
    heights = stage.collision_points()[:, 2]
    assert heights.min() == pytest.approx(0.0, abs=1e-9)
    assert heights.max() == pytest.approx(stage.prop.spec.height, abs=MILLIMETRE)


def test_mass_is_the_specified_one(stage):
    total = stage.physics.model.body_mass.sum()
    assert total == pytest.approx(stage.prop.spec.mass)


def test_nothing_visible_collides_or_weighs(stage):
    geoms = stage.physics.bind(
        [g for g in stage.prop.mjcf_model.find_all("geom") if g.type == "mesh"]
    )
    assert len(geoms.group) == len(stage.prop.spec.parts)
    assert not np.any(geoms.contype)
    assert not np.any(geoms.conaffinity)
    assert (np.asarray(geoms.group) == 2).all()


def test_looks_stay_within_footprint_and_height(stage):
    spec = stage.prop.spec
    vertices = np.concatenate([part.mesh.vertices for part in spec.parts])
    assert distance_to_spine(vertices, spec.half_length).max() <= spec.radius
    assert vertices[:, 2].min() >= -0.1 * MILLIMETRE
    assert vertices[:, 2].max() <= spec.height + MILLIMETRE


def test_settles_where_it_was_put(stage):
    position, tilt = stage.release((0.1, -0.2, 0.0), STANDING, seconds=1.0)
    np.testing.assert_allclose(position, (0.1, -0.2, 0.0), atol=0.5 * MILLIMETRE)
    assert tilt < 0.5
    assert np.abs(stage.joint.qvel).max() < 1e-6


@settings(max_examples=8, deadline=None)
@given(direction=st.floats(0.0, 2.0 * np.pi))
@pytest.mark.parametrize("name", ["vase", "glass", "cup"])
def test_tall_things_right_themselves_from_five_degrees(name, direction):
    half = np.radians(5.0) / 2.0
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    stage = Stage(name)
    _, tilt = stage.release(
        (0.0, 0.0, 0.004), (np.cos(half), *(np.sin(half) * axis)), seconds=3.0
    )
    assert tilt < 0.5


@pytest.mark.parametrize("name", ["bowl", "cup", "glass"])
def test_hollow_things_are_open_to_a_ball(name):
    table, prop = Table(), make_prop(name)
    table.add_free_entity(prop)
    x = -0.012 if name == "cup" else 0.0
    ball = table.mjcf_model.worldbody.add("body", pos=(x, 0.0, 0.15))
    ball.add("freejoint")
    ball.add("geom", type="sphere", size=[0.02], mass=0.01)
    physics = mjcf.Physics.from_mjcf_model(table.mjcf_model)
    while physics.time() < 1.5:
        physics.step()
    assert physics.bind(ball).xpos[2] < 0.035


def test_two_builds_are_identical():
    first, second = (Stage("cup").physics.model.ptr for _ in range(2))
    np.testing.assert_array_equal(first.mesh_vert, second.mesh_vert)
    np.testing.assert_array_equal(first.body_inertia, second.body_inertia)


def test_the_neck_of_the_vase_is_straight_where_a_jaw_holds_it():
    points = Stage("vase").collision_points()
    radii, heights = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    neck = radii[np.abs(heights - 0.172) < 1e-6].min()
    lip = radii[heights > 0.175].max()
    assert not np.any((heights > 0.115) & (heights < 0.155))
    assert 0.0 < lip - neck <= 3.0 * MILLIMETRE


def test_learning_and_physics_agree_on_every_footprint():
    assert set(FOOTPRINTS) == set(PROPS)
    (unit,) = set(TableFrame().size)
    for name, footprint in FOOTPRINTS.items():
        assert unit * footprint.radius == pytest.approx(PROPS[name].radius)
        assert unit * footprint.half_length == pytest.approx(PROPS[name].half_length)
