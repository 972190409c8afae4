import math

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
import scipy.special
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.diagnostics import (
    _rhat,
    _split,
    bulk_ess,
    effective_sample_size,
    rank_normalize,
    rank_normalized_rhat,
    tail_ess,
)


def split_rhat(chains):
    """The comparison of half-chains without ranks, which can be worked by hand."""
    return _rhat(_split(chains))


RHATS = (split_rhat, rank_normalized_rhat)
ESSES = (effective_sample_size, bulk_ess, tail_ess)
DIAGNOSTICS = (*RHATS, *ESSES)

SHAPES = st.tuples(st.integers(1, 3), st.integers(4, 12), st.integers(1, 2))
STATES = hnp.arrays(np.int64, SHAPES, elements=st.integers(-6, 6)).map(np.float64)
"""Small whole numbers: monotone functions keep them apart, and many are equal."""
INCREASING = st.sampled_from([np.exp, np.arctan, np.cbrt, lambda x: x**3 + x])
ODD = st.sampled_from([np.arctan, np.sinh, lambda x: x**3])


def golden_chains():
    """Draw 4 chains of 200 steps for each entry of GOLDEN."""
    rng = np.random.default_rng(2021)
    noise = rng.standard_normal((4, 200))
    mixing = noise.copy()
    for step in range(1, 200):
        mixing[:, step] = 0.6 * mixing[:, step - 1] + 0.8 * noise[:, step]
    places = np.arange(4.0)[:, None]
    return {
        "independent": noise,
        "mixing": mixing,
        "drifting": mixing + np.linspace(0.0, 0.7, 200),
        "apart": mixing + 0.1 * places,
        "of_other_spread": noise * (1.0 + 0.3 * places),
        "heavy_tailed": rng.standard_cauchy((4, 200)),
        "with_ties": np.round(mixing),
        "alternating": noise - 0.7 * np.roll(noise, 1, axis=1),
        "of_odd_length": mixing[:, :199],
        "two_short_ones": mixing[:2, :20],
    }


# By ArviZ 0.23.4: rhat(method="split"), rhat(method="rank"), ess(method=...) of "mean",
# "bulk" and "tail".
GOLDEN = {
    "independent": (0.997520235, 1.00074168, 799.750102, 793.984469, 810.506068),
    "mixing": (1.00415152, 1.00436885, 217.191112, 215.845645, 418.206481),
    "drifting": (1.01969087, 1.01966113, 135.347487, 132.602305, 362.780237),
    "apart": (1.01123787, 1.01120686, 198.279918, 198.287829, 414.091106),
    "of_other_spread": (0.997255267, 1.04713313, 772.249429, 766.448835, 535.698417),
    "heavy_tailed": (0.997743783, 1.0004398, 716.839913, 775.836706, 861.649564),
    "with_ties": (1.00356735, 1.00348847, 234.825409, 235.079543, 414.812364),
    "alternating": (0.995197742, 1.00268823, 2322.47199, 2322.47199, 901.887029),
    "of_odd_length": (1.0034743, 1.00366358, 217.265682, 215.534262, 415.292293),
    "two_short_ones": (1.06232824, 1.05065681, 20.1174259, 24.2109717, 22.4438903),
}


