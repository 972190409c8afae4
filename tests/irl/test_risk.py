import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from tablesetting.irl.risk import value_at_risk

samples = arrays(
    float, array_shapes(min_dims=1, max_dims=1, max_side=60), elements=st.floats(-9, 9)
)
percents = st.integers(1, 99)


@pytest.mark.parametrize("alpha", [-0.1, 0.0, 1.0, 95.0, math.nan])
def test_alpha_outside_the_open_unit_interval_is_refused(alpha):
    with pytest.raises(ValueError, match=rf"`alpha` must be in \(0, 1\); got {alpha}"):
        value_at_risk(np.ones(3), alpha)


def test_no_samples_are_refused():
    with pytest.raises(ValueError, match="no samples; draw at least one"):
        value_at_risk(np.empty((2, 0)), 0.95)


@pytest.mark.parametrize(
    ("alpha", "expected"), [(0.01, 1), (0.5, 2), (0.51, 3), (0.75, 3), (0.95, 4)]
)
def test_var_of_four_losses_by_hand(alpha, expected):
    assert value_at_risk(np.array([3.0, 1.0, 4.0, 2.0]), alpha) == expected


def test_rank_is_the_95th_of_100_or_the_96th_as_released():
    losses = np.arange(1.0, 101.0)
    assert value_at_risk(losses, 0.95) == 95.0
    assert value_at_risk(losses, 0.95, rank_offset=1) == 96.0


def test_rank_is_not_one_too_high_where_the_product_rounds_up():
    assert 0.55 * 100 > 55  # The trap.
    assert value_at_risk(np.arange(1.0, 101.0), 0.55) == 55.0


@pytest.mark.parametrize("rank_offset", [-5, 0, 5])
def test_rank_stays_within_the_samples(rank_offset):
    assert value_at_risk(np.array([7.0]), 0.5, rank_offset=rank_offset) == 7.0


@given(samples, percents)
def test_var_is_the_least_sample_that_alpha_of_all_do_not_exceed(losses, percent):
    covering = [x for x in losses if 100 * np.sum(losses <= x) >= percent * len(losses)]
    assert value_at_risk(losses, percent / 100) == min(covering)


@given(samples, percents, st.floats(-5, 5), st.floats(0, 5))
def test_var_moves_and_scales_with_the_losses(losses, percent, shift, scale):
    var = value_at_risk(losses, percent / 100)
    changed = value_at_risk(scale * losses + shift, percent / 100)
    np.testing.assert_allclose(changed, scale * var + shift, atol=1e-12)


@given(samples, percents, st.randoms(use_true_random=False))
def test_order_of_the_samples_does_not_matter(losses, percent, random):
    shuffled = np.array(random.sample(losses.tolist(), len(losses)))
    expected = value_at_risk(losses, percent / 100)
    assert value_at_risk(shuffled, percent / 100) == expected


@given(samples)
def test_var_grows_with_alpha(losses):
    levels = [value_at_risk(losses, percent / 100) for percent in range(1, 100)]
    assert levels == sorted(levels)


def test_one_call_scores_all_queries_and_leaves_the_losses_alone():
    losses = np.random.default_rng(0).random((2, 3, 50))
    before = losses.copy()
    together = value_at_risk(losses, 0.9)
    apart = [[value_at_risk(row, 0.9) for row in block] for block in losses]
    np.testing.assert_array_equal(together, apart)
    np.testing.assert_array_equal(losses, before)


def test_var_of_many_samples_is_the_quantile_of_the_distribution():
    losses = np.random.default_rng(0).exponential(size=200_000)
    assert value_at_risk(losses, 0.95) == pytest.approx(-np.log(0.05), rel=0.01)
