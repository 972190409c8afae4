import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy.stats import binom

from tablesetting.irl.risk import (
    RiskConfig,
    conditional_value_at_risk,
    expected_value_difference,
    min_ess,
    normalized_evd,
    random_normalized_evd,
    spend,
    upper_bound_rank,
    value_at_risk,
    var_upper_bound,
)

samples = arrays(
    float, array_shapes(min_dims=1, max_dims=1, max_side=60), elements=st.floats(-9, 9)
)
percents = st.integers(1, 99)
many_samples = arrays(float, 200, elements=st.floats(-9, 9))
doubts = st.floats(0.001, 0.5)  # Of more than a half, a bound is below the estimate.
values = arrays(float, 5, elements=st.floats(-9, 9))


def test_risk_is_that_of_the_paper_unless_told():
    assert RiskConfig() == RiskConfig(alpha=0.95, delta=0.05, rank_offset=0)


@pytest.mark.parametrize("name", ["alpha", "delta"])
@pytest.mark.parametrize("value", [-0.1, 0.0, 1.0, 95.0, math.inf, math.nan])
def test_risk_at_no_probability_is_refused(name, value):
    with pytest.raises(ValueError, match=rf"`{name}` must be in \(0, 1\); got {value}"):
        RiskConfig(**{name: value})


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


@pytest.mark.parametrize("alpha", [0.0, 1.0, math.nan])
def test_every_measure_refuses_an_alpha_outside_the_open_unit_interval(alpha):
    message = rf"`alpha` must be in \(0, 1\); got {alpha}"
    with pytest.raises(ValueError, match=message):
        conditional_value_at_risk(np.ones(3), alpha)
    with pytest.raises(ValueError, match=message):
        var_upper_bound(np.ones(3), alpha, 0.05)
    with pytest.raises(ValueError, match=message):
        min_ess(alpha, 0.05)


@pytest.mark.parametrize("delta", [0.0, 1.0, -2.0, math.nan])
def test_every_bound_refuses_a_delta_outside_the_open_unit_interval(delta):
    message = rf"`delta` must be in \(0, 1\); got {delta}"
    with pytest.raises(ValueError, match=message):
        var_upper_bound(np.ones(3), 0.95, delta)
    with pytest.raises(ValueError, match=message):
        upper_bound_rank(100, 0.95, delta)
    with pytest.raises(ValueError, match=message):
        spend(delta, 1)


@pytest.mark.parametrize("measure", [conditional_value_at_risk, var_upper_bound])
def test_every_measure_refuses_no_samples(measure):
    delta = [0.05] if measure is var_upper_bound else []
    with pytest.raises(ValueError, match="no samples; draw at least one"):
        measure(np.empty((2, 0)), 0.95, *delta)


@pytest.mark.parametrize("ess", [0.0, -3.0, math.inf, math.nan])
def test_effective_sample_size_must_be_positive_and_finite(ess):
    with pytest.raises(ValueError, match=f"`ess` must be positive and .* got {ess}"):
        var_upper_bound(np.ones(100), 0.95, 0.05, ess=ess)


@pytest.mark.parametrize(
    ("alpha", "expected"),
    [(0.5, 3.5), (0.75, 4.0), (0.25, 3.0), (0.625, (0.5 * 3 + 4) / 1.5), (0.95, 4.0)],
)
def test_cvar_of_four_losses_by_hand(alpha, expected):
    losses = np.array([3.0, 1.0, 4.0, 2.0])
    assert conditional_value_at_risk(losses, alpha) == pytest.approx(expected)


@given(samples, percents)
def test_cvar_is_the_mean_of_the_worst_the_last_by_its_fraction(losses, percent):
    worst = np.sort(losses)[::-1]
    mass = (1 - percent / 100) * len(losses)
    weights = np.clip(mass - np.arange(len(losses)), 0.0, 1.0)
    cvar = conditional_value_at_risk(losses, percent / 100)
    np.testing.assert_allclose(cvar, weights @ worst / mass, atol=1e-12)


@given(samples, percents)
def test_cvar_is_the_least_of_the_objective_of_rockafellar_and_uryasev(losses, percent):
    alpha = percent / 100
    excesses = np.maximum(losses - losses[:, None], 0.0).mean(axis=1)
    objective = losses + excesses / (1 - alpha)
    cvar = conditional_value_at_risk(losses, alpha)
    np.testing.assert_allclose(cvar, objective.min(), atol=1e-12)


