from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.reward.footprint import POINT, Footprint
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import SPOON, VASE

EMPTY = FreeSpace(np.empty((0, 2)), ())
seeds = st.integers(0, 2**32)


def discs(*centers_and_radii):
    """Return the unit square without some discs, each (x, y, radius)."""
    table = np.array(centers_and_radii)
    return FreeSpace(table[:, :2], tuple(Footprint(r) for r in table[:, 2]))


def random_space(seed):
    """Random obstacles of a task, overlapping or not."""
    rng = np.random.default_rng(seed)
    task = (VASE, SPOON)[seed % 2]
    space = LayoutSpace.of_task(task, are_points=False)
    return space.free_space(rng.random((len(task.objects), 2)))


def limits(space, points):
    """Return the signed distance of points to each limit, shape (K + 4, S)."""
    outlines = [
        obstacle.distance(points - center)
        for center, obstacle in zip(space.centers, space.obstacles, strict=True)
    ]
    return np.stack([*outlines, *points.T, *(1.0 - points.T)])


def test_free_is_on_the_square_and_outside_every_obstacle():
    points = np.array([[0.0, 1.0], [1.1, 0.5], [0.5, 0.5], [0.5, 0.7], [0.5, 0.69]])
    expected = [True, False, False, True, False]
    assert discs((0.5, 0.5, 0.2)).contains(points).tolist() == expected


def test_objects_keep_the_item_at_its_size_and_the_clearance():
    space = FreeSpace.around(
        np.array([[0.5, 0.5]]), [Footprint(0.1)], Footprint(0.05, 0.1), clearance=0.02
    )
    assert space.obstacles == (Footprint(pytest.approx(0.17), 0.1),)


def test_points_leave_all_space_free():
    space = FreeSpace.around(np.array([[0.5, 0.5]]), [POINT], POINT, clearance=0.05)
    assert space.obstacles == ()
    assert space.contains(np.array([0.5, 0.5]))


def test_a_receptacle_is_free_on_the_square_whatever_stands_there():
    space = replace(
        discs((0.3, 0.5, 0.2), (0.0, 0.5, 0.4)),
        receptacles=np.array([[0.3, 0.5], [0.01, 0.5]]),
        receptacle_radius=0.05,
    )
    points = [[0.3, 0.5], [0.34, 0.53], [0.34, 0.54], [0.0, 0.5], [-0.01, 0.5], [1, 1]]
    expected = [True, True, False, True, False, True]
    assert space.contains(np.array(points)).tolist() == expected
    is_inside = [True, True, False, True, True, False]
    assert space.in_receptacle(np.array(points)).tolist() == is_inside
    assert not EMPTY.in_receptacle(np.array(points)).any()


def test_receptacles_are_some_of_the_objects():
    centers = np.array([[0.2, 0.3], [0.5, 0.5], [0.8, 0.1]])
    sizes = [Footprint(0.1)] * 3
    beside = FreeSpace.around(centers, sizes, POINT, 0.0)
    space = FreeSpace.around(centers, sizes, POINT, 0.0, [2, 0], 0.03)
    np.testing.assert_array_equal(space.receptacles, centers[[2, 0]])
    assert space.contains(centers).tolist() == [True, False, True]
    assert space.contains(np.array([0.8, 0.13]))
    assert not beside.contains(centers).any()


def test_corners_of_a_receptacle_at_the_edge_by_hand():
    full = discs((0.5, 0.5, 0.8))
    at_edge = np.array([[0.5, 0.03]])
    corners = replace(full, receptacles=at_edge, receptacle_radius=0.05).corners
    assert {tuple(corner) for corner in corners.round(9)} == {(0.46, 0.0), (0.54, 0.0)}


def test_corners_of_two_discs_by_hand():
    corners = discs((0.4, 0.5, 0.125), (0.55, 0.5, 0.125)).corners
    assert {tuple(corner) for corner in corners.round(9)} == {
        (0.475, 0.4),
        (0.475, 0.6),
    }


def test_corners_of_a_disc_at_the_edge_by_hand():
    corners = discs((0.5, 0.03, 0.05)).corners
    assert {tuple(corner) for corner in corners.round(9)} == {(0.46, 0.0), (0.54, 0.0)}


def test_objects_that_stand_apart_from_all_have_no_corners():
    assert discs((0.3, 0.3, 0.1), (0.7, 0.7, 0.1)).corners.shape == (0, 2)
    assert EMPTY.corners.shape == (0, 2)


@pytest.mark.parametrize("radius", [0.03125, 0.0625, 0.125, 0.25])
def test_one_object_that_stands_alone_has_no_corners(radius):
    assert discs((0.40775221, 0.46534497, radius)).corners.shape == (0, 2)


@pytest.mark.parametrize("depth", [1e-3, 1e-5, 1e-7])
def test_corners_are_found_however_little_a_disc_passes_the_edge(depth):
    radius, top = 0.25, 1.0 + depth
    half_chord = np.sqrt(radius**2 - (radius - depth) ** 2)
    corners = discs((0.5, top - radius, radius)).corners
    expected = [[0.5 - half_chord, 1.0], [0.5 + half_chord, 1.0]]
    np.testing.assert_allclose(np.sort(corners, axis=0), expected, atol=1e-6)


@pytest.mark.parametrize("depth", [1e-3, 1e-5, 1e-7])
def test_corners_are_found_however_little_two_discs_overlap(depth):
    radius = 0.2
    apart = radius - 0.5 * depth
    toward = np.array([np.cos(0.7), np.sin(0.7)])
    across = np.array([-toward[1], toward[0]]) * np.sqrt(radius**2 - apart**2)
    first, second = 0.5 - apart * toward, 0.5 + apart * toward
    corners = discs((*first, radius), (*second, radius)).corners
    for expected in (0.5 + across, 0.5 - across):
        assert np.linalg.norm(corners - expected, axis=1).min(initial=1.0) < 1e-6


@given(seeds)
def test_corners_are_free_and_lie_on_two_limits(seed):
    space = random_space(seed)
    corners = space.corners
    assert space.contains(corners).all()
    on_limit = np.abs(limits(space, corners)) < 1e-8
    assert (on_limit.sum(axis=0) >= 2).all()


@pytest.mark.parametrize("seed", range(40))
def test_no_corner_is_missed_where_a_dense_outline_becomes_free(seed):
    space = random_space(seed)
    for index, obstacle in enumerate(space.obstacles):
        arcs = np.linspace(0.0, obstacle.perimeter, 20_000, endpoint=False)
        points = space.outlines.points(np.full(len(arcs), index), arcs)
        margins = np.delete(limits(space, points), index, axis=0)
        is_free = (margins > 0.0).all(axis=0)
        for entry in points[is_free != np.roll(is_free, 1)]:
            assert np.linalg.norm(space.corners - entry, axis=1).min() < 1e-3


def test_nothing_is_free_under_an_obstacle_larger_than_the_table():
    space = discs((0.5, 0.5, 0.8))
    corners_of_the_square = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    assert not space.contains(corners_of_the_square).any()
    assert space.corners.shape == (0, 2)
