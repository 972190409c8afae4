import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tablesetting.irl.random_walk import Proposals, RandomWalk, walk
from tablesetting.irl.sampler import (
    LogNormal,
    McmcConfig,
    Walk,
    WithPrior,
    run_chains,
    sample_uniform_weights,
)

DIM = 13  # Weights of the vase task.
MANY_CHAINS = McmcConfig(
    num_chains=200,
    num_steps=2000,
    burn_in=500,
    num_particles=0,
    step_std=0.3,
    target_ess=None,
)
ONE_BLOCK = replace(MANY_CHAINS, num_chains=3, num_steps=40, burn_in=0, num_samples=3)
SCALE_PRIOR = LogNormal(median=2.0, spread=0.4)


def flat(states):
    return np.zeros(len(states))


def tilted(weights):
    """A smooth target that favours one edge of the L1 sphere."""
    return 3.0 * weights[:, 0] - 8.0 * (weights[:, -1] - 0.4) ** 2


def sample(log_likelihood, dim, config, *, scale_prior=None, seed=0):
    mover = RandomWalk(log_likelihood, dim, config, scale_prior)
    return run_chains(mover, config, rng=np.random.default_rng(seed))


def draw_proposals(seed, *, dim, num_steps=30, num_chains=3, power=1.0):
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((num_steps, num_chains, dim))
    return Proposals(
        steps=0.3 * noise,
        squared_noise=np.square(noise).sum(axis=-1),
        log_uniforms=np.log(rng.random((num_steps, num_chains))),
        is_prior_uniform=True,
        power=power,
    )


@given(st.integers(0, 2**32), st.booleans(), st.floats(0.0, 1.0))
def test_states_stay_or_take_the_proposal_as_the_ratio_says(
    seed, is_prior_uniform, power
):
    proposals = replace(
        draw_proposals(seed, dim=4, power=power), is_prior_uniform=is_prior_uniform
    )
    start = sample_uniform_weights(3, 4, rng=np.random.default_rng(seed))
    walked = walk(tilted, start, tilted(start), proposals)
    before = np.concatenate([start[None], walked.states[:-1]])
    there = before + proposals.steps
    norm = np.abs(there).sum(axis=2)
    gain = tilted(np.vstack(there / norm[..., None])) - tilted(np.vstack(before))
    expected = power * gain.reshape(norm.shape)
    if is_prior_uniform:
        expected -= 8 * np.log(norm)
        expected -= 0.5 * proposals.squared_noise * (norm**-2 - 1.0)
    np.testing.assert_allclose(walked.log_ratios, expected, atol=1e-9)
    is_taken = proposals.log_uniforms < walked.log_ratios
    taken = np.where(is_taken[..., None], there / norm[..., None], before)
    np.testing.assert_allclose(walked.states, taken, atol=1e-12)


@given(st.integers(0, 2**32))
def test_every_state_is_on_the_sphere_with_its_own_log_likelihood(seed):
    start = sample_uniform_weights(3, 4, rng=np.random.default_rng(seed))
    walked = walk(tilted, start, tilted(start), draw_proposals(seed, dim=4))
    assert walked.states.shape == (30, 3, 4)
    np.testing.assert_allclose(np.abs(walked.states).sum(axis=2), 1.0)
    expected = tilted(walked.states.reshape(-1, 4)).reshape(30, 3)
    np.testing.assert_allclose(walked.log_likelihoods, expected)


@given(st.integers(0, 2**32))
def test_a_likelihood_to_the_power_of_zero_is_flat(seed):
    start = sample_uniform_weights(3, 4, rng=np.random.default_rng(seed))
    proposals = draw_proposals(seed, dim=4, power=0.0)
    flattened = walk(tilted, start, tilted(start), proposals)
    expected = walk(flat, start, flat(start), proposals)
    np.testing.assert_array_equal(flattened.states, expected.states)


def test_the_power_of_the_likelihood_reaches_the_ratio():
    start = sample_uniform_weights(3, 4, rng=np.random.default_rng(0))
    proposals = draw_proposals(0, dim=4, power=0.3)
    flattened = walk(tilted, start, tilted(start), proposals)

    def gentle(weights):
        return 0.3 * tilted(weights)

    expected = walk(gentle, start, gentle(start), replace(proposals, power=1.0))
    np.testing.assert_allclose(flattened.log_ratios, expected.log_ratios)


def test_the_start_is_left_as_it_is():
    start = sample_uniform_weights(3, 4, rng=np.random.default_rng(0))
    before = start.copy()
    walk(flat, start, flat(start), draw_proposals(0, dim=4))
    np.testing.assert_array_equal(start, before)


def test_impossible_weights_are_never_visited():
    def only_positive_first(weights):
        return np.where(weights[:, 0] > 0.0, 0.0, -np.inf)

    start = np.tile([1.0, 0.0, 0.0], (4, 1))
    proposals = draw_proposals(0, dim=3, num_steps=500, num_chains=4)
    walked = walk(only_positive_first, start, np.zeros(4), proposals)
    assert (walked.states[..., 0] > 0.0).all()