@given(samples, percents)
def test_cvar_lies_between_the_var_and_the_worst_loss(losses, percent):
    cvar = conditional_value_at_risk(losses, percent / 100)
    assert cvar >= value_at_risk(losses, percent / 100)
    assert cvar <= losses.max() + 1e-12


@given(samples, percents, st.floats(-5, 5), st.floats(0, 5))
def test_cvar_moves_and_scales_with_the_losses(losses, percent, shift, scale):
    cvar = conditional_value_at_risk(losses, percent / 100)
    changed = conditional_value_at_risk(scale * losses + shift, percent / 100)
    np.testing.assert_allclose(changed, scale * cvar + shift, atol=1e-10)


@given(samples)
def test_cvar_grows_with_alpha(losses):
    levels = [conditional_value_at_risk(losses, p / 100) for p in range(1, 100)]
    assert np.diff(levels).min() > -1e-12


def test_cvar_of_many_samples_is_that_of_the_distribution():
    losses = np.random.default_rng(0).exponential(size=200_000)
    cvar = conditional_value_at_risk(losses, 0.95)
    assert cvar == pytest.approx(1.0 - np.log(0.05), rel=0.02)


@pytest.mark.parametrize(
    "measure",
    [
        lambda losses: conditional_value_at_risk(losses, 0.9),
        lambda losses: var_upper_bound(losses, 0.9, 0.1),
        lambda losses: var_upper_bound(losses, 0.9, 0.1, ess=5.0),
    ],
    ids=["cvar", "bound", "no bound"],
)
def test_one_call_measures_all_queries_and_leaves_the_losses_alone(
    measure, monkeypatch
):
    losses = np.random.default_rng(0).random((2, 3, 50))
    before = losses.copy()
    apart = [[measure(row) for row in block] for block in losses]
    np.testing.assert_array_equal(measure(losses), apart)
    monkeypatch.setattr("tablesetting.irl.arrays._BLOCK_ELEMENTS", 100)
    np.testing.assert_array_equal(measure(losses), apart)
    np.testing.assert_array_equal(losses, before)
    assert measure(losses[:0]).shape == (0, 3)


@pytest.mark.parametrize(
    ("alpha", "delta", "expected"),
    [
        (0.95, 0.05, 59),
        (0.99, 0.05, 299),
        (0.99, 0.01, 459),
        (0.5, 0.25, 2),
        (0.1, 1e-5, 5),
        (0.9, 0.729, 3),
        (0.1, 1e-12, 12),
        (0.05, 0.9, 1),
        (0.9, 0.9, 1),
    ],
)
def test_fewest_draws_that_an_upper_bound_takes(alpha, delta, expected):
    assert min_ess(alpha, delta) == expected


@given(percents, st.floats(1e-12, 0.99))
def test_largest_of_the_fewest_draws_is_the_first_bound(percent, delta):
    fewest = min_ess(percent / 100, delta)
    assert upper_bound_rank(fewest, percent / 100, delta) is not None
    assert upper_bound_rank(fewest - 1, percent / 100, delta) is None


def test_ranks_by_hand():
    # Of three fair coins: P(B >= 1, 2, 3) = 7/8, 4/8, 1/8.
    ranks = [upper_bound_rank(3, 0.5, delta) for delta in (0.9, 0.5, 0.49, 0.125, 0.12)]
    assert ranks == [1, 2, 3, 3, None]
    assert upper_bound_rank(59, 0.95, 0.05) == 59
    assert upper_bound_rank(0, 0.95, 0.05) is None
    assert upper_bound_rank(-1, 0.95, 0.05) is None


@pytest.mark.parametrize("num_draws", [15, 4321, 999_999])
def test_rank_is_not_one_too_high_where_a_tail_is_delta_itself(num_draws):
    assert upper_bound_rank(num_draws, 0.5, 0.5) == (num_draws + 1) // 2


