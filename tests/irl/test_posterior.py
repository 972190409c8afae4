from dataclasses import replace

import numpy as np
import pytest

from tablesetting.irl.arrays import normalize_l1
from tablesetting.irl.posterior import climb_to_map, infer_posterior
from tablesetting.irl.sampler import McmcConfig, run_chains, sample_uniform_weights

SHORT = McmcConfig(num_chains=3, num_steps=100, burn_in=20, thin=7)
PAPER_LIKE = McmcConfig(
    num_chains=1,
    num_steps=2500,
    burn_in=0,
    thin=25,
    target_acceptance=None,
    is_prior_uniform=False,
    num_map_steps=0,
    starts_at_map=True,
)


def peaked(weights):
    """A posterior around (0.6, -0.3, 0.1)."""
    return -200.0 * np.square(weights - [0.6, -0.3, 0.1]).sum(axis=1)


def infer(config, *, previous_map=None, seed=0):
    rng = np.random.default_rng(seed)
    return infer_posterior(peaked, 3, config, previous_map=previous_map, rng=rng)


def test_samples_are_every_thinned_step_of_every_chain():
    posterior = infer(SHORT)
    rng = np.random.default_rng(0)
    chains = run_chains(peaked, sample_uniform_weights(3, 3, rng=rng), SHORT, rng=rng)
    expected = np.concatenate([chain[6::7] for chain in chains.weights])
    assert len(expected) == 3 * (80 // 7)
    np.testing.assert_array_equal(posterior.weights, expected)
    np.testing.assert_allclose(posterior.log_posts, peaked(posterior.weights))


def test_the_papers_chain_gives_100_samples():
    assert infer(PAPER_LIKE).weights.shape == (100, 3)


def test_no_sample_is_more_probable_than_the_map():
    posterior = infer(SHORT)
    assert peaked(posterior.map_weights[None])[0] >= posterior.log_posts.max()


def test_the_papers_map_is_the_best_sample_visited():
    posterior = infer(replace(PAPER_LIKE, thin=1))
    best = posterior.log_posts.argmax()
    np.testing.assert_array_equal(posterior.map_weights, posterior.weights[best])


@pytest.mark.parametrize("mode", [(0.6, -0.3, 0.1), (1.0, 0.0, 0.0), (0.0, -0.5, 0.5)])
def test_the_search_climbs_from_a_good_sample_to_the_mode(mode):
    """On a face of the L1 sphere, at its vertex and on an edge."""
    rng = np.random.default_rng(0)

    def log_likelihood(weights):
        return -50.0 * np.square(weights - mode).sum(axis=1)

    for noise in rng.normal(0.0, 0.1, (10, 3)):
        start = normalize_l1(mode + noise)
        found = climb_to_map(log_likelihood, start, 200, rng=rng)
        assert np.abs(found).sum() == pytest.approx(1.0)
        np.testing.assert_allclose(found, mode, atol=1e-3)


def test_default_chains_mix_on_an_easy_target():
    posterior = infer(McmcConfig())
    assert posterior.ess >= 400
    assert posterior.rhat <= 1.01
    np.testing.assert_allclose(posterior.map_weights, [0.6, -0.3, 0.1], atol=0.02)


@pytest.mark.parametrize("dim", [2, 3, 5])
def test_default_chains_mix_where_nothing_is_known(dim):
    posterior = infer_posterior(
        lambda weights: np.zeros(len(weights)),
        dim,
        McmcConfig(),
        previous_map=None,
        rng=np.random.default_rng(0),
    )
    assert posterior.weights.shape == (400, dim)
    assert posterior.ess >= 400
    assert posterior.rhat <= 1.01


def test_chain_starts_next_to_the_previous_map_when_asked():
    previous_map = np.array([0.6, -0.3, 0.1])
    config = replace(PAPER_LIKE, num_steps=4, thin=1, step_std=1e-6)
    posterior = infer(config, previous_map=previous_map)
    near = np.tile(previous_map, (4, 1))
    np.testing.assert_allclose(posterior.weights, near, atol=1e-4)


def test_chain_starts_anywhere_without_a_previous_map():
    config = replace(PAPER_LIKE, num_steps=4, thin=1, step_std=1e-6)
    starts = [infer(config, seed=seed).weights[0] for seed in range(20)]
    assert np.ptp(starts, axis=0).min() > 0.5


def test_previous_map_does_not_matter_to_chains_that_start_at_the_prior():
    first = infer(SHORT, previous_map=np.array([0.6, -0.3, 0.1])).weights
    np.testing.assert_array_equal(first, infer(SHORT).weights)


@pytest.mark.parametrize("seed", [0, 1])
def test_inference_is_repeatable(seed):
    once, again = infer(SHORT, seed=seed), infer(SHORT, seed=seed)
    np.testing.assert_array_equal(once.weights, again.weights)
    assert once.ess == again.ess
    assert once.rhat == again.rhat
