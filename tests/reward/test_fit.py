import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tablesetting.irl.posterior import Posterior
from tablesetting.irl.sampler import Diagnosis, McmcConfig, sample_uniform_weights
from tablesetting.reward.config import PlacementConfig
from tablesetting.reward.fit import (
    Fit,
    draw_answers,
    explained_p_value,
    fisher_p_value,
    foretold_p_value,
)
from tablesetting.reward.inference import infer_weights
from tablesetting.reward.likelihood import BoltzmannConfig, Demonstration
from tablesetting.reward.placement import best_placements
from tablesetting.reward.placement_likelihood import NoiseConfig
from tablesetting.reward.tasks import VASE
from tablesetting.reward.teachers import (
    BiasedTeacher,
    BoltzmannTeacher,
    ExactTeacher,
    NoisyTeacher,
)

WIDTHS = np.full(13, 0.3)
LAYOUT = np.array(VASE.first_layout)
# Many short chains from many particles: of as many steps, they depend on each other least.
MCMC = McmcConfig(
    num_chains=50,
    num_steps=60,
    burn_in=30,
    num_particles=100,
    num_samples=100,
    target_ess=None,
)
CONFIGS = {
    "placement": PlacementConfig(
        likelihood="placement", noise=NoiseConfig(0.05), mcmc=MCMC
    ),
    "boltzmann": PlacementConfig(
        likelihood="boltzmann", boltzmann=BoltzmannConfig(beta=30.0), mcmc=MCMC
    ),
}
SHARP = PlacementConfig(
    likelihood="placement",
    noise=NoiseConfig(0.01),
    mcmc=replace(MCMC, num_samples=400),
)
TEACHERS = {"placement": NoisyTeacher(0.05), "boltzmann": BoltzmannTeacher(30.0)}
p_values = st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=12)

by_model = pytest.mark.parametrize("model", CONFIGS)


def posterior_of(weights, scales=None, shares=None):
    return Posterior(
        weights=weights,
        log_posts=np.zeros(len(weights)),
        scales=scales,
        map_weights=weights[0],
        mean_weights=weights[0],
        guess="map",
        num_chains=1,
        acceptance_rate=0.3,
        diagnosis=Diagnosis(100.0, 100.0, 1.0),
        is_sound=True,
        log_evidence=0.0,
        shares=shares or {},
    )


def certain(num_samples=400, **kwargs):
    """Return a posterior that knows the weights of the vase."""
    return posterior_of(np.tile(VASE.true_weights, (num_samples, 1)), **kwargs)


def show(weights, layouts, teacher, rng):
    return [
        Demonstration(each, teacher.show(weights, each, WIDTHS, rng=rng))
        for each in layouts
    ]


def fit_of(demos, config, rng):
    """Look at demonstrations as one comes after the other."""
    foretold = []
    posterior = infer_weights(demos[:1], WIDTHS, config, rng=rng)
    for num in range(1, len(demos)):
        foretold.append(
            foretold_p_value(demos[num], posterior, WIDTHS, config, rng=rng)
        )
        posterior = infer_weights(demos[: num + 1], WIDTHS, config, rng=rng)
    explained = explained_p_value(demos, posterior, WIDTHS, config, rng=rng)
    return Fit(explained, tuple(foretold))


def test_fisher_of_one_is_itself_and_of_two_by_hand():
    assert fisher_p_value([0.3]) == pytest.approx(0.3)
    product = 0.1 * 0.5
    assert fisher_p_value([0.1, 0.5]) == pytest.approx(
        product * (1.0 - math.log(product))
    )


@given(p_values)
def test_fisher_equals_that_of_scipy(values):
    expected = stats.combine_pvalues(values, method="fisher").pvalue
    assert fisher_p_value(values) == pytest.approx(expected, rel=1e-9, abs=1e-300)


def test_fisher_survives_the_impossible():
    assert fisher_p_value([0.0, 0.5]) < 1e-290
    assert fisher_p_value([0.0] * 30) == 0.0
    assert fisher_p_value([1.0, 1.0, 1.0]) == 1.0


def test_one_demonstration_has_nothing_foretold():
    assert Fit(0.2, ()).p_value == 0.2


def test_smallest_of_three_looks_counts_three_times():
    assert Fit(0.02, (0.5, 0.6)).p_value == pytest.approx(0.06)
    # A blunder: the worst of four by itself.
    assert Fit(0.5, (0.9, 0.002, 0.9, 0.9)).p_value == pytest.approx(3 * 4 * 0.002)
    # A bias: all four are somewhat small.
    together = fisher_p_value([0.05] * 4)
    assert Fit(0.5, (0.05,) * 4).p_value == pytest.approx(3 * together)
    assert together < 4 * 0.05


@given(st.floats(1e-3, 1.0), p_values)
def test_p_value_is_one_at_most_and_no_less_than_the_smallest(explained, foretold):
    p_value = Fit(explained, tuple(foretold)).p_value
    assert p_value <= 1.0
    assert p_value >= min(explained, fisher_p_value(foretold), min(foretold))


def test_answers_of_one_who_nearly_hits_are_gaussian_about_what_is_wanted():
    wanted = np.full((4000, 2), 0.5)
    answers = draw_answers(
        certain(4000),
        LAYOUT,
        wanted,
        WIDTHS,
        CONFIGS["placement"],
        rng=np.random.default_rng(0),
    )
    for values in answers.T:
        assert stats.kstest(values, stats.norm(0.5, 0.05).cdf).pvalue > 0.001


