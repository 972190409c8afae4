import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tablesetting.irl import arrays
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.sampler import Diagnosis, sample_uniform_weights
from tablesetting.reward.config import DEFAULT
from tablesetting.reward.outlook import PlacementOutlook, placement_losses
from tablesetting.reward.placement import best_placements
from tablesetting.reward.placement_likelihood import NoiseConfig
from tablesetting.reward.rbf import TABLE_CENTERS

NUM_SAMPLES = 6
WIDTHS = np.full(13, 0.3)
LAYOUTS = np.random.default_rng(1).random((3, 4, 2))
DEPLOYMENT = np.random.default_rng(2).random((5, 4, 2))
BOLTZMANN = replace(DEFAULT, likelihood="boltzmann")
PLACEMENT = replace(DEFAULT, likelihood="placement", noise=NoiseConfig(0.05))


def posterior_of(num_samples, guess="map", shares=None):
    rng = np.random.default_rng(0)
    weights = sample_uniform_weights(num_samples + 2, 13, rng=rng)
    return Posterior(
        weights=weights[2:],
        log_posts=np.zeros(num_samples),
        scales=None,
        map_weights=weights[0],
        mean_weights=weights[1],
        guess=guess,
        num_chains=1,
        acceptance_rate=0.3,
        diagnosis=Diagnosis(50.0, 40.0, 1.0),
        is_sound=True,
        log_evidence=0.0,
        shares=shares or {},
    )


def look(config=PLACEMENT, num_samples=NUM_SAMPLES, **kwargs):
    posterior = posterior_of(num_samples, **kwargs)
    outlook = PlacementOutlook(LAYOUTS, DEPLOYMENT, posterior, WIDTHS, config)
    return outlook, posterior


def reward(weights, layout, point):
    """Evaluate one reward at one point."""
    squared = [np.sum((point - center) ** 2) for center in (*layout, *TABLE_CENTERS)]
    return sum(w * math.exp(-d / 0.3) for w, d in zip(weights, squared, strict=True))


def best(weights, layout):
    return best_placements(weights[None], layout[None], WIDTHS)[0, 0]


def plain_losses(layouts, guess, weights):
    return [
        [math.dist(best(guess, layout), best(each, layout)) for each in weights]
        for layout in layouts
    ]


@pytest.mark.parametrize("guess", ["map", "mean"])
def test_losses_are_distances_from_the_placement_of_the_guess(guess):
    outlook, posterior = look(guess=guess)
    guessed = {"map": posterior.map_weights, "mean": posterior.mean_weights}[guess]
    expected = plain_losses(LAYOUTS, guessed, posterior.weights)
    np.testing.assert_allclose(outlook.losses, expected, atol=1e-9)
    losses = placement_losses(LAYOUTS, posterior, WIDTHS)
    np.testing.assert_array_equal(outlook.losses, losses)


def test_losses_are_the_same_in_blocks_of_any_size(monkeypatch):
    whole = look()[0].losses
    for num_elements in (1, 15):
        monkeypatch.setattr(arrays, "_BLOCK_ELEMENTS", num_elements)
        np.testing.assert_array_equal(look()[0].losses, whole)


def test_numbers_of_candidates_and_of_effective_samples():
    outlook, posterior = look()
    assert outlook.num_queries == 3
    assert outlook.ess == posterior.kept_ess < posterior.ess == 40.0


def test_distances_are_those_between_the_placements_of_the_samples():
    outlook, posterior = look()
    for query, layout in enumerate(LAYOUTS):
        places = [best(weights, layout) for weights in posterior.weights]
        expected = [[math.dist(x, y) for y in places] for x in places]
        np.testing.assert_allclose(outlook.distances(query), expected, atol=1e-9)


def test_values_are_what_each_sample_makes_of_the_placement_of_each():
    outlook, posterior = look()
    for query, layout in enumerate(LAYOUTS):
        expected = [
            [reward(w, layout, best(other, layout)) for other in posterior.weights]
            for w in posterior.weights
        ]
        np.testing.assert_allclose(outlook.values(query), expected, atol=1e-9)


def test_no_sample_likes_a_placement_more_than_its_own():
    outlook, _ = look()
    for query in range(3):
        values = outlook.values(query)
        assert (np.diagonal(values)[:, None] >= values - 1e-12).all()


