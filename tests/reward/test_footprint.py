import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.reward.footprint import POINT, Footprint

lengths = st.floats(0.02, 0.3)
footprints = st.builds(Footprint, lengths, st.just(0.0) | lengths)
fractions = st.floats(0.0, 1.0, exclude_max=True)


def walk(footprint, num_points):
    """Return arc lengths that no joint of straight side and cap falls on."""
    step = footprint.perimeter / num_points
    arcs = step * (np.arange(num_points) + 0.5)
    half = 0.5 * footprint.perimeter
    straight = 2.0 * footprint.half_length
    along = np.mod(arcs + footprint.half_length, half)
    to_joint = np.min(
        [along, half - along, np.abs(along - straight)], axis=0, initial=np.inf
    )
    return arcs[to_joint > 1e-4]


def test_distance_to_a_disc_by_hand():
    points = np.array([[0.0, 0.0], [0.3, 0.4], [-0.2, 0.0]])
    np.testing.assert_allclose(Footprint(0.2).distance(points), [-0.2, 0.3, 0.0])


def test_distance_to_a_stadium_by_hand():
    points = np.array([[0.0, 0.0], [0.2, 0.25], [0.0, -0.5], [0.03, 0.34]])
    stadium = Footprint(0.1, half_length=0.3)
    np.testing.assert_allclose(stadium.distance(points), [-0.1, 0.1, 0.1, -0.05])


def test_a_point_covers_itself_alone():
    assert POINT == Footprint(0.0, 0.0)
    assert POINT.distance(np.array([0.3, 0.4])) == pytest.approx(0.5)


@given(footprints)
def test_outline_starts_at_plus_x_and_goes_around_counter_clockwise(footprint):
    quarters = footprint.perimeter * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    offsets, normals, _ = footprint.outline(quarters)
    right, top = footprint.radius, footprint.radius + footprint.half_length
    expected = [[right, 0.0], [0.0, top], [-right, 0.0], [0.0, -top], [right, 0.0]]
    np.testing.assert_allclose(offsets, expected, atol=1e-12)
    np.testing.assert_allclose(
        normals, [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]], atol=1e-12
    )


@given(footprints, st.floats(-3.0, 3.0))
def test_outline_is_at_distance_zero_and_repeats(footprint, arc):
    arcs = np.array([arc, arc + footprint.perimeter, arc - 2 * footprint.perimeter])
    offsets, normals, _ = footprint.outline(arcs)
    np.testing.assert_allclose(footprint.distance(offsets), 0.0, atol=1e-12)
    np.testing.assert_allclose(offsets, np.tile(offsets[0], (3, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


@given(footprints)
def test_outline_is_walked_at_unit_speed_with_the_normal_to_the_right(footprint):
    step = 1e-6
    arcs = walk(footprint, 100)
    ahead, behind = footprint.outline(arcs + step), footprint.outline(arcs - step)
    velocity = (ahead[0] - behind[0]) / (2 * step)
    normals = footprint.outline(arcs)[1]
    np.testing.assert_allclose(velocity[:, 1], normals[:, 0], atol=1e-7)
    np.testing.assert_allclose(velocity[:, 0], -normals[:, 1], atol=1e-7)


@given(footprints)
def test_normals_turn_at_the_rate_of_the_curvature(footprint):
    step = 1e-6
    arcs = walk(footprint, 100)
    _, normals, curvatures = footprint.outline(arcs)
    tangents = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    turn = footprint.outline(arcs + step)[1] - footprint.outline(arcs - step)[1]
    np.testing.assert_allclose(
        turn / (2 * step), curvatures[:, None] * tangents, atol=1e-6
    )


@given(footprints)
def test_normals_are_the_gradient_of_the_distance(footprint):
    step = 1e-7
    offsets, normals, _ = footprint.outline(walk(footprint, 50))
    for axis, direction in enumerate(np.eye(2)):
        ahead = footprint.distance(offsets + step * direction)
        behind = footprint.distance(offsets - step * direction)
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(slope, normals[:, axis], atol=1e-5)


@given(footprints, st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_distance_equals_the_nearest_point_of_a_dense_outline(footprint, x, y):
    arcs = np.linspace(0.0, footprint.perimeter, 4000)
    nearest = np.linalg.norm(footprint.outline(arcs)[0] - [x, y], axis=1).min()
    assert abs(footprint.distance(np.array([x, y]))) == pytest.approx(nearest, abs=1e-3)


@given(footprints, footprints, fractions, st.floats(0.7, 1.5))
def test_grown_footprint_measures_the_gap_between_two(first, second, turn, reach):
    angle = 2.0 * np.pi * turn
    offset = reach * np.array([np.cos(angle), 1.8 * np.sin(angle)])
    gap = first.grow(second, 0.0).distance(offset)
    one = first.outline(np.linspace(0.0, first.perimeter, 250))[0]
    other = second.outline(np.linspace(0.0, second.perimeter, 250))[0] + offset
    nearest = np.linalg.norm(one[:, None] - other, axis=-1).min()
    if gap > 0.02:
        assert gap == pytest.approx(nearest, abs=2e-3)
    margin = first.grow(second, 0.05).distance(offset)
    assert margin == pytest.approx(gap - 0.05)


@given(footprints, footprints)
def test_it_does_not_matter_which_of_two_grows(first, second):
    assert first.grow(second, 0.1).radius == pytest.approx(
        second.grow(first, 0.1).radius
    )
    assert first.grow(POINT, 0.0) == first
