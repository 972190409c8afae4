import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp

from tablesetting.irl.posterior import infer_posterior
from tablesetting.irl.random_walk import Proposals, RandomWalk, Walker, walk
from tablesetting.irl.sampler import (
    McmcConfig,
    run_chains,
    sample_uniform_weights,
)
from tablesetting.reward.config import DEFAULT
from tablesetting.reward.likelihood import (
    BoltzmannConfig,
    BoltzmannLikelihood,
    Demonstration,
)
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.rbf import TABLE_CENTERS, all_centers, rbf_features
from tablesetting.reward.tasks import SPOON, TASKS, VASE
from tablesetting.reward.teachers import BoltzmannTeacher

WIDTHS = np.full(13, 0.3)
GAUSS = BoltzmannConfig(resolution=8)
LATTICE = BoltzmannConfig(quadrature="lattice", resolution=10)
SAMPLED = BoltzmannConfig(beta_spread=0.5, resolution=8)

by_quadrature = pytest.mark.parametrize(
    "config", [GAUSS, LATTICE], ids=["gauss", "lattice"]
)


def random_demos(num_demos, rng, num_objects=4):
    return [
        Demonstration(rng.random((num_objects, 2)), rng.random(2))
        for _ in range(num_demos)
    ]


def states_of(weights, betas):
    """Append the logarithm of beta to the weights."""
    return np.column_stack([weights, np.log(betas)])


def plain_log_likelihood(weights, demos, config, beta=None):
    """Sum over demonstrations and nodes one at a time."""
    beta = beta or config.beta

    def reward(point, layout):
        centers = [*layout, *TABLE_CENTERS]
        squared = [np.sum((point - center) ** 2) for center in centers]
        return sum(
            w * math.exp(-d / 0.3) for w, d in zip(weights, squared, strict=True)
        )

    total = 0.0
    for demo in demos:
        normaliser = sum(
            share * math.exp(beta * reward(node, demo.layout))
            for node, share in zip(*config.nodes(0.3), strict=True)
        )
        total += beta * reward(demo.placement, demo.layout)
        total -= math.log(normaliser)
    return total


def exact_log_likelihood(weights, demo, config):
    """Evaluate the log likelihood of one demonstration by scipy's log-sum-exp, (C,)."""
    centers = all_centers(demo.layout)
    nodes, shares = config.nodes(0.3)
    on_nodes = config.beta * rbf_features(nodes, centers, WIDTHS) @ weights.T
    shown = config.beta * rbf_features(demo.placement[None], centers, WIDTHS)[0]
    return weights @ shown - logsumexp(on_nodes, axis=0, b=shares[:, None])


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"beta": 0.0}, "`beta` must be positive; got 0.0"),
        ({"beta": math.nan}, "`beta` must be positive; got nan"),
        ({"beta": math.inf}, "`beta` must be positive; got inf"),
        ({"beta_spread": -0.1}, "`beta_spread` must be 0 or more; got -0.1"),
        ({"beta_spread": math.nan}, "`beta_spread` must be 0 or more; got nan"),
        ({"resolution": 1}, "`resolution` must be at least 2; got 1"),
    ],
)
def test_settings_without_meaning_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        BoltzmannConfig(**setting)


def test_lattice_includes_the_edges_and_counts_every_point_alike():
    points, shares = LATTICE.nodes(0.3)
    ticks = np.arange(10) / 9
    np.testing.assert_allclose(points, [(x, y) for y in ticks for x in ticks])
    np.testing.assert_allclose(shares, 0.01)


def test_two_gauss_nodes_along_a_side_by_hand():
    points, shares = BoltzmannConfig(resolution=2).nodes(0.3)
    low, high = 0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0)
    expected = [(low, low), (high, low), (low, high), (high, high)]
    np.testing.assert_allclose(points, expected)
    np.testing.assert_allclose(shares, 0.25)


@given(st.integers(2, 12), st.integers(0, 23), st.integers(0, 23))
def test_gauss_nodes_integrate_polynomials_exactly(size, power_x, power_y):
    points, shares = BoltzmannConfig(resolution=size).nodes(0.3)
    power_x, power_y = min(power_x, 2 * size - 1), min(power_y, 2 * size - 1)
    found = shares @ (points[:, 0] ** power_x * points[:, 1] ** power_y)
    assert found == pytest.approx(1.0 / ((power_x + 1) * (power_y + 1)), rel=1e-12)


