import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chisquare

from tablesetting.irl.arrays import normalize_l1
from tablesetting.irl.posterior import (
    Posterior,
    infer_posterior,
    mix_posteriors,
)
from tablesetting.irl.random_walk import RandomWalk
from tablesetting.irl.sampler import (
    Diagnosis,
    LogNormal,
    McmcConfig,
    run_chains,
    sample_uniform_weights,
)

SHORT = McmcConfig(num_chains=3, num_steps=100, burn_in=20, num_samples=33)
PAPER_LIKE = McmcConfig(
    num_chains=1,
    num_steps=2500,
    burn_in=0,
    num_particles=0,
    num_samples=100,
    target_ess=None,
    target_acceptance=None,
    is_prior_uniform=False,
    num_map_steps=0,
    starts_at_map=True,
)
PEAK = np.array([0.6, -0.3, 0.1])


def flat(weights):
    return np.zeros(len(weights))


def peaked(weights):
    return -200.0 * np.square(weights - PEAK).sum(axis=1)


def infer(config, *, log_likelihood=peaked, seed=0, **settings):
    rng = np.random.default_rng(seed)
    return infer_posterior(log_likelihood, 3, config, rng=rng, **settings)


class OfScale:
    """A likelihood that steps by itself, and has a scale beside its weights."""

    def __call__(self, states):
        return peaked(states[:, :3]) - 2.0 * np.square(states[:, 3])

    def mover(self, config):
        return RandomWalk(self, 3, config, LogNormal(median=1.0, spread=0.5))


@pytest.mark.parametrize("num_samples", [33, 80, 3, 100])
def test_samples_are_evenly_spread_over_every_chain(num_samples):
    config = replace(SHORT, num_samples=num_samples)
    posterior = infer(config)
    chains = run_chains(
        RandomWalk(peaked, 3, config), config, rng=np.random.default_rng(0)
    )
    num_each = num_samples // 3
    stride = 80 // num_each
    rows = stride * np.arange(1, num_each + 1) - 1
    expected = np.concatenate([chains.states[rows, chain] for chain in range(3)])
    np.testing.assert_array_equal(posterior.weights, expected)
    np.testing.assert_allclose(posterior.log_posts, peaked(posterior.weights))
    assert posterior.num_chains == 3
    assert posterior.log_evidence == chains.log_evidence


def test_the_papers_chain_gives_100_samples():
    assert infer(PAPER_LIKE).weights.shape == (100, 3)


def test_no_sample_is_more_probable_than_the_map():
    posterior = infer(SHORT)
    assert peaked(posterior.map_weights[None])[0] >= posterior.log_posts.max()


def test_the_papers_map_is_the_best_sample_visited():
    posterior = infer(replace(PAPER_LIKE, num_samples=2500))
    best = posterior.log_posts.argmax()
    np.testing.assert_array_equal(posterior.map_weights, posterior.weights[best])


def test_mean_weights_are_the_scaled_mean_of_all_that_was_visited():
    posterior = infer(replace(SHORT, num_samples=3 * 80))
    assert len(posterior.weights) == 3 * 80
    expected = normalize_l1(posterior.weights.mean(axis=0))
    np.testing.assert_allclose(posterior.mean_weights, expected)
    fewer = infer(SHORT)
    np.testing.assert_array_equal(fewer.mean_weights, posterior.mean_weights)


def test_robot_acts_on_the_guess_that_is_asked_for():
    by_map, by_mean = (infer(SHORT, guess=guess) for guess in ("map", "mean"))
    np.testing.assert_array_equal(by_map.guessed_weights, by_map.map_weights)
    np.testing.assert_array_equal(by_mean.guessed_weights, by_mean.mean_weights)
    assert not np.array_equal(by_map.guessed_weights, by_map.mean_weights)


def test_the_climb_is_spared_where_the_robot_does_not_act_on_the_map():
    by_map, by_mean = (infer(SHORT, guess=guess) for guess in ("map", "mean"))
    reached = peaked(np.array([by_mean.map_weights, by_map.map_weights]))
    assert reached[0] < reached[1]
    np.testing.assert_array_equal(by_map.weights, by_mean.weights)


