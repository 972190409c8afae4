import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.rbf import all_centers, rbf_features, reward_derivatives
from tablesetting.reward.square import GRID, best_on_square, square_optima

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


def test_climbs_start_all_over_the_square_edges_included():
    assert GRID.min() == 0.0
    assert GRID.max() == 1.0
    assert len(np.unique(GRID, axis=0)) == len(GRID) == 14**2


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
    on_grid = (rbf_features(GRID, all_centers(layout), widths) @ weights.T).max(axis=0)
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
