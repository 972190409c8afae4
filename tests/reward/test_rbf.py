import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.rbf import (
    TABLE_CENTERS,
    RbfWidths,
    all_centers,
    rbf_features,
    reward_derivatives,
)

seeds = st.integers(0, 2**32)


def random_rewards(seed, num_points=20, num_objects=4):
    """Draw points, each with its own reward."""
    rng = np.random.default_rng(seed)
    centers = all_centers(rng.random((num_points, num_objects, 2)))
    weights = sample_uniform_weights(num_points, centers.shape[1], rng=rng)
    widths = rng.uniform(0.1, 0.5, centers.shape[1])
    return rng.random((num_points, 2)), weights, centers, widths


@pytest.mark.parametrize("name", ["object_width", "table_width"])
@pytest.mark.parametrize("value", [0.04, -0.3, math.nan])
def test_widths_that_the_grid_would_overlook_are_refused(name, value):
    with pytest.raises(ValueError, match=f"`{name}` must be at least 0.05.*{value}"):
        RbfWidths(**{name: value})


def test_table_centers_go_along_rows_from_the_far_edge_to_the_near_one():
    ticks = (0.0, 0.5, 1.0)
    expected = [(x, 1.0) for x in ticks] + [(x, 0.5) for x in ticks]
    expected += [(x, 0.0) for x in ticks]
    assert [tuple(center) for center in TABLE_CENTERS.tolist()] == expected


def test_objects_come_before_the_table():
    layouts = np.random.default_rng(0).random((2, 3, 4, 2))
    centers = all_centers(layouts)
    assert centers.shape == (2, 3, 13, 2)
    np.testing.assert_array_equal(centers[..., :4, :], layouts)
    np.testing.assert_array_equal(centers[1, 2, 4:], TABLE_CENTERS)
    widths = RbfWidths(object_width=0.1, table_width=0.2).per_center(2)
    assert widths.tolist() == [0.1, 0.1] + 9 * [0.2]


def test_features_by_hand():
    points = np.array([[0.5, 0.5], [0.5, 1.0]])
    centers = np.array([[0.5, 0.5], [0.2, 0.1]])
    features = rbf_features(points, centers, np.array([0.5, 0.25]))
    expected = [[1.0, math.exp(-1.0)], [math.exp(-0.5), math.exp(-0.9 / 0.25)]]
    np.testing.assert_allclose(features, expected)


def test_features_of_many_layouts_equal_those_of_each():
    rng = np.random.default_rng(0)
    points, centers = rng.random((7, 2)), rng.random((3, 5, 2))
    widths = rng.uniform(0.1, 0.5, 5)
    together = rbf_features(points, centers, widths)
    for index in range(3):
        expected = rbf_features(points, centers[index], widths)
        np.testing.assert_array_equal(together[index], expected)


@given(seeds, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_features_depend_on_differences_alone_and_are_at_most_one(seed, x, y):
    points, _, centers, widths = random_rewards(seed)
    features = rbf_features(points, centers[0], widths)
    moved = rbf_features(points + [x, y], centers[0] + [x, y], widths)
    np.testing.assert_allclose(moved, features, atol=1e-12)
    assert ((features > 0.0) & (features <= 1.0)).all()


@given(seeds)
def test_reward_is_the_weighted_sum_of_the_features(seed):
    points, weights, centers, widths = random_rewards(seed)
    rewards, _, _ = reward_derivatives(points, weights, centers, widths)
    expected = [
        (rbf_features(point[None], center, widths) @ weight)[0]
        for point, weight, center in zip(points, weights, centers, strict=True)
    ]
    np.testing.assert_allclose(rewards, expected, atol=1e-14)


@given(seeds)
def test_gradient_and_hessian_agree_with_finite_differences(seed):
    step = 1e-5
    points, weights, centers, widths = random_rewards(seed)
    _, gradients, hessians = reward_derivatives(points, weights, centers, widths)
    for axis, direction in enumerate(np.eye(2)):
        ahead = reward_derivatives(points + step * direction, weights, centers, widths)
        behind = reward_derivatives(points - step * direction, weights, centers, widths)
        slope = (ahead[0] - behind[0]) / (2 * step)
        bend = (ahead[1] - behind[1]) / (2 * step)
        np.testing.assert_allclose(gradients[:, axis], slope, atol=1e-7)
        np.testing.assert_allclose(hessians[:, axis], bend, atol=1e-6)