def ar1_chains(correlation, num_chains, num_steps, *, seed=0):
    """Draw x' = a x + sqrt(1 - a^2) noise from its stationary distribution."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((num_chains, num_steps, 1))
    chains = noise.copy()
    for step in range(1, num_steps):
        fresh = math.sqrt(1 - correlation**2) * noise[:, step]
        chains[:, step] = correlation * chains[:, step - 1] + fresh
    return chains


def test_independent_draws_are_worth_their_number():
    chains = np.random.default_rng(0).standard_normal((4, 2000, 1))
    assert effective_sample_size(chains) == pytest.approx(8000, rel=0.15)


@pytest.mark.parametrize("correlation", [0.5, 0.9, 0.98])
def test_ess_of_an_autoregressive_chain_is_its_closed_form(correlation):
    chains = ar1_chains(correlation, num_chains=8, num_steps=20_000)
    expected = 160_000 * (1 - correlation) / (1 + correlation)
    assert effective_sample_size(chains) == pytest.approx(expected, rel=0.15)


def test_ess_equals_the_plain_sum_of_autocorrelations():
    chains = ar1_chains(0.8, num_chains=2, num_steps=400)
    halves = [chain[part] for chain in chains[..., 0] for part in np.s_[:200, 200:]]
    length = len(halves[0])
    within = np.mean([half.var(ddof=1) for half in halves])
    pooled = within * (length - 1) / length + np.var([h.mean() for h in halves], ddof=1)

    def correlation(lag):
        centered = [half - half.mean() for half in halves]
        product = np.mean([np.sum(c[: length - lag] * c[lag:]) for c in centered])
        return 1 - (within - product / length) / pooled

    time, last_pair = -1.0, math.inf
    for lag in range(0, length, 2):
        even = 1.0 if lag == 0 else correlation(lag)
        pair = even + correlation(lag + 1)
        if pair < 0:
            time += max(even, 0)
            break
        last_pair = min(pair, last_pair)
        time += 2 * last_pair
    expected = len(halves) * length / time
    assert effective_sample_size(chains) == pytest.approx(expected, rel=1e-9)


def test_ess_never_exceeds_the_number_of_states():
    chains = ar1_chains(-0.9, num_chains=2, num_steps=500)
    assert effective_sample_size(chains) == 1000.0


def test_rhat_of_two_short_chains_by_hand():
    chains = np.array([[0.0, 2.0, 0.0, 2.0], [4.0, 6.0, 4.0, 6.0]])[..., None]
    # Halves of length 2 with variance 2 and means 1, 1, 5, 5: B = 2 * 16 / 3.
    assert split_rhat(chains) == pytest.approx(math.sqrt(0.5 + (32 / 3) / 2 / 2))


def test_rhat_of_independent_draws_is_one():
    chains = np.random.default_rng(0).standard_normal((4, 2000, 3))
    assert split_rhat(chains) == pytest.approx(1.0, abs=0.005)


def test_rhat_of_chains_in_different_places_is_large():
    chains = np.random.default_rng(0).standard_normal((4, 500, 1))
    chains += 5.0 * np.arange(4)[:, None, None]
    assert split_rhat(chains) > 3.0
    assert effective_sample_size(chains) < 8.0


def test_rhat_sees_one_chain_that_drifts():
    drift = np.linspace(0.0, 6.0, 1000)[None, :, None]
    chains = np.random.default_rng(0).standard_normal((1, 1000, 1)) + drift
    assert split_rhat(chains) > 1.5


@pytest.mark.parametrize("measure", [*RHATS, effective_sample_size, bulk_ess])
def test_shift_and_scale_of_the_states_do_not_matter(measure):
    chains = ar1_chains(0.7, num_chains=3, num_steps=300)
    assert measure(5.0 - 3.0 * chains) == pytest.approx(measure(chains), rel=1e-9)


def test_chains_that_stand_still_apart_have_not_mixed():
    chains = np.zeros((2, 10, 1))
    chains[1] = 1.0
    assert split_rhat(chains) == math.inf


def test_chains_that_stand_still_are_worth_one_draw():
    chains = np.zeros((2, 10, 1))
    assert split_rhat(chains) == 1.0
    assert effective_sample_size(chains) == 1.0


def test_one_dimension_that_stands_still_leaves_the_verdict_to_the_others():
    chains = np.random.default_rng(0).standard_normal((2, 200, 2)) * [1.0, 0.0]
    assert split_rhat(chains) == split_rhat(chains[..., :1])
    assert effective_sample_size(chains) == 1.0


@pytest.mark.parametrize("name", GOLDEN)
def test_diagnostics_equal_those_of_arviz(name):
    chains = golden_chains()[name][..., None]
    rhats, sizes = GOLDEN[name][:2], GOLDEN[name][2:]
    # Ours stay at 1 at least, and at the number of states at most.
    expected = [max(rhat, 1.0) for rhat in rhats]
    expected += [min(size, chains.size) for size in sizes]
    ours = [measure(chains) for measure in DIAGNOSTICS]
    np.testing.assert_allclose(ours, expected, rtol=1e-8)


@pytest.mark.parametrize("measure", DIAGNOSTICS)
def test_every_diagnostic_is_that_of_the_worst_dimension(measure):
    chains = np.stack(list(golden_chains().values())[:6], axis=2)
    worst = max if measure in RHATS else min
    each = [measure(chains[..., [d]]) for d in range(6)]
    assert measure(chains) == pytest.approx(worst(each), rel=1e-12)


def test_rank_normalization_by_hand():
    chains = np.array([[[30.0], [-2.0]], [[7.0], [7.0]]])
    ranks = np.array([[[4.0], [1.0]], [[2.5], [2.5]]])
    expected = scipy.stats.norm.ppf((ranks - 3 / 8) / (4 + 1 / 4))
    np.testing.assert_allclose(rank_normalize(chains), expected, atol=1e-15)


@given(STATES)
def test_ranks_are_those_of_scipy(chains):
    ranks = scipy.stats.rankdata(chains.reshape(-1, chains.shape[2]), axis=0)
    probabilities = (ranks - 3 / 8) / (len(ranks) + 1 / 4)
    expected = scipy.special.ndtri(probabilities).reshape(chains.shape)
    np.testing.assert_allclose(rank_normalize(chains), expected, atol=1e-14)


@given(STATES, INCREASING)
def test_bulk_and_tail_know_only_the_order_of_the_draws(chains, increasing):
    for measure in (bulk_ess, tail_ess):
        assert measure(increasing(chains)) == measure(chains)


@given(STATES, ODD)
def test_rhat_knows_only_the_order_of_the_draws_and_of_their_distances(chains, odd):
    mirrored = np.concatenate([chains, -chains])  # The median is 0, and stays it.
    assert rank_normalized_rhat(odd(mirrored)) == rank_normalized_rhat(mirrored)


@given(STATES)
def test_diagnostics_stay_in_their_range(chains):
    num_states = chains.shape[0] * chains.shape[1]
    assert all(measure(chains) >= 1.0 for measure in RHATS)
    assert all(1.0 <= measure(chains) <= num_states for measure in ESSES)


@pytest.mark.parametrize("correlation", [0.5, 0.9])
def test_bulk_ess_of_an_autoregressive_chain_is_its_closed_form(correlation):
    chains = ar1_chains(correlation, num_chains=8, num_steps=20_000)
    expected = 160_000 * (1 - correlation) / (1 + correlation)
    assert bulk_ess(chains) == pytest.approx(expected, rel=0.15)
    assert bulk_ess(np.exp(5.0 * chains)) == bulk_ess(chains)


@pytest.mark.parametrize("correlation", [0.5, 0.9])
def test_tail_ess_of_an_autoregressive_chain_is_its_closed_form(correlation):
    """Mehler's formula: the indicator is a sum of Hermite polynomials of the state."""
    threshold = scipy.stats.norm.ppf(0.05)
    degrees = np.arange(1, 60)
    hermite = scipy.special.eval_hermitenorm(degrees - 1, threshold)
    parts = np.square(hermite) / scipy.special.factorial(degrees)
    parts *= scipy.stats.norm.pdf(threshold) ** 2 / (0.05 * 0.95)
    powers = correlation**degrees
    time = 1.0 + 2.0 * np.sum(parts * powers / (1.0 - powers))
    chains = ar1_chains(correlation, num_chains=8, num_steps=20_000)
    assert tail_ess(chains) == pytest.approx(160_000 / time, rel=0.15)


