import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp

from tablesetting.irl.sampler import (
    McmcConfig,
    Proposals,
    Walker,
    run_chains,
    sample_uniform_weights,
    walk,
)
from tablesetting.reward.likelihood import (
    BoltzmannConfig,
    BoltzmannLikelihood,
    Demonstration,
)
from tablesetting.reward.problem import DEFAULT, PlacementProblem
from tablesetting.reward.rbf import TABLE_CENTERS, all_centers, rbf_features
from tablesetting.reward.tasks import SPOON, TASKS, VASE

WIDTHS = np.full(13, 0.3)
CELLS = BoltzmannConfig(resolution=8)
LATTICE = BoltzmannConfig(quadrature="lattice", resolution=10)


def random_demos(num_demos, rng, num_objects=4):
    return [
        Demonstration(rng.random((num_objects, 2)), rng.random(2))
        for _ in range(num_demos)
    ]


def plain_log_likelihood(weights, demos, config):
    """Sum over demonstrations and nodes one at a time."""

    def reward(point, layout):
        centers = [*layout, *TABLE_CENTERS]
        squared = [np.sum((point - center) ** 2) for center in centers]
        return sum(
            w * math.exp(-d / 0.3) for w, d in zip(weights, squared, strict=True)
        )

    total = 0.0
    for demo in demos:
        exponents = [config.beta * reward(x, demo.layout) for x in config.nodes()]
        normaliser = sum(map(math.exp, exponents)) / config.resolution**2
        total += config.beta * reward(demo.placement, demo.layout)
        total -= math.log(normaliser)
    return total


def exact_log_likelihood(weights, demo, config):
    """Evaluate the log likelihood of one demonstration by scipy's log-sum-exp, (C,)."""
    centers = all_centers(demo.layout)
    on_nodes = config.beta * rbf_features(config.nodes(), centers, WIDTHS) @ weights.T
    shown = config.beta * rbf_features(demo.placement[None], centers, WIDTHS)[0]
    return weights @ shown - logsumexp(on_nodes, axis=0) + np.log(len(config.nodes()))


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"beta": 0.0}, "`beta` must be positive; got 0.0"),
        ({"beta": math.nan}, "`beta` must be positive; got nan"),
        ({"resolution": 1}, "`resolution` must be at least 2; got 1"),
    ],
)
def test_settings_without_meaning_are_refused(setting, message):
    with pytest.raises(ValueError, match=message):
        BoltzmannConfig(**setting)


def test_lattice_includes_the_edges_and_cells_are_met_at_their_centres():
    for config, ticks in (
        (LATTICE, np.arange(10) / 9),
        (CELLS, (np.arange(8) + 0.5) / 8),
    ):
        expected = [(x, y) for y in ticks for x in ticks]
        np.testing.assert_allclose(config.nodes(), expected)


def test_the_mean_over_the_cells_is_the_integral_over_the_square():
    nodes = BoltzmannConfig().nodes()
    np.testing.assert_allclose(nodes.mean(axis=0), 0.5)
    np.testing.assert_allclose((nodes**2).mean(axis=0), 1 / 3, atol=1e-4)
    assert nodes.prod(axis=1).mean() == pytest.approx(1 / 4)


@pytest.mark.parametrize("config", [CELLS, LATTICE], ids=["cells", "lattice"])
def test_without_preference_every_placement_is_equally_likely(config):
    demos = random_demos(3, np.random.default_rng(0))
    likelihood = BoltzmannLikelihood(demos, WIDTHS, config)
    np.testing.assert_allclose(likelihood(np.zeros((2, 13))), 0.0, atol=1e-12)


@pytest.mark.parametrize("config", [CELLS, LATTICE], ids=["cells", "lattice"])
def test_likelihoods_of_all_nodes_add_up_to_their_number(config):
    rng = np.random.default_rng(0)
    layout, weights = rng.random((4, 2)), sample_uniform_weights(5, 13, rng=rng)
    total = sum(
        np.exp(BoltzmannLikelihood([Demonstration(layout, x)], WIDTHS, config)(weights))
        for x in config.nodes()
    )
    np.testing.assert_allclose(total, config.resolution**2)


def test_four_nodes_by_hand():
    # Four lattice points, the corners; a reward that is 1 at one and e^-r^2 elsewhere.
    config = BoltzmannConfig(beta=2.0, quadrature="lattice", resolution=2)
    demo = Demonstration(np.array([[0.0, 0.0]]), np.array([0.0, 0.0]))
    weights = np.eye(10)[:1]
    likelihood = BoltzmannLikelihood([demo], np.ones(10), config)
    corners = [1.0, math.exp(-1.0), math.exp(-1.0), math.exp(-2.0)]
    normaliser = sum(math.exp(2.0 * reward) for reward in corners) / 4
    np.testing.assert_allclose(likelihood(weights), 2.0 - math.log(normaliser))


