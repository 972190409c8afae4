import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tablesetting.irl.posterior import Posterior, mix_posteriors
from tablesetting.irl.sampler import Diagnosis, McmcConfig, sample_uniform_weights
from tablesetting.reward.config import DEFAULT, PAPER
from tablesetting.reward.inference import (
    MODELS,
    infer_weights,
    model_shares,
    model_to_guess_by,
)
from tablesetting.reward.likelihood import BoltzmannConfig, Demonstration
from tablesetting.reward.placement import best_placements
from tablesetting.reward.placement_likelihood import NoiseConfig
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import VASE
from tablesetting.reward.teachers import BoltzmannTeacher

WIDTHS = np.full(13, 0.3)
QUICK = replace(
    DEFAULT,
    boltzmann=BoltzmannConfig(beta=50.0),
    noise=NoiseConfig(noise_std=0.03),
    mcmc=McmcConfig(num_steps=400, burn_in=200, num_particles=64, num_samples=100),
)
evidences = st.floats(-50.0, 50.0)


def posterior_of(log_evidence=0.0, seed=0):
    weights = sample_uniform_weights(100, 13, rng=np.random.default_rng(seed))
    return Posterior(
        weights=weights,
        log_posts=np.zeros(100),
        scales=None,
        map_weights=weights[0],
        mean_weights=weights[1],
        guess="map",
        num_chains=4,
        acceptance_rate=0.3,
        diagnosis=Diagnosis(100.0, 100.0, 1.0),
        is_sound=True,
        log_evidence=log_evidence,
    )


def demonstrate(num_demos, teacher=None, seed=0):
    rng = np.random.default_rng(seed)
    problem = PlacementProblem(VASE, DEFAULT, teacher=teacher)
    layouts = problem.space.sample(num_demos, rng=rng)
    return [problem.demonstrate(layout, rng=rng) for layout in layouts]


def infer(demos, likelihood, *, seed=0, **changes):
    config = replace(QUICK, likelihood=likelihood, **changes)
    return infer_weights(demos, WIDTHS, config, rng=np.random.default_rng(seed))


def test_auto_without_evidence_is_refused():
    mcmc = replace(QUICK.mcmc, num_particles=0)
    with pytest.raises(ValueError, match=r"needs evidence, .* `num_particles` 0"):
        replace(QUICK, likelihood="auto", mcmc=mcmc)


@pytest.mark.parametrize("name", MODELS)
def test_a_single_model_is_not_weighed(name):
    posterior = infer(demonstrate(2), name)
    assert posterior.shares == {}
    assert math.isfinite(posterior.log_evidence)
    assert posterior.weights.shape == (100, 13)


@pytest.mark.parametrize(
    ("name", "guess"), [("boltzmann", "map"), ("placement", "mean")]
)
def test_robot_acts_on_what_is_better_for_the_model(name, guess):
    posterior = infer(demonstrate(2), name)
    assert posterior.guess == guess
    expected = {"map": posterior.map_weights, "mean": posterior.mean_weights}[guess]
    np.testing.assert_array_equal(posterior.guessed_weights, expected)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("guess", ["map", "mean"])
def test_robot_acts_on_what_it_is_told_to(name, guess):
    assert infer(demonstrate(1), name, guess=guess).guess == guess


def test_paper_acts_on_the_map():
    posterior = infer_weights(
        demonstrate(1), WIDTHS, PAPER, rng=np.random.default_rng(0)
    )
    assert posterior.guess == "map"
    np.testing.assert_array_equal(posterior.guessed_weights, posterior.map_weights)


def test_shares_are_odds_of_evidence_by_hand():
    """e^3 times as likely, whatever unit of the density is common to both."""
    for shift in (0.0, -1e4):
        shares = model_shares(
            {
                "boltzmann": posterior_of(1.0 + shift),
                "placement": posterior_of(4.0 + shift),
            }
        )
        assert shares["placement"] == pytest.approx(1.0 / (1.0 + math.exp(-3.0)))
        assert shares["boltzmann"] == pytest.approx(1.0 / (1.0 + math.exp(3.0)))


@given(evidences, evidences, st.integers(1, 12), st.floats(-1e4, 1e4))
def test_placement_guesses_once_it_is_ahead_in_every_demonstration(
    boltzmann, placement, num_demos, shift
):
    assume(abs(placement - boltzmann - 1.2 * num_demos) > 1e-6)
    posteriors = {
        "boltzmann": posterior_of(boltzmann + shift),
        "placement": posterior_of(placement + shift),
    }
    expected = placement - boltzmann > 1.2 * num_demos
    found = model_to_guess_by(posteriors, num_demos)
    assert found == ("placement" if expected else "boltzmann")


