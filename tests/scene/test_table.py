import re

import numpy as np
import pytest
from dm_control import mjcf
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.scene.table import Table, TableFrame

extents = st.floats(0.1, 2.0)
coordinates = st.floats(-1.0, 2.0)


def test_a_frame_without_extent_is_refused():
    with pytest.raises(ValueError, match=re.escape("(0.5, 0.0)")):
        TableFrame(size=(0.5, 0.0))
    with pytest.raises(ValueError, match="positive and finite"):
        TableFrame(size=(float("nan"), 0.5))


def test_unit_square_lies_around_the_origin():
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5], [1.0, 1.0]])
    expected = np.array([[-0.25, -0.25], [0.25, -0.25], [0.0, 0.0], [0.25, 0.25]])
    np.testing.assert_allclose(TableFrame().to_world(corners), expected)


@given(st.tuples(extents, extents), st.lists(st.tuples(coordinates, coordinates)))
def test_frame_round_trip(size, points):
    frame = TableFrame(size)
    points = np.array(points).reshape(-1, 2)
    np.testing.assert_allclose(
        frame.from_world(frame.to_world(points)), points, atol=1e-12
    )


def test_frame_keeps_leading_dimensions():
    points = np.zeros((3, 4, 2))
    assert TableFrame().to_world(points).shape == (3, 4, 2)
    assert TableFrame().to_world(points[0, 0]).shape == (2,)


def test_only_the_plane_of_the_top_collides():
    model = mjcf.Physics.from_mjcf_model(Table().mjcf_model).model
    colliding = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    assert [model.id2name(geom, "geom") for geom in colliding] == ["top"]
    assert model.geom_pos[colliding[0], 2] == 0.0


def test_mat_shows_the_unit_square():
    frame = TableFrame(size=(0.4, 0.3))
    model = mjcf.Physics.from_mjcf_model(Table(frame).mjcf_model).model
    mat = model.name2id("mat", "geom")
    np.testing.assert_allclose(2 * model.geom_size[mat, :2], frame.size)
    np.testing.assert_allclose(model.geom_pos[mat, :2], 0.0)
    assert model.geom_pos[mat, 2] + model.geom_size[mat, 2] == 0.0


@pytest.mark.parametrize(
    "point", [(0.0, -0.41), (0.46, -0.19), (-0.25, 0.25), (0.25, 0.25)]
)
def test_robot_staging_spot_and_square_stand_on_the_table(point):
    model = mjcf.Physics.from_mjcf_model(Table().mjcf_model).model
    top = model.name2id("top", "geom")
    margin = model.geom_size[top, :2] - np.abs(point - model.geom_pos[top, :2])
    assert (margin > 0.04).all()


def test_a_model_that_disables_nativeccd_cannot_be_attached_unnoticed():
    other = mjcf.RootElement(model="other")
    other.option.flag.nativeccd = "disable"
    with pytest.raises(ValueError, match="nativeccd"):
        Table().mjcf_model.attach(other)