def test_default_chains_mix_on_an_easy_target():
    posterior = infer(McmcConfig())
    assert posterior.is_sound
    assert posterior.ess >= 400
    assert posterior.rhat <= 1.01
    np.testing.assert_allclose(posterior.map_weights, PEAK, atol=0.02)


@pytest.mark.parametrize("dim", [2, 3, 5])
def test_default_chains_mix_where_nothing_is_known(dim):
    posterior = infer_posterior(flat, dim, McmcConfig(), rng=np.random.default_rng(0))
    assert posterior.weights.shape == (400, dim)
    assert posterior.is_sound
    assert posterior.ess >= 400
    assert posterior.rhat <= 1.01
    assert posterior.log_evidence == pytest.approx(0.0)


def test_a_posterior_of_spent_steps_is_not_sound():
    posterior = infer(SHORT)
    assert not posterior.is_sound
    assert posterior.ess < 400


def test_effective_sample_size_is_the_smaller_of_bulk_and_tail():
    posterior = infer(SHORT)
    for diagnosis in (Diagnosis(50.0, 70.0, 1.1), Diagnosis(70.0, 50.0, 1.1)):
        diagnosed = replace(posterior, diagnosis=diagnosis)
        assert diagnosed.ess == 50.0
        assert diagnosed.rhat == 1.1


def test_chain_starts_next_to_the_previous_map_when_asked():
    config = replace(PAPER_LIKE, num_steps=4, num_samples=4, step_std=1e-6)
    posterior = infer(config, previous_map=PEAK)
    np.testing.assert_allclose(posterior.weights, np.tile(PEAK, (4, 1)), atol=1e-4)


def test_chain_starts_anywhere_without_a_previous_map():
    config = replace(PAPER_LIKE, num_steps=4, num_samples=4, step_std=1e-6)
    starts = [infer(config, seed=seed).weights[0] for seed in range(20)]
    assert np.ptp(starts, axis=0).min() > 0.5


def test_previous_map_does_not_matter_to_chains_that_start_at_the_prior():
    first = infer(SHORT, previous_map=PEAK).weights
    np.testing.assert_array_equal(first, infer(SHORT).weights)


@pytest.mark.parametrize("seed", [0, 1])
def test_inference_is_repeatable(seed):
    once, again = infer(SHORT, seed=seed), infer(SHORT, seed=seed)
    np.testing.assert_array_equal(once.weights, again.weights)
    np.testing.assert_array_equal(once.map_weights, again.map_weights)
    assert once.diagnosis == again.diagnosis
    assert once.log_evidence == again.log_evidence


def test_a_likelihood_that_steps_by_itself_gives_its_scales_as_well():
    posterior = infer(SHORT, log_likelihood=OfScale())
    prior = LogNormal(median=1.0, spread=0.5)
    assert posterior.weights.shape == (33, 3)
    np.testing.assert_allclose(np.abs(posterior.weights).sum(axis=1), 1.0)
    log_scales = np.log(posterior.scales)
    assert (np.abs(log_scales) <= 1.0).all()
    states = np.hstack([posterior.weights, log_scales[:, None]])
    expected = OfScale()(states) + prior.log_density(log_scales)
    np.testing.assert_allclose(posterior.log_posts, expected)
    assert np.abs(posterior.map_weights).sum() == pytest.approx(1.0)


def test_a_fixed_scale_is_not_among_the_samples():
    assert infer(SHORT).scales is None


def test_a_prior_counts_as_the_likelihood_does():
    config = McmcConfig(num_chains=8, num_steps=3000, target_ess=None)
    posteriors = [
        infer(config, log_likelihood=log_likelihood, log_prior=log_prior)
        for log_likelihood, log_prior in [
            (peaked, None),
            (flat, peaked),
            (lambda w: 0.5 * peaked(w), lambda w: 0.5 * peaked(w)),
        ]
    ]
    for posterior in posteriors:
        np.testing.assert_allclose(posterior.log_posts, peaked(posterior.weights))
        np.testing.assert_allclose(posterior.map_weights, PEAK, atol=0.02)
        np.testing.assert_allclose(posterior.mean_weights, PEAK, atol=0.015)
        spread = posterior.weights.std(axis=0)
        np.testing.assert_allclose(spread, posteriors[0].weights.std(axis=0), atol=0.01)