def test_auto_weighs_the_posteriors_of_both_models():
    demos = demonstrate(3)
    mixed = infer(demos, "auto")
    rng = np.random.default_rng(0)  # Both draw from the same, in turn.
    thorough = replace(QUICK.mcmc, num_particles=256, steps_per_rung=10)
    each = {
        name: infer_weights(
            demos, WIDTHS, replace(QUICK, likelihood=name, mcmc=thorough), rng=rng
        )
        for name in ("boltzmann", "placement")
    }
    assert mixed.shares == model_shares(each)
    guess_of = model_to_guess_by(each, 3)
    expected = mix_posteriors(each, mixed.shares, guess_of)
    np.testing.assert_array_equal(mixed.weights, expected.weights)
    np.testing.assert_array_equal(mixed.guessed_weights, expected.guessed_weights)
    assert mixed.guess == each[guess_of].guess


def test_auto_finds_who_hits_and_who_chooses_freely():
    """Of many demonstrations, exact ones or such of great spread."""
    exact, free = (
        infer(demonstrate(6, teacher), "auto", noise=NoiseConfig(0.01)).shares
        for teacher in (None, BoltzmannTeacher(50.0))
    )
    assert exact["placement"] > 0.99
    assert free["boltzmann"] > 0.99


def test_odds_of_the_models_are_the_same_for_every_seed():
    """Six exact demonstrations leave ridges of a hundredth of the table's width."""
    demos = demonstrate(6)
    log_odds = []
    for seed in range(5):
        shares = infer(demos, "auto", seed=seed, noise=NoiseConfig(0.01)).shares
        log_odds.append(math.log(shares["placement"] / shares["boltzmann"]))
    assert np.std(log_odds) < 1.2


@pytest.mark.parametrize(
    "setting",
    [
        {"noise": NoiseConfig(noise_spread=0.5)},
        {"boltzmann": BoltzmannConfig(50.0, 0.5)},
    ],
)
def test_auto_with_a_scale_to_learn_is_refused(setting):
    with pytest.raises(ValueError, match="auto weighs models of fixed noise"):
        replace(QUICK, likelihood="auto", **setting)


@pytest.mark.parametrize("name", MODELS)
def test_a_prior_shifts_the_posterior_as_reweighting_would(name):
    def log_prior(weights):
        return 6.0 * weights[:, 8]

    demo = Demonstration(np.array(VASE.first_layout), np.array([0.35, 0.45]))
    mcmc = McmcConfig(num_steps=5000, num_samples=400, target_ess=None)
    config = replace(
        QUICK,
        likelihood=name,
        boltzmann=BoltzmannConfig(beta=10.0),
        noise=NoiseConfig(noise_std=0.15),
        mcmc=mcmc,
    )
    rng = np.random.default_rng(0)
    found = infer_weights([demo], WIDTHS, config, log_prior=log_prior, rng=rng)
    flat = infer_weights([demo], WIDTHS, config, rng=rng)
    draws = sample_uniform_weights(40_000, 13, rng=rng)
    log_likelihood = MODELS[name]([demo], WIDTHS, config)(draws)
    shares = np.exp(log_likelihood + log_prior(draws))
    expected = shares @ draws / shares.sum()
    assert found.weights[:, 8].mean() == pytest.approx(expected[8], abs=0.02)
    assert found.weights[:, 8].mean() > flat.weights[:, 8].mean() + 0.02


def test_problem_hands_its_prior_on():
    def only_positive(weights):
        return np.where(weights[:, 8] > 0.0, 0.0, -np.inf)

    problem = PlacementProblem(VASE, QUICK, log_prior=only_positive)
    rng = np.random.default_rng(0)
    demos = [problem.demonstrate(np.array(VASE.first_layout), rng=rng)]
    weights = problem.infer(demos, None, rng=rng).weights
    assert (weights[:, 8] > 0.0).mean() > 0.95


@pytest.mark.parametrize("name", MODELS)
def test_samples_agree_with_the_demonstrations(name):
    """Much better than the prior does."""
    demos = demonstrate(3)
    posterior = infer(demos, name)
    prior = sample_uniform_weights(400, 13, rng=np.random.default_rng(0))

    def miss(weights):
        layouts = np.array([demo.layout for demo in demos])
        shown = np.array([demo.placement for demo in demos])[:, None]
        best = best_placements(weights, layouts, WIDTHS)
        return np.linalg.norm(best - shown, axis=2).mean()

    assert miss(posterior.weights) < 0.4 * miss(prior)
