import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.scene.solids import Solid, box, disc, shell

lengths = st.floats(0.01, 0.1)


def corners(solid):
    """Return the corners of a box, shape (8, 3), by turning with its quaternion."""
    w, *xyz = solid.quaternion
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), -1).reshape(-1, 3)
    local = signs * solid.size
    twist = 2.0 * np.cross(xyz, local)
    return local + w * twist + np.cross(xyz, twist) + solid.position


def test_box_and_disc_lie_between_their_bounds():
    solid = box(x=(0.0, 0.2), y=(-0.1, 0.1), z=(0.1, 0.4))
    np.testing.assert_allclose(solid.size, (0.1, 0.1, 0.15))
    np.testing.assert_allclose(solid.position, (0.1, 0.0, 0.25))
    upright = disc(0.03, bottom=0.1, top=0.2, center=(0.5, 0.0))
    np.testing.assert_allclose(upright.size, (0.03, 0.05))
    np.testing.assert_allclose(upright.position, (0.5, 0.0, 0.15))


@given(lengths, lengths, lengths)
def test_volumes_of_the_primitives(a, b, c):
    center = (0.0, 0.0, 0.0)
    assert Solid("box", (a, b, c), center).volume == pytest.approx(8 * a * b * c)
    ellipsoid = Solid("ellipsoid", (a, b, c), center)
    assert ellipsoid.volume == pytest.approx(4 / 3 * np.pi * a * b * c)
    cylinder = Solid("cylinder", (a, b), center)
    assert cylinder.volume == pytest.approx(2 * np.pi * a**2 * b)


@given(lengths, lengths, lengths, st.integers(3, 24))
def test_corners_of_a_shell_lie_on_the_turned_wall(low, high, height, num_sides):
    profile = [(low, 0.01), (high, 0.01 + height)]
    solids = shell(profile, 0.002, num_sides, center=(0.3, -0.1))
    assert len(solids) == num_sides
    points = np.concatenate([corners(solid) for solid in solids])
    radii = np.hypot(points[:, 0] - 0.3, points[:, 1] + 0.1)
    assert radii.max() == pytest.approx(max(low, high))


@given(st.integers(3, 24))
def test_staves_of_a_straight_shell_close_the_ring(num_sides):
    solids = shell([(0.05, 0.0), (0.05, 0.1)], 0.004, num_sides)
    edges = np.concatenate([corners(solid)[:, :2] for solid in solids])
    outer = np.hypot(*edges.T) > 0.05 - 1e-9
    angles = np.unique(np.arctan2(*edges[outer].T[::-1]).round(9) % (2 * np.pi))
    steps = np.diff(angles[np.diff(angles, prepend=-1.0) > 1e-6])
    np.testing.assert_allclose(steps, 2 * np.pi / num_sides, atol=1e-6)
