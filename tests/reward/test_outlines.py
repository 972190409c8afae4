import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.reward.footprint import Footprint
from tablesetting.reward.outlines import Outlines

seeds = st.integers(0, 2**32)


def random_obstacles(seed):
    """Draw up to six discs and stadiums anywhere, overlapping or not."""
    rng = np.random.default_rng(seed)
    num = rng.integers(1, 7)
    half_lengths = rng.uniform(0.0, 0.3, num) * rng.integers(0, 2, num)
    sizes = zip(rng.uniform(0.02, 0.3, num), half_lengths, strict=True)
    return rng.random((num, 2)), [Footprint(*size) for size in sizes]


def test_no_obstacles_have_no_samples():
    outlines = Outlines(np.empty((0, 2)), ())
    for array in (outlines.owner, outlines.arcs, outlines.spacing, outlines.following):
        assert array.shape == (0,)
    assert outlines.points(outlines.owner, outlines.arcs).shape == (0, 2)


def test_a_lone_disc_is_sampled_evenly_from_its_four_extreme_points():
    outlines = Outlines(np.array([[0.5, 0.4]]), [Footprint(0.1)])
    num_samples = len(outlines.arcs)
    np.testing.assert_allclose(outlines.spacing, 0.2 * np.pi / num_samples)
    extreme = outlines.points(outlines.owner, outlines.arcs)[:: num_samples // 4]
    expected = [[0.6, 0.4], [0.5, 0.5], [0.4, 0.4], [0.5, 0.3]]
    np.testing.assert_allclose(extreme, expected, atol=1e-12)


@given(seeds)
def test_samples_go_once_around_every_outline_in_short_steps(seed):
    centers, obstacles = random_obstacles(seed)
    outlines = Outlines(centers, obstacles)
    assert (np.diff(outlines.owner) >= 0).all()
    assert (outlines.spacing > 0.0).all()
    assert outlines.spacing.max() <= 0.02 + 1e-12
    for index, obstacle in enumerate(obstacles):
        own = outlines.owner == index
        arcs = outlines.arcs[own]
        assert (np.diff(arcs) > 0.0).all()
        assert arcs[0] >= 0.0
        assert arcs[-1] < obstacle.perimeter
        assert outlines.spacing[own].sum() == pytest.approx(obstacle.perimeter)


@given(seeds)
def test_neighbours_are_each_others_and_one_spacing_apart(seed):
    centers, obstacles = random_obstacles(seed)
    outlines = Outlines(centers, obstacles)
    everyone = np.arange(len(outlines.arcs))
    np.testing.assert_array_equal(outlines.preceding[outlines.following], everyone)
    np.testing.assert_array_equal(outlines.following[outlines.preceding], everyone)
    np.testing.assert_array_equal(outlines.owner[outlines.following], outlines.owner)
    ahead = outlines.points(outlines.owner, outlines.arcs + outlines.spacing)
    there = outlines.points(outlines.owner, outlines.arcs)[outlines.following]
    np.testing.assert_allclose(ahead, there, atol=1e-12)


@given(seeds)
def test_samples_are_on_their_obstacles_outline(seed):
    centers, obstacles = random_obstacles(seed)
    outlines = Outlines(centers, obstacles)
    points, normals, curvatures = outlines.walk(outlines.owner, outlines.arcs)
    for index, obstacle in enumerate(obstacles):
        own = outlines.owner == index
        expected = obstacle.outline(outlines.arcs[own])
        np.testing.assert_allclose(points[own], centers[index] + expected[0])
        np.testing.assert_array_equal(normals[own], expected[1])
        np.testing.assert_array_equal(curvatures[own], expected[2])


@given(seeds)
def test_samples_show_how_close_two_obstacles_come(seed):
    centers, obstacles = random_obstacles(seed)
    outlines = Outlines(centers, obstacles)
    points = outlines.points(outlines.owner, outlines.arcs)
    for i, first in enumerate(obstacles):
        for j, second in enumerate(obstacles[:i]):
            gap = first.grow(second, 0.0).distance(centers[i] - centers[j])
            if gap > -min(first.radius, second.radius):
                to_second = second.distance(points[outlines.owner == i] - centers[j])
                to_first = first.distance(points[outlines.owner == j] - centers[i])
                nearest = min(to_second.min(), to_first.min())
                assert nearest == pytest.approx(gap, abs=1e-12)