@pytest.mark.parametrize("config", [CELLS, LATTICE], ids=["cells", "lattice"])
def test_log_likelihood_equals_plain_sums(config):
    rng = np.random.default_rng(0)
    demos = random_demos(3, rng)
    weights = sample_uniform_weights(4, 13, rng=rng)
    found = BoltzmannLikelihood(demos, WIDTHS, config)(weights)
    expected = [plain_log_likelihood(w, demos, config) for w in weights]
    np.testing.assert_allclose(found, expected, rtol=1e-10)


@given(st.integers(0, 2**32), st.booleans())
def test_compiled_steps_are_those_of_the_plain_walk(seed, is_prior_uniform):
    rng = np.random.default_rng(seed)
    likelihood = BoltzmannLikelihood(random_demos(2, rng), WIDTHS, CELLS)
    noise = rng.standard_normal((60, 3, 13))
    proposals = Proposals(
        steps=0.05 * noise,
        squared_noise=np.square(noise).sum(axis=-1),
        log_uniforms=-rng.standard_exponential((60, 3)),
        is_prior_uniform=is_prior_uniform,
    )
    start = sample_uniform_weights(3, 13, rng=rng)
    log_posts = likelihood(start)
    compiled = likelihood.walk(start, log_posts, proposals)
    plain = walk(likelihood, start, log_posts, proposals)
    assert len(np.unique(plain.weights[:, 0], axis=0)) > 1  # Some were accepted.
    np.testing.assert_allclose(compiled.weights, plain.weights, atol=1e-12)
    np.testing.assert_allclose(compiled.log_posts, plain.log_posts, atol=1e-9)
    np.testing.assert_allclose(compiled.log_ratios, plain.log_ratios, atol=1e-9)


def test_chains_take_the_compiled_steps():
    rng = np.random.default_rng(0)
    likelihood = BoltzmannLikelihood(random_demos(2, rng), WIDTHS, CELLS)
    config = McmcConfig(num_chains=2, num_steps=300, burn_in=100, thin=1)
    start = sample_uniform_weights(2, 13, rng=rng)
    assert isinstance(likelihood, Walker)
    compiled, plain = (
        run_chains(each, start, config, rng=np.random.default_rng(1))
        for each in (likelihood, likelihood.__call__)
    )
    np.testing.assert_allclose(compiled.weights, plain.weights, atol=1e-9)


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
    expected = BoltzmannLikelihood(demos, WIDTHS, CELLS)(weights)

    backwards = BoltzmannLikelihood(demos[::-1], WIDTHS, CELLS)
    np.testing.assert_allclose(backwards(weights), expected)

    order = rng.permutation(4)
    renamed = [Demonstration(demo.layout[order], demo.placement) for demo in demos]
    weights[:, :4] = weights[:, order]
    permuted = BoltzmannLikelihood(renamed, WIDTHS, CELLS)
    np.testing.assert_allclose(permuted(weights), expected)


def test_log_likelihood_is_concave_in_the_weights():
    rng = np.random.default_rng(0)
    likelihood = BoltzmannLikelihood(random_demos(3, rng), WIDTHS, CELLS)
    left, right = sample_uniform_weights(400, 13, rng=rng).reshape(2, 200, 13)
    middle = likelihood(0.5 * (left + right))
    assert (middle >= 0.5 * (likelihood(left) + likelihood(right))).all()


@pytest.mark.parametrize("name", TASKS)
def test_halving_the_cells_changes_no_posterior_mean(name):
    short = replace(DEFAULT.mcmc, num_steps=5000, burn_in=1000, thin=40)
    problem = PlacementProblem(TASKS[name], replace(DEFAULT, mcmc=short))
    rng = np.random.default_rng(0)
    layouts = problem.space.sample(4, rng=rng)
    demos = [problem.demonstrate(layout) for layout in layouts]
    weights = problem.infer(demos, None, rng=rng).weights
    coarse, fine = (
        BoltzmannLikelihood(demos, problem.widths, config)(weights)
        for config in (BoltzmannConfig(), BoltzmannConfig(resolution=64))
    )
    importance = np.exp(fine - coarse)
    change = importance @ weights / importance.sum() - weights.mean(axis=0)
    assert np.abs(change).max() < 1e-3


def test_truth_is_more_likely_than_other_rewards_after_many_demonstrations():
    for task in (VASE, SPOON):
        problem = PlacementProblem(task, DEFAULT)
        rng = np.random.default_rng(0)
        layouts = problem.space.sample(10, rng=rng)
        demos = [problem.demonstrate(layout) for layout in layouts]
        likelihood = BoltzmannLikelihood(demos, problem.widths, CELLS)
        others = sample_uniform_weights(500, len(problem.widths), rng=rng)
        assert likelihood(task.true_weights[None]) > likelihood(others).max()
