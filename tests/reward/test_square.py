import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.rbf import all_centers, rbf_features, reward_derivatives
from tablesetting.reward.square import GRID, square_optima

seeds = st.integers(0, 2**32)
rbf_widths = st.sampled_from([0.05, 0.3])  # The least that is allowed, the usual.


def random_case(seed, width):
    """Return weights (8, 13), centers in layouts (3, 13, 2) and widths (13,)."""
    rng = np.random.default_rng(seed)
    weights = sample_uniform_weights(8, 13, rng=rng)
    return weights, all_centers(rng.random((3, 4, 2))), np.full(13, width)


def best_of_each(optima):
    """Return the highest reward found for each reward in each layout, (3, 8)."""
    best = np.full((3, 8), -np.inf)
    np.maximum.at(best, (optima.layout, optima.sample), optima.rewards)
    return best


def test_climbs_start_all_over_the_square_edges_included():
    assert GRID.min() == 0.0
    assert GRID.max() == 1.0
    assert len(np.unique(GRID, axis=0)) == len(GRID) == 14**2


@pytest.mark.parametrize(
    ("only_best", "expected"),
    [(False, [[0.12, 0.16], [0.86, 0.9]]), (True, [[0.12, 0.16]])],
)
def test_of_two_peaks_the_lower_is_left_out_only_when_told(only_best, expected):
    centers = np.array([[[0.12, 0.16], [0.86, 0.9]]])
    weights, widths = np.array([[1.0, 0.3]]), np.full(2, 0.05)
    optima = square_optima(weights, centers, widths, only_best=only_best)
    order = np.argsort(optima.points[:, 0])
    np.testing.assert_allclose(optima.points[order], expected, atol=1e-6)


@pytest.mark.parametrize("only_best", [False, True])
def test_of_two_equal_peaks_both_are_kept(only_best):
    centers = np.array([[[0.12, 0.16], [0.88, 0.84]]])
    weights, widths = np.array([[0.5, 0.5]]), np.full(2, 0.05)
    optima = square_optima(weights, centers, widths, only_best=only_best)
    assert len(optima.points) == 2


@given(seeds, rbf_widths, st.booleans())
def test_every_optimum_says_whose_it_is_and_how_good(seed, width, only_best):
    weights, centers, widths = random_case(seed, width)
    optima = square_optima(weights, centers, widths, only_best=only_best)
    features = rbf_features(optima.points[:, None], centers[optima.layout], widths)
    expected = (features[:, 0] * weights[optima.sample]).sum(axis=1)
    np.testing.assert_allclose(optima.rewards, expected, atol=1e-12)
    assert ((optima.points >= 0.0) & (optima.points <= 1.0)).all()


@given(seeds, rbf_widths)
def test_all_optima_include_the_best_point_of_the_grid_for_every_pair(seed, width):
    weights, centers, widths = random_case(seed, width)
    optima = square_optima(weights, centers, widths, only_best=False)
    on_grid = (rbf_features(GRID, centers, widths) @ weights.T).max(axis=1)
    assert (best_of_each(optima) >= on_grid - 1e-12).all()


@given(seeds, rbf_widths)
def test_leaving_out_loses_no_global_optimum(seed, width):
    weights, centers, widths = random_case(seed, width)
    everything = square_optima(weights, centers, widths, only_best=False)
    few = square_optima(weights, centers, widths, only_best=True)
    assert len(few.points) <= len(everything.points)
    np.testing.assert_allclose(best_of_each(few), best_of_each(everything), atol=1e-12)


def test_leaving_out_spares_most_climbs():
    weights, centers, widths = random_case(0, 0.05)
    everything = square_optima(weights, centers, widths, only_best=False)
    few = square_optima(weights, centers, widths, only_best=True)
    assert len(few.points) < 0.7 * len(everything.points)


@given(seeds)
def test_nothing_leads_up_from_an_optimum(seed):
    weights, centers, widths = random_case(seed, 0.3)
    optima = square_optima(weights, centers, widths, only_best=False)
    _, gradients, _ = reward_derivatives(
        optima.points, weights[optima.sample], centers[optima.layout], widths
    )
    is_low, is_high = optima.points < 1e-9, optima.points > 1.0 - 1e-9
    upward = np.where(is_low, np.maximum(gradients, 0.0), gradients)
    upward = np.where(is_high, np.minimum(upward, 0.0), upward)
    np.testing.assert_allclose(upward, 0.0, atol=1e-4)