@pytest.mark.parametrize("alpha", [0.01, 0.3, 0.55, 0.75, 0.95, 0.999])
@pytest.mark.parametrize("num_draws", [1, 2, 5, 29, 59, 100, 300, 2500, 10**6])
def test_rank_is_the_least_whose_binomial_tail_is_within_delta(num_draws, alpha):
    for delta in (0.7, 0.3, 0.05, 0.01, 1e-4, 1e-8, 1e-12):
        rank = upper_bound_rank(num_draws, alpha, delta)
        enough = num_draws + 1 if rank is None else rank
        assert binom.sf(enough - 1, num_draws, alpha) <= delta
        assert enough == 1 or binom.sf(enough - 2, num_draws, alpha) > delta


@pytest.mark.parametrize("ess", [None, 59.0, 59.9, 1e4])
def test_bound_from_59_draws_is_the_largest(ess):
    losses = np.random.default_rng(0).permutation(np.arange(59.0))
    assert var_upper_bound(losses, 0.95, 0.05, ess=ess) == 58.0


def test_bound_from_too_few_draws_is_infinite():
    losses = np.zeros((2, 100))
    for ess in (0.5, 20.0, 58.9):
        bounds = var_upper_bound(losses, 0.95, 0.05, ess=ess)
        np.testing.assert_array_equal(bounds, [np.inf, np.inf])
    assert np.isinf(var_upper_bound(losses[:, :58], 0.95, 0.05)).all()


def test_rank_of_the_effective_draws_is_scaled_up_to_all_of_them():
    losses = np.arange(1.0, 1001.0)
    rank = upper_bound_rank(300, 0.95, 0.05)
    assert rank == 292
    bound = var_upper_bound(losses, 0.95, 0.05, ess=300.7)
    assert bound == math.ceil(292 / 300 * 1000) == 974.0


@given(many_samples, percents, doubts, st.integers(1, 300))
def test_bound_is_not_below_the_estimate(losses, percent, delta, ess):
    bound = var_upper_bound(losses, percent / 100, delta, ess=ess)
    assert bound >= value_at_risk(losses, percent / 100)


@given(many_samples, percents, doubts, st.floats(-5, 5), st.floats(0.1, 5))
def test_bound_moves_and_scales_with_the_losses(losses, percent, delta, shift, scale):
    bound = var_upper_bound(losses, percent / 100, delta)
    changed = var_upper_bound(scale * losses + shift, percent / 100, delta)
    np.testing.assert_allclose(changed, scale * bound + shift, atol=1e-12)


@given(many_samples, percents, doubts, doubts, st.integers(1, 200))
def test_bound_falls_as_it_may_miss_more_often(losses, percent, one, other, ess):
    sure, unsure = sorted((one, other))
    bound = var_upper_bound(losses, percent / 100, sure, ess=ess)
    assert bound >= var_upper_bound(losses, percent / 100, unsure, ess=ess)


@given(many_samples, percents, st.floats(0.001, 0.3), st.integers(1, 100))
def test_twice_the_effective_draws_never_raise_the_bound(losses, percent, delta, ess):
    bound = var_upper_bound(losses, percent / 100, delta, ess=ess)
    assert bound >= var_upper_bound(losses, percent / 100, delta, ess=2 * ess)


@given(percents, st.floats(0.001, 0.9), st.integers(2, 300))
def test_one_draw_more_raises_the_rank_by_one_at_most(percent, delta, num_draws):
    fewer = upper_bound_rank(num_draws - 1, percent / 100, delta)
    rank = upper_bound_rank(num_draws, percent / 100, delta)
    if fewer is not None:
        assert fewer <= rank <= fewer + 1


def coverage(draws, quantile, alpha, delta, **options):
    """Return the fraction of bounds that hold, and three standard errors less."""
    bounds = var_upper_bound(draws, alpha, delta, **options)
    error = math.sqrt(delta * (1 - delta) / len(draws))
    return np.mean(bounds >= quantile), 1 - delta - 3 * error


@pytest.mark.parametrize(("alpha", "delta"), [(0.95, 0.05), (0.9, 0.2), (0.5, 0.01)])
def test_bound_holds_with_the_promised_confidence_but_not_always(alpha, delta):
    draws = np.random.default_rng(0).random((2000, 300))
    held, promised = coverage(draws, alpha, alpha, delta)
    assert promised < held < 1.0


def test_bound_is_as_tight_as_the_order_statistics_allow():
    draws = np.random.default_rng(0).random((2000, 300))
    exact = binom.cdf(upper_bound_rank(300, 0.95, 0.05) - 1, 300, 0.95)
    held, _ = coverage(draws, 0.95, 0.95, 0.05)
    assert held == pytest.approx(exact, abs=0.015)


