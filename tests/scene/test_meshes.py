import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.scene.meshes import lathe, smooth, strap
from tablesetting.scene.props import PROPS

PARTS = [
    pytest.param(part.mesh, id=f"{spec.name}-{index}")
    for spec in PROPS.values()
    for index, part in enumerate(spec.parts)
]


def volume(mesh):
    return np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6.0


def test_a_turned_rectangle_is_a_cylinder():
    mesh = lathe([(0.02, 0.0), (0.02, 0.1)], num_segments=360)
    assert volume(mesh) == pytest.approx(np.pi * 0.02**2 * 0.1, rel=1e-3)


def test_a_straight_strap_is_an_elliptic_rod():
    path = np.stack([np.linspace(0.0, 0.2, 9), np.zeros(9)], axis=1)
    mesh = strap(path, half_width=0.01, half_thickness=0.004, num_points=360)
    assert volume(mesh) == pytest.approx(np.pi * 0.01 * 0.004 * 0.2, rel=1e-3)


@given(st.floats(0.005, 0.1), st.floats(0.01, 0.2), st.booleans())
def test_triangles_face_outwards_whichever_way_the_profile_runs(radius, height, down):
    profile = [(radius, 0.0), (radius, height)]
    assert volume(lathe(profile[::-1] if down else profile)) > 0.0


@pytest.mark.parametrize("mesh", PARTS)
def test_every_part_is_closed_and_faces_outwards(mesh):
    edges = np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)])
    forth = {tuple(edge) for edge in edges.tolist()}
    assert len(forth) == len(edges)  # No edge runs twice in the same direction.
    assert forth == {(b, a) for a, b in forth}
    assert volume(mesh) > 0.0


@pytest.mark.parametrize("mesh", PARTS)
def test_stl_holds_every_triangle(mesh):
    stl = mesh.to_stl()
    assert len(stl) == 84 + 50 * len(mesh.faces)
    assert np.frombuffer(stl[80:84], "<u4")[0] == len(mesh.faces)
    first = np.frombuffer(stl[96:132], "<f4").reshape(3, 3)
    np.testing.assert_allclose(first, mesh.vertices[mesh.faces[0]], rtol=1e-6)


def test_smoothing_keeps_the_ends_and_a_doubled_corner():
    line = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0)]
    rounded = smooth(line, rounds=2)
    np.testing.assert_array_equal(rounded[[0, -1]], [line[0], line[-1]])
    assert (np.abs(rounded - (1.0, 0.0)).sum(axis=1) < 1e-12).any()
    assert rounded.min() >= 0.0
    assert rounded.max() <= 1.0
