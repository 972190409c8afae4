import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.rbf import all_centers, rbf_features, reward_derivatives
from tablesetting.reward.square import (
    best_on_square,
    grid_points,
    grid_ticks,
    square_optima,
)

seeds = st.integers(0, 2**32)
rbf_widths = st.sampled_from([0.05, 0.3])  # The least that is allowed, the usual.


def random_case(seed, width):
    """Return weights (8, 13), a layout (4, 2) and widths (13,)."""
    rng = np.random.default_rng(seed)
    weights = sample_uniform_weights(8, 13, rng=rng)
    return weights, rng.random((4, 2)), np.full(13, width)


def best_of_each(optima):
    """Return the highest reward found for each reward, (8,)."""
    best = np.full(8, -np.inf)
    np.maximum.at(best, optima.sample, optima.rewards)
    return best


@pytest.mark.parametrize(("width", "size"), [(0.3, 16), (5.0, 16), (0.05, 38)])
def test_climbs_start_all_over_the_square_edges_included(width, size):
    grid = grid_points(np.array([1.0, width]))
    assert grid.min() == 0.0
    assert grid.max() == 1.0
    assert len(np.unique(grid, axis=0)) == len(grid) == size**2


def test_a_grid_four_times_as_fine_shows_nothing_better():
    rng = np.random.default_rng(0)
    for width in (0.3, 0.05):
        widths = np.full(13, width)
        weights = sample_uniform_weights(500, 13, rng=rng)
        layouts = rng.random((40, 4, 2))
        fine = np.linspace(0.0, 1.0, 4 * len(grid_ticks(widths)))
        rewards = [
            (rbf_features(best, all_centers(layouts), widths) * weights).sum(axis=2)
            for best in (
                best_on_square(weights, layouts, widths),
                best_on_square(weights, layouts, widths, fine),
            )
        ]
        np.testing.assert_allclose(*rewards, atol=1e-12)


def test_an_optimum_between_an_edge_and_the_grid_is_seen():
    """One in a hundred thousand random rewards has none but such a one."""
    rng = np.random.default_rng(0)
    widths, num_hidden = np.full(13, 0.3), 0
    for _ in range(150):
        layout, weights = rng.random((4, 2)), sample_uniform_weights(2000, 13, rng=rng)
        best = best_on_square(weights, layout[None], widths)[0]
        features = rbf_features(best, all_centers(layout), widths)
        optima = square_optima(weights, all_centers(layout), widths)
        highest = np.full(len(weights), -np.inf)
        np.maximum.at(highest, optima.sample, optima.rewards)
        gain = (features * weights).sum(axis=1) - highest
        assert gain.min() >= -1e-12
        num_hidden += np.sum(gain > 1e-9)
    assert num_hidden > 0


def test_of_two_peaks_both_are_optima_and_the_higher_is_the_best():
    layout = np.array([[0.12, 0.16], [0.86, 0.9]])
    weights, widths = np.array([[1.0, 0.3, *[0.0] * 9]]), np.full(11, 0.05)
    optima = square_optima(weights, all_centers(layout), widths)
    order = np.argsort(optima.points[:, 0])
    np.testing.assert_allclose(optima.points[order], layout, atol=1e-6)
    best = best_on_square(weights, layout[None], widths)
    np.testing.assert_allclose(best, layout[None, :1], atol=1e-6)


@given(seeds, rbf_widths)
def test_every_optimum_says_whose_it_is_and_how_good(seed, width):
    weights, layout, widths = random_case(seed, width)
    optima = square_optima(weights, all_centers(layout), widths)
    features = rbf_features(optima.points, all_centers(layout), widths)
    expected = (features * weights[optima.sample]).sum(axis=1)
    np.testing.assert_allclose(optima.rewards, expected, atol=1e-12)
    assert ((optima.points >= 0.0) & (optima.points <= 1.0)).all()


@given(seeds, rbf_widths)
def test_optima_include_the_best_point_of_the_grid_for_every_reward(seed, width):
    weights, layout, widths = random_case(seed, width)
    optima = square_optima(weights, all_centers(layout), widths)
    grid = grid_points(widths)
    on_grid = (rbf_features(grid, all_centers(layout), widths) @ weights.T).max(axis=0)
    assert (best_of_each(optima) >= on_grid - 1e-12).all()


@given(seeds, rbf_widths)
def test_the_best_point_is_the_best_of_all_optima(seed, width):
    """Although it leaves out climbs that begin too low."""
    weights, layout, widths = random_case(seed, width)
    optima = square_optima(weights, all_centers(layout), widths)
    best = best_on_square(weights, layout[None], widths)[0]
    features = rbf_features(best, all_centers(layout), widths)
    rewards = (features * weights).sum(axis=1)
    np.testing.assert_allclose(rewards, best_of_each(optima), atol=1e-12)


@given(seeds)
def test_nothing_leads_up_from_an_optimum(seed):
    weights, layout, widths = random_case(seed, 0.3)
    centers = all_centers(layout)
    optima = square_optima(weights, centers, widths)
    at_centers = np.broadcast_to(centers, (len(optima.points), *centers.shape))
    _, gradients, _ = reward_derivatives(
        optima.points, weights[optima.sample], at_centers, widths
    )
    is_low, is_high = optima.points < 1e-9, optima.points > 1.0 - 1e-9
    upward = np.where(is_low, np.maximum(gradients, 0.0), gradients)
    upward = np.where(is_high, np.minimum(upward, 0.0), upward)
    np.testing.assert_allclose(upward, 0.0, atol=1e-4)