@pytest.mark.parametrize("width", [0.05, 0.3])
@pytest.mark.parametrize("beta", [10.0, 100.0, 1000.0])
def test_nodes_are_enough_for_the_sharpest_peak_wherever_it_is(beta, width):
    nodes, shares = BoltzmannConfig(beta=beta).nodes(width)
    ticks = (np.arange(600) + 0.5) / 600
    fine = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    for center in [(x, 0.47) for x in np.linspace(0.0, 0.5, 9)]:
        found, expected = (
            beta * np.exp(-np.square(points - center).sum(axis=1) / width)
            for points in (nodes, fine)
        )
        integral = logsumexp(expected) - math.log(len(fine))
        assert logsumexp(found, b=shares) == pytest.approx(integral, abs=0.05)


def test_a_sampled_beta_has_nodes_enough_for_two_spreads_more():
    spread = BoltzmannConfig(beta=100.0 * math.exp(-1.0), beta_spread=0.5)
    for found, expected in zip(
        spread.nodes(0.3), BoltzmannConfig().nodes(0.3), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


@by_quadrature
def test_without_preference_every_placement_is_equally_likely(config):
    demos = random_demos(3, np.random.default_rng(0))
    likelihood = BoltzmannLikelihood(demos, WIDTHS, config)
    np.testing.assert_allclose(likelihood(np.zeros((2, 13))), 0.0, atol=1e-12)


@by_quadrature
def test_density_has_the_mass_1(config):
    rng = np.random.default_rng(0)
    layout, weights = rng.random((4, 2)), sample_uniform_weights(5, 13, rng=rng)
    densities = [
        np.exp(BoltzmannLikelihood([Demonstration(layout, x)], WIDTHS, config)(weights))
        for x in config.nodes(0.3)[0]
    ]
    np.testing.assert_allclose(config.nodes(0.3)[1] @ densities, 1.0)


def test_four_nodes_by_hand():
    # Four lattice points, the corners; a reward that is 1 at one and e^-r^2 elsewhere.
    config = BoltzmannConfig(beta=2.0, quadrature="lattice", resolution=2)
    demo = Demonstration(np.array([[0.0, 0.0]]), np.array([0.0, 0.0]))
    weights = np.eye(10)[:1]
    likelihood = BoltzmannLikelihood([demo], np.ones(10), config)
    corners = [1.0, math.exp(-1.0), math.exp(-1.0), math.exp(-2.0)]
    normaliser = sum(math.exp(2.0 * reward) for reward in corners) / 4
    np.testing.assert_allclose(likelihood(weights), 2.0 - math.log(normaliser))


@by_quadrature
def test_log_likelihood_equals_plain_sums(config):
    rng = np.random.default_rng(0)
    demos = random_demos(3, rng)
    weights = sample_uniform_weights(4, 13, rng=rng)
    found = BoltzmannLikelihood(demos, WIDTHS, config)(weights)
    expected = [plain_log_likelihood(w, demos, config) for w in weights]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_log_likelihood_of_a_sampled_beta_equals_plain_sums():
    rng = np.random.default_rng(0)
    demos = random_demos(3, rng)
    weights, betas = sample_uniform_weights(4, 13, rng=rng), [40.0, 80.0, 100.0, 250.0]
    found = BoltzmannLikelihood(demos, WIDTHS, SAMPLED)(states_of(weights, betas))
    expected = [
        plain_log_likelihood(w, demos, SAMPLED, beta)
        for w, beta in zip(weights, betas, strict=True)
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_log_likelihood_of_the_median_beta_is_that_of_a_fixed_one():
    rng = np.random.default_rng(0)
    demos, weights = random_demos(3, rng), sample_uniform_weights(4, 13, rng=rng)
    fixed = BoltzmannLikelihood(demos, WIDTHS, GAUSS)(weights)
    states = states_of(weights, np.full(4, 100.0))
    sampled = BoltzmannLikelihood(demos, WIDTHS, SAMPLED)(states)
    np.testing.assert_allclose(sampled, fixed, rtol=1e-12)


@pytest.mark.parametrize("config", [GAUSS, LATTICE, SAMPLED])
@settings(max_examples=25)
@given(st.integers(0, 2**32), st.booleans(), st.sampled_from([0.0, 0.3, 1.0]))
def test_compiled_steps_are_those_of_the_plain_walk(
    config, seed, is_prior_uniform, power
):
    rng = np.random.default_rng(seed)
    likelihood = BoltzmannLikelihood(random_demos(2, rng), WIDTHS, config)
    start = sample_uniform_weights(3, 13, rng=rng)
    if config is SAMPLED:
        start = np.hstack([start, config.beta_prior.draw_log((3, 1), rng=rng)])
    noise = rng.standard_normal((60, *start.shape))
    proposals = Proposals(
        steps=noise * ([0.05] * 13 + [0.5])[: start.shape[1]],
        squared_noise=np.square(noise[..., :13]).sum(axis=-1),
        log_uniforms=-rng.standard_exponential((60, 3)),
        is_prior_uniform=is_prior_uniform,
        power=power,
    )
    here = likelihood(start)
    compiled = likelihood.walk(start, here, proposals)
    plain = walk(likelihood, start, here, proposals, config.beta_prior)
    assert len(np.unique(plain.states[:, 0], axis=0)) > 1  # Some were accepted.
    np.testing.assert_allclose(compiled.states, plain.states, atol=1e-12)
    np.testing.assert_allclose(
        compiled.log_likelihoods, plain.log_likelihoods, atol=1e-9
    )
    np.testing.assert_allclose(compiled.log_ratios, plain.log_ratios, atol=1e-9)


def test_a_beta_beyond_two_spreads_is_never_visited():
    rng = np.random.default_rng(0)
    likelihood = BoltzmannLikelihood(random_demos(1, rng), WIDTHS, SAMPLED)
    mcmc = McmcConfig(num_steps=3000, burn_in=1000, target_ess=None)
    chains = run_chains(likelihood.mover(mcmc), mcmc, rng=rng)
    betas = np.exp(chains.states[..., 13])
    assert 100.0 * math.exp(-1.0) <= betas.min() < 60.0
    assert 180.0 < betas.max() <= 100.0 * math.exp(1.0)


def test_sampled_beta_recovers_that_of_the_demonstrator():
    config = BoltzmannConfig(beta=100.0, beta_spread=0.7)
    rng, teacher = np.random.default_rng(0), BoltzmannTeacher(40.0)
    demos = [
        Demonstration(each, teacher.show(VASE.true_weights, each, WIDTHS, rng=rng))
        for each in rng.random((15, 4, 2))
    ]
    mcmc = McmcConfig(num_steps=3000, target_ess=None)
    likelihood = BoltzmannLikelihood(demos, WIDTHS, config)
    betas = infer_posterior(likelihood, 13, mcmc, rng=rng).scales
    assert np.quantile(betas, 0.01) < 40.0 < np.quantile(betas, 0.99)
    assert np.log(betas).std() < 0.35  # Half as much as a priori.


@pytest.mark.parametrize("config", [GAUSS, SAMPLED], ids=["fixed", "sampled"])
def test_chains_take_the_compiled_steps(config):
    rng = np.random.default_rng(0)
    likelihood = BoltzmannLikelihood(random_demos(2, rng), WIDTHS, config)
    mcmc = McmcConfig(num_chains=2, num_steps=300, burn_in=100, num_samples=400)
    start = likelihood.mover(mcmc).prior.draw(2, rng=rng)
    plain_mover = RandomWalk(likelihood.__call__, 13, mcmc, config.beta_prior)
    assert isinstance(likelihood, Walker)
    assert not isinstance(plain_mover.log_likelihood, Walker)
    compiled, plain = (
        run_chains(mover, mcmc, start=start, rng=np.random.default_rng(1))
        for mover in (likelihood.mover(mcmc), plain_mover)
    )
    np.testing.assert_allclose(compiled.states, plain.states, atol=1e-9)


@pytest.mark.parametrize("beta", [1.0, 100.0, 2000.0])
def test_no_confidence_of_the_demonstrator_overflows(beta):
    """Rewards differ by up to 2, so that exponents span 2 beta."""
    config = BoltzmannConfig(beta=beta, resolution=8)
    demos = random_demos(2, np.random.default_rng(0))
    weights = sample_uniform_weights(20, 13, rng=np.random.default_rng(1))
    found = BoltzmannLikelihood(demos, WIDTHS, config)(weights)
    expected = sum(exact_log_likelihood(weights, demo, config) for demo in demos)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


@settings(deadline=None)
@given(st.integers(0, 2**32))
def test_order_of_demonstrations_and_of_objects_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    demos = random_demos(3, rng)
    weights = sample_uniform_weights(4, 13, rng=rng)
    expected = BoltzmannLikelihood(demos, WIDTHS, GAUSS)(weights)

    backwards = BoltzmannLikelihood(demos[::-1], WIDTHS, GAUSS)
    np.testing.assert_allclose(backwards(weights), expected)

    order = rng.permutation(4)
    renamed = [Demonstration(demo.layout[order], demo.placement) for demo in demos]
    weights[:, :4] = weights[:, order]
    permuted = BoltzmannLikelihood(renamed, WIDTHS, GAUSS)
    np.testing.assert_allclose(permuted(weights), expected)


def test_log_likelihood_is_concave_in_the_weights():
    rng = np.random.default_rng(0)
    likelihood = BoltzmannLikelihood(random_demos(3, rng), WIDTHS, GAUSS)
    left, right = sample_uniform_weights(400, 13, rng=rng).reshape(2, 200, 13)
    middle = likelihood(0.5 * (left + right))
    assert (middle >= 0.5 * (likelihood(left) + likelihood(right))).all()


@pytest.mark.parametrize("name", TASKS)
def test_halving_the_spacing_of_the_nodes_changes_no_posterior_mean(name):
    mcmc = replace(DEFAULT.mcmc, num_steps=4000, target_ess=None)
    config = replace(DEFAULT, likelihood="boltzmann", mcmc=mcmc)
    problem = PlacementProblem(TASKS[name], config)
    rng = np.random.default_rng(0)
    layouts = problem.space.sample(4, rng=rng)
    demos = [problem.demonstrate(layout, rng=rng) for layout in layouts]
    weights = problem.infer(demos, None, rng=rng).weights
    num_nodes = math.isqrt(len(BoltzmannConfig().nodes(problem.widths.min())[0]))
    coarse, fine = (
        BoltzmannLikelihood(demos, problem.widths, config)(weights)
        for config in (BoltzmannConfig(), BoltzmannConfig(resolution=2 * num_nodes))
    )
    importance = np.exp(fine - coarse)
    change = importance @ weights / importance.sum() - weights.mean(axis=0)
    assert np.abs(change).max() < 1e-3


def test_truth_is_more_likely_than_other_rewards_after_many_demonstrations():
    for task in (VASE, SPOON):
        problem = PlacementProblem(task, DEFAULT)
        rng = np.random.default_rng(0)
        layouts = problem.space.sample(10, rng=rng)
        demos = [problem.demonstrate(layout, rng=rng) for layout in layouts]
        likelihood = BoltzmannLikelihood(demos, problem.widths, GAUSS)
        others = sample_uniform_weights(500, len(problem.widths), rng=rng)
        assert likelihood(task.true_weights[None]) > likelihood(others).max()


@pytest.mark.parametrize("config", [GAUSS, LATTICE, SAMPLED])
def test_gradient_equals_finite_differences(config):
    rng = np.random.default_rng(0)
    log_likelihood = BoltzmannLikelihood(random_demos(3, rng), WIDTHS, config)
    state = 0.7 * sample_uniform_weights(1, 13, rng=rng)[0]  # Off the sphere, too.
    if config.beta_spread:
        state = np.append(state, math.log(config.beta) + 0.3)
    steps = 1e-6 * np.eye(13, len(state))
    rises = log_likelihood(state + steps) - log_likelihood(state - steps)
    np.testing.assert_allclose(
        log_likelihood.concave_gradient(state), rises / 2e-6, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("num_demos", [1, 3, 10])
def test_the_map_is_the_same_for_every_seed(num_demos):
    """Chains end elsewhere, but the most probable reward on the sphere is one."""
    problem = PlacementProblem(SPOON, DEFAULT)
    rng = np.random.default_rng(0)
    layouts = problem.space.sample(num_demos, rng=rng)
    demos = [problem.demonstrate(layout, rng=rng) for layout in layouts]
    log_likelihood = BoltzmannLikelihood(demos, problem.widths, BoltzmannConfig())
    brief = McmcConfig(num_steps=400, burn_in=200, num_samples=40, target_ess=None)
    found = np.array(
        [
            infer_posterior(
                log_likelihood,
                len(problem.widths),
                brief,
                rng=np.random.default_rng(seed),
            ).map_weights
            for seed in range(3)
        ]
    )
    np.testing.assert_allclose(found, found[:1].repeat(3, axis=0), atol=1e-3)


@pytest.mark.parametrize("config", [GAUSS, SAMPLED])
@pytest.mark.parametrize("log_prior", [None, lambda weights: weights[:, 0]])
def test_the_search_for_the_map_knows_the_gradient_of_what_it_climbs(
    config, log_prior, monkeypatch
):
    """With the beta that it holds; under another prior it knows none."""
    handed_on = []

    def spy(log_post, start, num_steps, *, gradient, rng):
        handed_on.append((log_post, start, gradient))
        return start

    monkeypatch.setattr("tablesetting.irl.posterior.find_map", spy)
    rng = np.random.default_rng(0)
    log_likelihood = BoltzmannLikelihood(random_demos(3, rng), WIDTHS, config)
    brief = McmcConfig(num_steps=40, burn_in=20, num_samples=40, target_ess=None)
    infer_posterior(log_likelihood, 13, brief, log_prior=log_prior, rng=rng)
    [(log_post, start, gradient)] = handed_on
    if log_prior is not None:
        assert gradient is None
        return
    steps = 1e-6 * np.eye(13)
    rises = log_post(start + steps) - log_post(start - steps)
    np.testing.assert_allclose(gradient(start), rises / 2e-6, rtol=1e-5, atol=1e-5)