def test_best_mean_value_is_that_of_the_mean_reward():
    outlook, posterior = look()
    mean = posterior.weights.mean(axis=0)
    for query, layout in enumerate(LAYOUTS):
        expected = reward(mean, layout, best(mean, layout))
        assert outlook.best_mean_value(query) == pytest.approx(expected, abs=1e-9)
        assert expected >= outlook.values(query).mean(axis=0).max() - 1e-12


def test_classes_are_cells_of_a_tenth_of_the_side():
    outlook, posterior = look()
    for query, layout in enumerate(LAYOUTS):
        cells = [
            [min(int(10 * coordinate), 9) for coordinate in best(weights, layout)]
            for weights in posterior.weights
        ]
        expected = [column + 10 * row for column, row in cells]
        np.testing.assert_array_equal(outlook.classes(query), expected)


def test_answers_of_a_noisily_rational_person_are_cells_of_the_square():
    outlook, posterior = look(BOLTZMANN)
    ticks = (np.arange(16) + 0.5) / 16
    for query, layout in enumerate(LAYOUTS):
        cells = [(x, y) for y in ticks for x in ticks]
        chances = np.array(
            [
                [math.exp(100.0 * reward(weights, layout, cell)) for cell in cells]
                for weights in posterior.weights
            ]
        )
        chances /= chances.sum(axis=1, keepdims=True)
        answers = outlook.answers(query)
        np.testing.assert_allclose(answers.likelihoods, chances, atol=1e-12)
        np.testing.assert_allclose(answers.probabilities, chances.mean(axis=0))
        assert answers.probabilities.sum() == pytest.approx(1.0)


def test_answers_of_one_who_nearly_hits_are_the_placements_of_the_samples():
    outlook, posterior = look()
    for query, layout in enumerate(LAYOUTS):
        places = [best(weights, layout) for weights in posterior.weights]
        expected = [
            [stats.norm.pdf(answer, place, 0.05).prod() / 256 for answer in places]
            for place in places
        ]
        answers = outlook.answers(query)
        np.testing.assert_allclose(answers.likelihoods, expected, rtol=1e-7)
        np.testing.assert_allclose(answers.probabilities, 1 / NUM_SAMPLES)


def test_answers_overlap_however_exact_the_person():
    exact, wide = (
        look(replace(PLACEMENT, noise=NoiseConfig(std)))[0].answers(0)
        for std in (0.001, 0.03)
    )
    np.testing.assert_allclose(exact.likelihoods, wide.likelihoods)


@pytest.mark.parametrize("likeliest", ["boltzmann", "placement"])
def test_answers_are_by_the_likeliest_model(likeliest):
    shares = {"boltzmann": 0.2, "placement": 0.2, likeliest: 0.8}
    auto = look(replace(PLACEMENT, likelihood="auto"), shares=shares)[0]
    only = look(replace(PLACEMENT, likelihood=likeliest))[0]
    np.testing.assert_array_equal(
        auto.answers(0).likelihoods, only.answers(0).likelihoods
    )


def test_losses_of_the_deployment_are_in_its_own_layouts():
    outlook, posterior = look()
    expected = plain_losses(DEPLOYMENT, posterior.map_weights, posterior.weights)
    np.testing.assert_allclose(outlook.deployed_losses, expected, atol=1e-9)


def test_distances_of_the_deployment_are_averages_over_its_layouts():
    outlook, posterior = look()
    total = np.zeros((NUM_SAMPLES, NUM_SAMPLES))
    for layout in DEPLOYMENT:
        places = [best(weights, layout) for weights in posterior.weights]
        total += [[math.dist(x, y) for y in places] for x in places]
    np.testing.assert_allclose(outlook.deployed_distances, total / 5, atol=1e-9)


def test_of_many_samples_a_hundred_are_compared_spread_evenly():
    outlook, posterior = look(num_samples=250)
    chosen = [250 * m // 100 for m in range(100)]
    fewer = replace(posterior, weights=posterior.weights[chosen])
    expected = PlacementOutlook(LAYOUTS, DEPLOYMENT, fewer, WIDTHS, PLACEMENT)
    assert outlook.losses.shape == (3, 250)
    np.testing.assert_array_equal(outlook.losses[:, chosen], expected.losses)
    np.testing.assert_array_equal(outlook.distances(1), expected.distances(1))
    np.testing.assert_array_equal(outlook.deployed_losses, expected.deployed_losses)
    assert outlook.answers(2).likelihoods.shape == (100, 100)
