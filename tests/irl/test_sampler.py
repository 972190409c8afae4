import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.sampler import (
    McmcConfig,
    _ProposalScale,
    run_chains,
    sample_uniform_weights,
)

DIM = 13  # Weights of the vase task.
FLAT = McmcConfig(num_chains=200, num_steps=6000, burn_in=3000)
FIXED_STEP = replace(FLAT, target_acceptance=None)
PAPER_CHAIN = replace(FIXED_STEP, is_prior_uniform=False)

# Magnitudes of a uniform point of the L1 sphere are Dirichlet(1, ..., 1): spacings.
SPARSE = DIM * 0.6 ** (DIM - 1) - math.comb(DIM, 2) * 0.2 ** (DIM - 1)
MEAN_LARGEST = sum(1 / k for k in range(1, DIM + 1)) / DIM
MEAN_SQUARE = 2 / (DIM * (DIM + 1))


def flat(weights):
    return np.zeros(len(weights))


def tilted(weights):
    """A smooth target that favours one edge of the L1 sphere."""
    return 3.0 * weights[:, 0] - 8.0 * (weights[:, -1] - 0.4) ** 2


def largest(weights):
    return np.abs(weights).max(axis=-1)


def sample_flat(config):
    start = np.tile(np.eye(DIM)[0], (config.num_chains, 1))
    chains = run_chains(flat, start, config, rng=np.random.default_rng(0))
    return chains.weights


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"num_chains": 0}, "`num_chains` must be at least 1; got 0"),
        ({"thin": 0}, "`thin` must be at least 1; got 0"),
        ({"burn_in": 100, "num_steps": 100}, "got burn_in=100 with num_steps=100"),
        ({"burn_in": -1}, "got burn_in=-1"),
        ({"step_std": 0.0}, "`step_std` must be positive; got 0.0"),
        ({"step_std": math.nan}, "`step_std` must be positive; got nan"),
    ],
)
def test_settings_without_meaning_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        McmcConfig(**setting)


def test_direct_draws_are_uniform_on_the_sphere():
    weights = sample_uniform_weights(100_000, DIM, rng=np.random.default_rng(0))
    np.testing.assert_allclose(np.abs(weights).sum(axis=1), 1.0)
    assert np.mean(largest(weights) > 0.4) == pytest.approx(SPARSE, abs=0.002)
    assert largest(weights).mean() == pytest.approx(MEAN_LARGEST, abs=0.001)
    assert np.mean(weights > 0) == pytest.approx(0.5, abs=0.002)


@pytest.mark.parametrize("config", [FLAT, FIXED_STEP], ids=["adapted", "fixed"])
def test_chain_has_a_uniform_prior(config):
    weights = sample_flat(config)
    assert np.mean(largest(weights) > 0.4) == pytest.approx(SPARSE, abs=0.004)
    assert largest(weights).mean() == pytest.approx(MEAN_LARGEST, abs=0.002)
    assert np.square(weights).mean() == pytest.approx(MEAN_SQUARE, abs=1e-4)
    np.testing.assert_allclose(weights.mean(axis=(0, 1)), 0.0, atol=0.01)


def test_chain_of_the_paper_shuns_sparse_weights():
    assert np.mean(largest(sample_flat(PAPER_CHAIN)) > 0.4) < 0.003 < SPARSE / 5


@pytest.mark.parametrize("target_acceptance", [0.15, 0.4])
def test_proposals_adapt_to_the_acceptance_that_is_asked_for(target_acceptance):
    config = McmcConfig(
        num_steps=6000, burn_in=3000, target_acceptance=target_acceptance
    )
    rng = np.random.default_rng(0)

    def log_likelihood(weights):
        return -100.0 * np.square(weights - [0.4, -0.3, 0.2, 0.1]).sum(axis=1)

    start = sample_uniform_weights(config.num_chains, 4, rng=rng)
    chains = run_chains(log_likelihood, start, config, rng=rng)
    assert chains.acceptance_rate == pytest.approx(target_acceptance, abs=0.04)