def test_bound_holds_where_losses_tie():
    draws = np.random.default_rng(0).integers(1, 11, (2000, 300)) / 10
    held, promised = coverage(draws, 0.9, 0.9, 0.05)
    assert held > promised


def test_bound_holds_where_every_draw_comes_three_times():
    draws = np.random.default_rng(0).random((2000, 100)).repeat(3, axis=1)
    held, promised = coverage(draws, 0.95, 0.95, 0.05, ess=100)
    assert promised < held < 1.0
    assert coverage(draws, 0.95, 0.95, 0.05)[0] < promised


def test_bound_holds_for_chains_by_their_effective_sample_size():
    rng, correlation = np.random.default_rng(0), 0.5
    steps = rng.normal(size=(300, 2000))
    for t in range(1, 300):
        steps[t] = correlation * steps[t - 1] + math.sqrt(0.75) * steps[t]
    ess = 300 * (1 - correlation) / (1 + correlation)
    held, promised = coverage(steps.T, 1.6448536, 0.95, 0.05, ess=ess)
    assert promised < held < 1.0
    assert coverage(steps.T, 1.6448536, 0.95, 0.05)[0] < promised


def test_shares_of_all_looks_sum_to_delta():
    assert [spend(0.06, look) for look in (1, 2, 3)] == [0.03, 0.01, 0.005]
    shares = [spend(0.05, look) for look in range(1, 10_001)]
    assert sum(shares) == pytest.approx(0.05 * (1 - 1 / 10_001), rel=1e-12)


@pytest.mark.parametrize("look", [0, -1])
def test_looks_count_from_one(look):
    with pytest.raises(ValueError, match=f"`look` must be at least 1, .* got {look}"):
        spend(0.05, look)


def test_value_differences_of_three_policies_by_hand():
    optimal, policy = np.array([4.0, 2.0, 1.0]), np.array([4.0, 1.0, -1.0])
    random = np.array([0.0, 0.0, 0.0])
    assert expected_value_difference(optimal, policy).tolist() == [0.0, 1.0, 2.0]
    assert normalized_evd(optimal, policy).tolist() == [0.0, 0.5, 2.0]
    assert random_normalized_evd(optimal, policy, random).tolist() == [0.0, 0.5, 2.0]
    assert random_normalized_evd(optimal, policy, random - 4.0)[1] == 1 / 6


@pytest.mark.parametrize("value", [0.0, -2.5, math.nan])
def test_evd_is_no_part_of_a_best_value_that_is_not_positive(value):
    optimal = np.array([[1.0, 3.0], [value, 2.0]])
    with pytest.raises(ValueError, match=f"got {value}. Use `random_normalized_evd`"):
        normalized_evd(optimal, optimal)


@given(values, values)
def test_normalized_evd_is_free_of_the_scale_of_the_reward(policy, gaps):
    optimal = np.maximum(policy, 0.0) + np.abs(gaps) + 0.1
    evd = normalized_evd(optimal, policy)
    np.testing.assert_allclose(normalized_evd(4 * optimal, 4 * policy), evd)


@given(values, values, values, st.floats(-5, 5), st.floats(0.1, 5))
def test_random_normalized_evd_is_free_of_shift_and_scale(
    optimal, losses, stakes, shift, scale
):
    triple = [optimal, optimal - np.abs(losses), optimal - np.abs(stakes) - 0.1]
    evd = random_normalized_evd(*triple)
    changed = random_normalized_evd(*(scale * part + shift for part in triple))
    np.testing.assert_allclose(changed, evd, atol=1e-10)


def test_nothing_is_lost_where_a_random_policy_is_as_good_as_the_best():
    optimal = np.array([1.0, 0.0, -3.0, 0.3])
    random = np.array([1.0, 0.0, -3.0, 0.1 + 0.1 + 0.1])  # A little over 0.3.
    evd = random_normalized_evd(optimal, np.minimum(optimal, random), random)
    np.testing.assert_array_equal(evd, np.zeros(4))
    swapped = random_normalized_evd(random, optimal, optimal)
    np.testing.assert_array_equal(swapped, np.zeros(4))