def test_map_is_that_of_likelihood_and_prior():
    def log_prior(weights):
        return -200.0 * np.square(weights - [0.4, -0.1, 0.5]).sum(axis=1)

    posterior = infer(SHORT, log_prior=log_prior)
    midway = [0.5, -0.2, 0.3]
    np.testing.assert_allclose(posterior.map_weights, midway, atol=1e-3)


def test_evidence_under_a_prior_of_ones_own_is_not_claimed():
    assert math.isfinite(infer(SHORT).log_evidence)
    assert math.isnan(infer(SHORT, log_prior=flat).log_evidence)


def test_ranks_of_the_truth_among_the_samples_are_uniform():
    """Simulation-based calibration: Talts et al. 2018, Modrák et al. 2023."""
    config = McmcConfig(
        num_chains=39,
        num_steps=120,
        burn_in=60,
        num_samples=39,
        target_ess=None,
        num_map_steps=0,
    )
    rng = np.random.default_rng(0)
    ranks = []
    for truth in sample_uniform_weights(240, 3, rng=rng):
        observed = truth + 0.3 * rng.standard_normal(3)

        def log_likelihood(weights, observed=observed):
            return -0.5 * np.square((weights - observed) / 0.3).sum(axis=1)

        posterior = infer_posterior(log_likelihood, 3, config, rng=rng)
        weights = np.vstack([truth, posterior.weights])
        asked = np.column_stack(
            [weights[:, 0], np.abs(weights).max(axis=1), log_likelihood(weights)]
        )
        ranks.append((asked[1:] < asked[0]).sum(axis=0))
    for of_one in np.transpose(ranks):
        counts = np.bincount(of_one // 5, minlength=8)
        assert len(counts) == 8
        assert chisquare(counts).pvalue > 0.01


def posterior_of(value, *, num=10, bulk=100.0, tail=200.0, rhat=1.0, is_sound=True):
    """A posterior whose rows say which one they are and whose they are."""
    return Posterior(
        weights=np.column_stack([np.full(num, value), np.arange(num)]),
        log_posts=value + np.arange(num) / num,
        scales=np.ones(num),
        map_weights=np.array([value, 1.0]),
        mean_weights=np.array([value, 2.0]),
        guess="map",
        num_chains=2,
        acceptance_rate=0.3,
        diagnosis=Diagnosis(bulk, tail, rhat),
        is_sound=is_sound,
        log_evidence=-value,
    )


def test_each_model_gives_rows_by_its_share_evenly_spread():
    models = {"a": posterior_of(1.0), "b": posterior_of(2.0)}
    mixture = mix_posteriors(models, {"a": 0.3, "b": 0.7}, "b")
    expected = [(1, 1), (1, 5), (1, 8)]
    expected += [(2, row) for row in (0, 2, 3, 5, 6, 7, 9)]
    np.testing.assert_array_equal(mixture.weights, expected)
    assert mixture.shares == {"a": 0.3, "b": 0.7}
    assert mixture.scales is None
    assert mixture.num_chains == 1


def test_log_posteriors_of_a_mixture_are_on_one_scale():
    models = {"a": posterior_of(1.0), "b": posterior_of(2.0)}
    mixture = mix_posteriors(models, {"a": 0.3, "b": 0.7}, "b")
    # The log posterior, less the log evidence, plus the log share.
    expected = [
        value + row / 10 + value + math.log(0.3 if value == 1 else 0.7)
        for value, row in mixture.weights
    ]
    np.testing.assert_allclose(mixture.log_posts, expected)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=4).filter(sum))