def test_answers_have_the_noise_of_their_sample():
    scales = np.repeat([0.01, 0.1], 2000)
    posterior, wanted = certain(4000, scales=scales), np.full((4000, 2), 0.5)
    rng = np.random.default_rng(0)
    answers = draw_answers(
        posterior, LAYOUT, wanted, WIDTHS, CONFIGS["placement"], rng=rng
    )
    stds = (answers - 0.5).reshape(2, -1).std(axis=1)
    np.testing.assert_allclose(stds, [0.01, 0.1], rtol=0.05)


def test_answers_beyond_the_edge_are_at_it():
    wanted = np.zeros((1000, 2))
    rng = np.random.default_rng(0)
    answers = draw_answers(
        certain(1000), LAYOUT, wanted, WIDTHS, CONFIGS["placement"], rng=rng
    )
    assert answers.min() == 0.0
    assert np.mean(answers == 0.0) == pytest.approx(0.5, abs=0.04)


@pytest.mark.parametrize(
    "scales", [None, np.full(3000, 60.0)], ids=["fixed", "sampled"]
)
def test_answers_of_a_noisily_rational_person_are_those_of_the_teacher(scales):
    wanted, rng = np.full((3000, 2), 0.5), np.random.default_rng(0)
    posterior = certain(3000, scales=scales)
    answers = draw_answers(
        posterior, LAYOUT, wanted, WIDTHS, CONFIGS["boltzmann"], rng=rng
    )
    teacher = BoltzmannTeacher(30.0 if scales is None else 60.0)
    shown = show(VASE.true_weights, [LAYOUT] * 1500, teacher, rng)
    expected = np.array([demo.placement for demo in shown])
    for found, drawn in zip(answers.T, expected.T, strict=True):
        assert stats.ks_2samp(found, drawn).pvalue > 0.001


@by_model
def test_answers_are_by_the_likeliest_model(model):
    wanted = np.full((200, 2), 0.5)
    mixed = certain(200, shares={"boltzmann": 0.5, "placement": 0.5, model: 0.9})
    found, expected = (
        draw_answers(
            posterior,
            LAYOUT,
            wanted,
            WIDTHS,
            CONFIGS[model],
            rng=np.random.default_rng(0),
        )
        for posterior in (mixed, certain(200))
    )
    np.testing.assert_array_equal(found, expected)


def test_p_values_of_known_weights_by_hand():
    """Squared errors of noise s are s^2 times chi-square of two degrees of freedom."""
    posterior, config = certain(4000), CONFIGS["placement"]
    rng = np.random.default_rng(0)
    best = best_placements(VASE.true_weights[None], LAYOUT[None], WIDTHS)[0, 0]
    demos = [Demonstration(LAYOUT, best + [0.08, 0.0])] * 2
    expected = stats.chi2.sf((0.08 / 0.05) ** 2, 2)
    foretold = foretold_p_value(demos[0], posterior, WIDTHS, config, rng=rng)
    assert foretold == pytest.approx(expected, abs=0.03)
    expected = stats.chi2.sf(2 * (0.08 / 0.05) ** 2, 4)
    explained = explained_p_value(demos, posterior, WIDTHS, config, rng=rng)
    assert explained == pytest.approx(expected, abs=0.03)


@by_model
def test_no_p_value_is_zero(model):
    rng, config = np.random.default_rng(0), CONFIGS[model]
    posterior = certain(99)
    blunder = Demonstration(LAYOUT, np.array([0.0, 1.0]))
    found = [
        foretold_p_value(blunder, posterior, WIDTHS, config, rng=rng),
        explained_p_value([blunder], posterior, WIDTHS, config, rng=rng),
    ]
    assert found == pytest.approx([1 / (8 * 99 + 1), 1 / 100])


@by_model
def test_people_like_the_model_are_seldom_doubted(model):
    """P-values are even in [0, 1] or larger, as where answers are clipped at an edge."""
    fits = []
    for seed in range(80):
        rng = np.random.default_rng([2, seed])
        truth = sample_uniform_weights(1, 13, rng=rng)[0]
        demos = show(truth, rng.random((2, 4, 2)), TEACHERS[model], rng)
        fits.append(fit_of(demos, CONFIGS[model], rng))
    foretold = [fit.foretold[0] for fit in fits]
    assert stats.kstest(foretold, "uniform", alternative="greater").pvalue > 0.01
    for level in (0.05, 0.2):
        for found in ([f.explained for f in fits], [f.p_value for f in fits]):
            num_doubted = int(np.sum(np.array(found) <= level))
            assert stats.binomtest(num_doubted, 80, level, "greater").pvalue > 0.01


def test_one_blunder_among_many_answers_is_noticed():
    rng = np.random.default_rng(0)
    demos = show(VASE.true_weights, rng.random((6, 4, 2)), ExactTeacher(), rng)
    assert fit_of(demos, SHARP, rng).p_value > 0.2
    demos[4] = Demonstration(demos[4].layout, np.array([0.03, 0.9]))
    blundered = fit_of(demos, SHARP, rng)
    assert blundered.foretold[3] == min(blundered.foretold) < 0.005
    assert blundered.p_value < 0.05


def test_a_bias_is_noticed():
    """The vase beside the middle, whatever stands there: no reward explains it all."""
    rng = np.random.default_rng(0)
    layouts = rng.random((8, 4, 2))
    biased = show(VASE.true_weights, layouts, BiasedTeacher((0.2, 0.0)), rng)
    fit = fit_of(biased, SHARP, rng)
    assert fit.explained < 0.05
    assert fisher_p_value(fit.foretold) < 0.05
    assert fit.p_value < 0.05
