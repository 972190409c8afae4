import math

import numpy as np
import pytest

from tablesetting.irl.diagnostics import effective_sample_size, split_rhat


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
            break
        last_pair = min(pair, last_pair)
        time += 2 * last_pair
    expected = len(halves) * length / time
    assert effective_sample_size(chains) == pytest.approx(expected, rel=1e-9)


def test_ess_never_exceeds_the_number_of_states():
    chains = ar1_chains(-0.9, num_chains=2, num_steps=500)
    assert effective_sample_size(chains) == 1000.0


def test_worst_dimension_decides():
    good = np.random.default_rng(0).standard_normal((4, 2000, 1))
    bad = ar1_chains(0.95, num_chains=4, num_steps=2000)
    both = np.concatenate([good, bad], axis=2)
    assert effective_sample_size(both) == effective_sample_size(bad)
    assert split_rhat(both) == max(split_rhat(good), split_rhat(bad))


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


@pytest.mark.parametrize("measure", [split_rhat, effective_sample_size])
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