@pytest.mark.parametrize("target_acceptance", [0.234, None])
def test_chain_in_two_dimensions_follows_the_target_density(target_acceptance):
    # The L1 circle is a square on its tip: four straight sides of equal measure.
    side = (np.arange(1000) + 0.5) / 1000
    quarter = np.stack([1 - side, side], axis=1)
    circle = np.concatenate([quarter * s for s in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
    density = np.exp(tilted(circle))
    expected = density.reshape(16, 250).sum(axis=1) / density.sum()

    config = McmcConfig(
        num_chains=200,
        num_steps=2500,
        burn_in=500,
        step_std=0.5,
        target_acceptance=target_acceptance,
    )
    rng = np.random.default_rng(0)
    start = sample_uniform_weights(config.num_chains, 2, rng=rng)
    x, y = run_chains(tilted, start, config, rng=rng).weights.reshape(-1, 2).T
    side_index = np.where(y > 0, np.where(x > 0, 0, 1), np.where(x < 0, 2, 3))
    along = side_index + np.abs(y)
    found = np.histogram(along, bins=16, range=(0, 4))[0] / along.size
    np.testing.assert_allclose(found, expected, atol=0.005)


@pytest.mark.parametrize("target_acceptance", [0.234, None])
def test_chain_in_three_dimensions_has_the_moments_of_the_target(target_acceptance):
    rng = np.random.default_rng(0)
    draws = sample_uniform_weights(400_000, 3, rng=rng)
    probabilities = np.exp(tilted(draws))
    probabilities /= probabilities.sum()
    config = McmcConfig(
        num_chains=200,
        num_steps=2000,
        burn_in=500,
        step_std=0.3,
        target_acceptance=target_acceptance,
    )
    chains = run_chains(tilted, draws[: config.num_chains], config, rng=rng)
    found = chains.weights.reshape(-1, 3)
    for power in (1, 2):
        expected = probabilities @ draws**power
        np.testing.assert_allclose((found**power).mean(axis=0), expected, atol=0.01)


@given(st.integers(0, 2**32), st.booleans(), st.sampled_from([None, 0.234]))
def test_every_state_is_on_the_sphere_with_its_own_log_posterior(
    seed, is_prior_uniform, target_acceptance
):
    config = McmcConfig(
        num_chains=3,
        num_steps=40,
        burn_in=10,
        is_prior_uniform=is_prior_uniform,
        target_acceptance=target_acceptance,
    )
    rng = np.random.default_rng(seed)
    start = sample_uniform_weights(3, 4, rng=rng)
    chains = run_chains(tilted, start, config, rng=rng)
    assert chains.weights.shape == (3, 30, 4)
    np.testing.assert_allclose(np.abs(chains.weights).sum(axis=2), 1.0)
    expected = tilted(chains.weights.reshape(-1, 4)).reshape(3, 30)
    np.testing.assert_allclose(chains.log_posts, expected)
    assert 0.0 <= chains.acceptance_rate <= 1.0
    best = tilted(chains.best_weights[None])[0]
    assert best >= chains.log_posts.max() - 1e-12


def test_best_weights_may_come_from_the_burn_in():
    config = McmcConfig(num_chains=2, num_steps=60, burn_in=59)
    start = sample_uniform_weights(2, 4, rng=np.random.default_rng(0))
    all_steps = replace(config, burn_in=0, target_acceptance=None)
    late = replace(config, target_acceptance=None)
    whole = run_chains(tilted, start, all_steps, rng=np.random.default_rng(1))
    cut = run_chains(tilted, start, late, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(cut.best_weights, whole.best_weights)
    assert whole.log_posts.max() > cut.log_posts.max()


def test_same_seed_gives_the_same_chain_and_another_seed_another():
    config = McmcConfig(num_chains=2, num_steps=600, burn_in=300)
    start = sample_uniform_weights(2, 5, rng=np.random.default_rng(0))
    first, again, other = (
        run_chains(tilted, start, config, rng=np.random.default_rng(seed)).weights
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_impossible_weights_are_never_visited():
    def only_positive_first(weights):
        return np.where(weights[:, 0] > 0.0, 0.0, -np.inf)

    config = McmcConfig(num_chains=4, num_steps=500, burn_in=0, step_std=0.3)
    start = np.tile([1.0, 0.0, 0.0], (4, 1))
    rng = np.random.default_rng(0)
    chains = run_chains(only_positive_first, start, config, rng=rng)
    assert (chains.weights[..., 0] > 0.0).all()


@pytest.mark.parametrize("step_std", [1e-3, 0.05, 5.0])
def test_burn_in_adapts_the_acceptance_to_its_target(step_std):
    config = McmcConfig(num_steps=4000, burn_in=2000, step_std=step_std)
    rng = np.random.default_rng(0)
    start = sample_uniform_weights(config.num_chains, DIM, rng=rng)
    chains = run_chains(lambda w: 40.0 * w[:, 0], start, config, rng=rng)
    assert chains.acceptance_rate == pytest.approx(0.234, abs=0.08)


def test_proposals_take_the_shape_of_what_was_visited():
    rng = np.random.default_rng(0)
    shape = np.array([[1.0, 0.0, 0.0], [0.9, 0.3, 0.0], [-0.5, 0.2, 0.1]])
    visited = rng.standard_normal((20_000, 2, 3)) @ shape.T
    scale = _ProposalScale(McmcConfig(num_chains=2), 2, 3)
    scale._reshape(visited)
    steps = scale.propose(50_000, rng=rng).steps
    expected = 2.38**2 / 3 * shape @ shape.T
    found = np.cov(steps.reshape(-1, 3), rowvar=False)
    np.testing.assert_allclose(found, expected, atol=0.03)


def test_acceptance_is_counted_after_the_burn_in_alone():
    """All is as likely for the start and ten steps; then nothing new is likely at all."""
    calls = iter([0.0] * 11 + [-np.inf] * 10)
    config = McmcConfig(
        num_chains=2,
        num_steps=20,
        burn_in=10,
        target_acceptance=None,
        is_prior_uniform=False,
    )
    rng = np.random.default_rng(0)
    start = sample_uniform_weights(2, 3, rng=rng)
    chains = run_chains(lambda w: np.full(len(w), next(calls)), start, config, rng=rng)
    assert chains.acceptance_rate == 0.0
    assert not np.array_equal(chains.weights[:, 0], start)


def test_longer_steps_are_accepted_less_often():
    rates = []
    for step_std in (0.01, 0.05, 0.2):
        config = replace(FIXED_STEP, num_chains=20, num_steps=500, burn_in=0)
        config = replace(config, step_std=step_std)
        rng = np.random.default_rng(0)
        start = sample_uniform_weights(20, DIM, rng=rng)
        rates.append(run_chains(flat, start, config, rng=rng).acceptance_rate)
    assert rates == sorted(rates, reverse=True)
    assert rates[0] > 0.8