@pytest.mark.parametrize("target_acceptance", [0.234, None])
def test_chain_in_three_dimensions_has_the_moments_of_the_target(target_acceptance):
    draws = sample_uniform_weights(400_000, 3, rng=np.random.default_rng(0))
    probabilities = np.exp(tilted(draws))
    probabilities /= probabilities.sum()
    config = replace(MANY_CHAINS, target_acceptance=target_acceptance)
    found = sample(tilted, 3, config).states.reshape(-1, 3)
    for power in (1, 2):
        expected = probabilities @ draws**power
        np.testing.assert_allclose((found**power).mean(axis=0), expected, atol=0.01)


def grid_of_weights_and_scales():
    """Two weights and a logarithm of the scale; the prior on 200 x 400 cells."""
    first = (np.arange(200) + 0.5) / 100 - 1.0  # Uniform on [-1, 1].
    log_scales = math.log(2.0) + (np.arange(400) - 199.5) / 250
    cells = np.stack(np.meshgrid(first, log_scales, indexing="ij"), axis=-1)
    magnitudes = 1.0 - np.abs(cells[..., 0])
    points = np.stack([cells[..., 0], magnitudes, cells[..., 1]], axis=-1)
    prior = np.exp(-0.5 * ((cells[..., 1] - math.log(2.0)) / 0.4) ** 2)
    return points.reshape(-1, 3), prior / prior.sum()


@pytest.mark.parametrize(
    "log_likelihood",
    [
        flat,
        lambda states: -8.0 * (states[:, 2] - 1.0) ** 2,
        lambda states: 1.5 * states[:, 0] * np.exp(states[:, 2]),
    ],
    ids=["flat", "of the scale alone", "of weights times scale"],
)
def test_weights_and_scale_follow_their_joint_posterior(log_likelihood):
    points, prior = grid_of_weights_and_scales()
    density = prior * np.exp(log_likelihood(points)).reshape(prior.shape)
    expected = density.reshape(4, 50, 8, 50).sum(axis=(1, 3)) / density.sum()

    states = sample(log_likelihood, 2, MANY_CHAINS, scale_prior=SCALE_PRIOR).states
    np.testing.assert_allclose(np.abs(states[..., :2]).sum(axis=-1), 1.0)
    edges = [np.linspace(-1.0, 1.0, 5), math.log(2.0) + np.linspace(-0.8, 0.8, 9)]
    found = np.histogram2d(*states.reshape(-1, 3)[:, [0, 2]].T, bins=edges)[0]
    np.testing.assert_allclose(found / states[..., 0].size, expected, atol=0.005)


def test_evidence_averages_over_the_scale_as_well():
    def log_likelihood(states):
        return 1.5 * states[:, 0] * np.exp(states[:, 2])

    points, prior = grid_of_weights_and_scales()
    expected = prior.ravel() @ np.exp(log_likelihood(points))
    config = replace(ONE_BLOCK, num_particles=1000)
    found = [
        sample(log_likelihood, 2, config, scale_prior=SCALE_PRIOR, seed=seed)
        for seed in range(20)
    ]
    evidence = np.mean([np.exp(chains.log_evidence) for chains in found])
    assert evidence == pytest.approx(expected, rel=0.05)


def test_weights_beside_a_scale_keep_their_uniform_prior():
    weights = sample(flat, 2, MANY_CHAINS, scale_prior=SCALE_PRIOR).states[..., :2]
    found = (
        np.histogram(weights[..., 0], bins=8, range=(-1, 1))[0] / weights[..., 0].size
    )
    np.testing.assert_allclose(found, 1 / 8, atol=0.01)


def test_prior_of_the_scale_is_part_of_the_state():
    mover = RandomWalk(flat, 3, ONE_BLOCK, SCALE_PRIOR)
    states = mover.prior.draw(50, rng=np.random.default_rng(0))
    assert states.shape == (50, 4)
    np.testing.assert_allclose(np.abs(states[:, :3]).sum(axis=1), 1.0)
    expected = SCALE_PRIOR.log_density(states[:, 3])
    np.testing.assert_array_equal(mover.prior.log_density(states), expected)
    assert np.ptp(expected) > 0.5


def test_prior_of_weights_alone_is_flat():
    mover = RandomWalk(flat, 3, ONE_BLOCK)
    states = mover.prior.draw(50, rng=np.random.default_rng(0))
    assert states.shape == (50, 3)
    np.testing.assert_array_equal(mover.prior.log_density(states), np.zeros(50))


@pytest.mark.parametrize("target_acceptance", [0.15, 0.4])
def test_proposals_adapt_to_the_acceptance_that_is_asked_for(target_acceptance):
    config = McmcConfig(
        num_steps=6000,
        burn_in=3000,
        target_ess=None,
        target_acceptance=target_acceptance,
    )

    def log_likelihood(weights):
        return -100.0 * np.square(weights - [0.4, -0.3, 0.2, 0.1]).sum(axis=1)

    chains = sample(log_likelihood, 4, config)
    assert chains.acceptance_rate == pytest.approx(target_acceptance, abs=0.04)