def test_rhat_sees_chains_of_one_mean_and_different_spreads():
    chains = np.random.default_rng(0).standard_normal((4, 1000, 1))
    chains[3] *= 4.0
    assert split_rhat(chains) < 1.01
    assert rank_normalized_rhat(chains) > 1.1
    assert tail_ess(chains) < 0.1 * bulk_ess(chains)


def test_rhat_sees_heavy_tails_in_different_places():
    """Of a Cauchy distribution neither mean nor variance exist."""
    chains = np.random.default_rng(0).standard_cauchy((4, 1000, 1))
    assert rank_normalized_rhat(chains) < 1.01
    assert bulk_ess(chains) == pytest.approx(4000, rel=0.15)
    chains[0] += 2.0
    assert split_rhat(chains) < 1.01
    assert rank_normalized_rhat(chains) > 1.05


def test_tail_ess_of_coin_throws_is_that_of_their_mean():
    """No draw lies above the 95 % quantile, 1, so those below it are counted."""
    ones_and_zeros = np.random.default_rng(0).integers(0, 2, (4, 200, 1)) * 1.0
    expected = effective_sample_size(ones_and_zeros)
    assert tail_ess(ones_and_zeros) == pytest.approx(expected)


@pytest.mark.parametrize("outlier", [0.0, 2.0])
def test_tail_ess_where_nearly_all_draws_are_equal_is_that_of_the_others(outlier):
    chains = np.ones((2, 400, 1))
    chains[:, 150:153] = outlier  # Less than 5 %, all at once.
    expected = effective_sample_size(chains)
    assert tail_ess(chains) == pytest.approx(expected)
    assert expected < 0.5 * chains.size


@pytest.mark.parametrize("place", [0.0, 0.1, -1.0 / 3.0])
def test_chains_that_stand_still_together_agree_and_are_worth_one_draw(place):
    chains = np.full((3, 11, 2), place)
    assert [measure(chains) for measure in RHATS] == [1.0, 1.0]
    assert [measure(chains) for measure in ESSES] == [1.0, 1.0, 1.0]


def test_chains_that_stand_still_in_uneven_places_have_not_mixed():
    chains = np.full((3, 11, 1), 0.1) * np.array([1.0, 3.0, 3.0])[:, None, None]
    assert [measure(chains) for measure in RHATS] == [math.inf, math.inf]
    assert all(1.0 <= measure(chains) <= 6.0 for measure in ESSES)