def test_mixture_has_as_many_rows_as_a_model(masses):
    shares = {str(name): mass / sum(masses) for name, mass in enumerate(masses)}
    models = {name: posterior_of(float(name)) for name in shares}
    mixture = mix_posteriors(models, shares, "0")
    assert mixture.weights.shape == (10, 2)
    for name, share in shares.items():
        num_rows = np.count_nonzero(mixture.weights[:, 0] == float(name))
        assert num_rows == pytest.approx(10 * share, abs=1.0 + 1e-9)
    assert len(np.unique(mixture.weights, axis=0)) == 10


def test_effective_sample_size_of_a_mixture_by_hand():
    models = {
        "a": posterior_of(1.0, bulk=100.0, tail=50.0),
        "b": posterior_of(2.0, bulk=300.0, tail=450.0),
    }
    mixture = mix_posteriors(models, {"a": 0.25, "b": 0.75}, "b")
    assert mixture.diagnosis.bulk_ess == pytest.approx(400.0)  # 1 / (1/1600 + 3/1600)
    assert mixture.diagnosis.tail_ess == pytest.approx(400.0)  # 1 / (1/800 + 1/800)


@pytest.mark.parametrize("guess", ["map", "mean"])
def test_mixture_guesses_as_the_model_that_is_named_does(guess):
    models = {
        "a": posterior_of(1.0),
        "b": replace(posterior_of(2.0), guess=guess),
        "c": posterior_of(3.0),
    }
    mixture = mix_posteriors(models, {"a": 0.3, "b": 0.3, "c": 0.4}, "b")
    assert mixture.likeliest_model("none") == "c"
    # Models of equal odds: the mean of the evidences.
    mean = np.mean(np.exp([-1.0, -2.0, -3.0]))
    assert mixture.log_evidence == pytest.approx(math.log(mean))
    assert mixture.guess == guess
    np.testing.assert_array_equal(mixture.guessed_weights, models["b"].guessed_weights)


@pytest.mark.parametrize("sure", ["a", "b"])
def test_mixture_of_one_sure_model_is_its_posterior(sure):
    models = {"a": posterior_of(1.0), "b": posterior_of(2.0)}
    shares = {name: float(name == sure) for name in models}
    mixture = mix_posteriors(models, shares, sure)
    np.testing.assert_array_equal(mixture.weights, models[sure].weights)
    shift = mixture.log_posts - models[sure].log_posts
    np.testing.assert_allclose(shift, -models[sure].log_evidence)
    np.testing.assert_array_equal(mixture.guessed_weights, models[sure].guessed_weights)
    assert mixture.diagnosis == models[sure].diagnosis


@pytest.mark.parametrize(
    ("share", "rhat", "is_sound"), [(0.5, 1.3, False), (0.01, 1.0, True)]
)
def test_a_model_that_gives_no_sample_cannot_spoil_the_mixture(share, rhat, is_sound):
    models = {
        "good": posterior_of(1.0),
        "bad": posterior_of(2.0, rhat=1.3, is_sound=False),
    }
    mixture = mix_posteriors(models, {"good": 1.0 - share, "bad": share}, "good")
    assert mixture.rhat == rhat
    assert mixture.is_sound is is_sound


def test_one_model_alone_is_the_likeliest():
    assert infer(SHORT).likeliest_model("boltzmann") == "boltzmann"


@pytest.mark.parametrize(
    ("ess", "expected"), [(1000.0, 10.0), (0.1, 0.1), (10.0, 10.0 * math.tanh(1.0))]
)
def test_rows_are_worth_no_more_than_their_number_nor_the_chains(ess, expected):
    posterior = posterior_of(1.0, bulk=ess, tail=2.0 * ess)
    assert posterior.kept_ess == pytest.approx(expected, rel=1e-3)


def test_rows_of_an_autoregressive_chain_are_worth_what_is_said():
    """Thinned by k, the correlation r of neighbours becomes r^k, which is known."""
    correlation, stride, num = 0.9, 7, 500
    ess = num * stride * (1.0 - correlation) / (1.0 + correlation)
    kept = correlation**stride
    posterior = posterior_of(1.0, bulk=ess, tail=ess, num=num)
    expected = num * (1.0 - kept) / (1.0 + kept)
    assert posterior.kept_ess == pytest.approx(expected, rel=0.01)