@pytest.mark.parametrize("num_particles", [0, 128])
@pytest.mark.parametrize("step_std", [1e-3, 0.05, 5.0])
def test_burn_in_adapts_the_acceptance_to_its_target(step_std, num_particles):
    config = McmcConfig(
        num_steps=4000,
        burn_in=2000,
        num_particles=num_particles,
        step_std=step_std,
        target_ess=None,
    )
    chains = sample(lambda w: 40.0 * w[:, 0], DIM, config)
    assert chains.acceptance_rate == pytest.approx(0.234, abs=0.08)


def test_longer_steps_are_accepted_less_often():
    config = replace(
        ONE_BLOCK, num_chains=20, num_steps=500, num_samples=20, target_acceptance=None
    )
    rates = [
        sample(flat, DIM, replace(config, step_std=step_std)).acceptance_rate
        for step_std in (0.01, 0.05, 0.2)
    ]
    assert rates == sorted(rates, reverse=True)
    assert rates[0] > 0.8


def steps_after(mover, walked, *, is_annealing=True):
    """Return the steps that a mover proposes after it has adapted, shape (S, 3)."""
    mover.adapt(walked, is_annealing=is_annealing)
    proposals = mover._propose(2, 50_000, 1.0, np.random.default_rng(0))
    return proposals.steps.reshape(-1, 3)


def correlated(num_steps, num_chains, *, seed=0):
    """A shape of three dimensions, and a walk of independent states that have it."""
    shape = np.array([[1.0, 0.0, 0.0], [0.9, 0.3, 0.0], [-0.5, 0.2, 0.1]])
    rng = np.random.default_rng(seed)
    states = rng.standard_normal((num_steps, num_chains, 3)) @ shape.T
    nothing = np.zeros((num_steps, num_chains))
    return shape @ shape.T, Walk(states, nothing, nothing)


@pytest.mark.parametrize(
    ("size", "is_annealing"), [((1, 40_000), True), ((250, 80), False)]
)
def test_proposals_take_the_shape_of_what_was_visited(size, is_annealing):
    covariance, walked = correlated(*size)
    mover = RandomWalk(flat, 3, McmcConfig())
    steps = steps_after(mover, walked, is_annealing=is_annealing)
    found = np.cov(steps, rowvar=False)
    found *= np.trace(covariance) / np.trace(found)
    np.testing.assert_allclose(found, covariance, atol=0.03)


@pytest.mark.parametrize("num_particles", [0, 128])
def test_shape_adapts_in_the_burn_in_whether_annealed_or_not(num_particles):
    """The likelihood is flat, so that the annealing has no shape to give."""

    def log_prior(weights):
        errors = (weights - [0.4, 0.3, 0.3]) / [0.01, 0.1, 0.1]
        return -0.5 * np.square(errors).sum(axis=1)

    config = McmcConfig(num_steps=1100, num_particles=num_particles)
    mover = RandomWalk(flat, 3, config)
    rng = np.random.default_rng(0)
    run_chains(WithPrior(mover, log_prior), config, rng=rng)
    spreads = mover._propose(2, 1000, 1.0, rng).steps.std(axis=(0, 1))
    assert spreads[0] < 0.5 * spreads[1]


def test_size_of_a_new_shape_is_that_of_optimal_scaling():
    covariance, walked = correlated(1, 40_000)
    mover = RandomWalk(flat, 3, McmcConfig())
    steps = steps_after(mover, walked)
    expected = 2.38**2 / 3 * covariance
    np.testing.assert_allclose(np.cov(steps, rowvar=False), expected, atol=0.05)


def test_steps_of_the_scale_do_not_lean_on_those_of_the_weights():
    covariance, walked = correlated(1, 40_000)
    mover = RandomWalk(flat, 2, McmcConfig(), SCALE_PRIOR)
    steps = steps_after(mover, walked)
    expected = 2.38**2 / 3 * covariance
    expected[:2, 2] = expected[2, :2] = 0.0
    np.testing.assert_allclose(np.cov(steps, rowvar=False), expected, atol=0.05)


def test_fixed_proposals_never_adapt():
    _, walked = correlated(250, 80)
    config = McmcConfig(target_acceptance=None, step_std=0.05)
    steps = steps_after(RandomWalk(flat, 3, config), walked)
    expected = 0.05**2 * np.eye(3)
    np.testing.assert_allclose(np.cov(steps, rowvar=False), expected, atol=1e-4)


def test_a_likelihood_that_takes_the_steps_itself_is_left_to_it():
    class Own:
        def __call__(self, states):
            return tilted(states)

        def walk(self, start, log_likelihoods, proposals):
            self.proposals = proposals
            return walk(tilted, start, log_likelihoods, proposals)

    own = Own()
    found = sample(own, 4, ONE_BLOCK).states
    assert own.proposals.steps.shape == (40, 3, 4)
    np.testing.assert_array_equal(found, sample(tilted, 4, ONE_BLOCK).states)
