import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import (
    KINDS,
    mixed_evidence,
    plain_log_likelihood,
    random_weights,
    small_world,
    world_of_eight,
)

from gridworld_bench.gridworlds import make_grid
from gridworld_bench.likelihood import Evidence, MdpLikelihood
from gridworld_bench.mdp import optimal_values, solve
from gridworld_bench.posterior import CoordinateChain, _choose_distinct, infer
from tablesetting.irl.random_walk import Proposals, walk
from tablesetting.irl.sampler import McmcConfig


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("beta", [1.0, 100.0])
def test_the_compiled_likelihood_is_the_plain_one(kind, beta):
    mdp, truth = small_world(kind)
    evidence = mixed_evidence(mdp, truth)
    weights = random_weights(30, mdp.num_features)
    logs, values = MdpLikelihood(mdp, evidence, beta).weigh(weights)
    for each, log, found in zip(weights, logs, values, strict=True):
        np.testing.assert_allclose(
            found, solve(mdp, mdp.rewards(each)).values, atol=1e-11
        )
        expected = plain_log_likelihood(mdp, evidence, beta, each)
        assert log == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_two_actions_by_hand():
    """Right leads to 2, half of which counts."""
    mdp = make_grid(
        np.array([[0.0], [0.0], [2.0]]), 3, terminal_states=[0, 2], discount=0.5
    )
    good = MdpLikelihood(mdp, Evidence.of_pairs([(1, 3)]), 1.0)
    # Up and down stay, where going right later is worth 1.
    others = np.exp([0.0, 0.5, 0.5]).sum()
    chance = np.exp(1.0) / (np.exp(1.0) + others)
    assert good(np.ones((1, 1)))[0] == pytest.approx(np.log(chance))
    bad = MdpLikelihood(mdp, Evidence.of_pairs([(1, 3)], is_good=False), 1.0)
    assert bad(np.ones((1, 1)))[0] == pytest.approx(np.log(1.0 - chance))


@pytest.mark.parametrize("power", [1.0, 0.3, 0.0])
@pytest.mark.parametrize("kind", KINDS)
def test_steps_that_are_given_up_change_nothing(kind, power):
    mdp, truth = small_world(kind)
    likelihood = MdpLikelihood(mdp, mixed_evidence(mdp, truth), 20.0)
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((150, 3, mdp.num_features))
    proposals = Proposals(
        steps=0.05 * noise,
        squared_noise=np.square(noise).sum(axis=-1),
        log_uniforms=-rng.standard_exponential((150, 3)),
        is_prior_uniform=True,
        power=power,
    )
    start = random_weights(3, mdp.num_features)
    found = likelihood.walk(start, likelihood(start), proposals)
    expected = walk(likelihood, start, likelihood(start), proposals)
    np.testing.assert_allclose(found.states, expected.states, atol=1e-12)
    np.testing.assert_allclose(
        found.log_likelihoods, expected.log_likelihoods, atol=1e-8
    )


def plain_coordinate_chain(mdp, evidence, start, coordinates, steps, log_uniforms):
    state, kept = start, []
    here = plain_log_likelihood(mdp, evidence, 100.0, state)
    for moved, step, log_uniform in zip(coordinates, steps, log_uniforms, strict=True):
        proposal = state.copy()
        proposal[moved] = np.clip(proposal[moved] + step, -1.0, 1.0)
        proposal /= np.abs(proposal).sum()
        there = plain_log_likelihood(mdp, evidence, 100.0, proposal)
        if log_uniform < there - here:
            state, here = proposal, there
        kept.append(state)
    return np.array(kept)


@pytest.mark.parametrize("kind", KINDS)
def test_the_chain_of_the_paper_is_the_plain_one(kind):
    mdp, truth = small_world(kind)
    evidence = mixed_evidence(mdp, truth)
    rng = np.random.default_rng(5)
    coordinates = _choose_distinct((300, 2), mdp.num_features, rng=rng)
    steps = rng.choice([-0.05, 0.05], size=(300, 2))
    log_uniforms = -rng.standard_exponential(300)
    start = -np.full(mdp.num_features, 1.0 / mdp.num_features)
    likelihood = MdpLikelihood(mdp, evidence, 100.0)
    kept, values, logs, best, best_log, num_accepted = likelihood.walk_coordinates(
        start, coordinates, steps, log_uniforms, 3
    )
    expected = plain_coordinate_chain(
        mdp, evidence, start, coordinates, steps, log_uniforms
    )
    np.testing.assert_allclose(kept, expected[2::3], atol=1e-10)
    assert (
        num_accepted
        == (np.diff(expected, axis=0, prepend=start[None]) != 0).any(axis=1).sum()
    )
    for each, found, log in zip(kept[::7], values[::7], logs[::7], strict=True):
        np.testing.assert_allclose(
            found, solve(mdp, mdp.rewards(each)).values, atol=1e-9
        )
        assert log == pytest.approx(plain_log_likelihood(mdp, evidence, 100.0, each))
    assert best_log >= logs.max()
    assert best_log == pytest.approx(plain_log_likelihood(mdp, evidence, 100.0, best))


@given(st.integers(1, 9), st.integers(0, 9), st.integers(0, 1000))
def test_distinct_coordinates_are_chosen_evenly(num_chosen, more, seed):
    num = num_chosen + more
    rng = np.random.default_rng(seed)
    chosen = _choose_distinct((50, num_chosen), num, rng=rng)
    assert ((chosen >= 0) & (chosen < num)).all()
    assert all(len(set(row)) == num_chosen for row in chosen.tolist())


def test_every_set_of_coordinates_is_as_likely():
    chosen = _choose_distinct((60_000, 2), 4, rng=np.random.default_rng(0))
    sets = np.sort(chosen, axis=1) @ [4, 1]
    counts = np.unique(sets, return_counts=True)[1]
    assert len(counts) == 6
    assert np.abs(counts - 10_000).max() < 500


def test_only_a_plain_grid_is_swept():
    for kind in KINDS:
        world = small_world(kind)[0].compiled
        sides = (world.num_rows, world.num_columns)
        assert sides == ((4, 4) if kind == "grid" else (0, 0))
    world = make_grid(np.zeros((12, 1)), 4).compiled
    assert (world.num_rows, world.num_columns) == (3, 4)


@pytest.mark.parametrize(
    "config",
    [CoordinateChain(num_samples=400), McmcConfig(num_steps=2500, target_ess=None)],
)
def test_the_posterior_explains_what_was_shown(config):
    mdp, truth = world_of_eight(0)
    policy = solve(mdp, mdp.rewards(truth)).policy
    shown = Evidence.of_pairs([(9, policy[9]), (30, policy[30])])
    posterior = infer(mdp, [shown], config, rng=np.random.default_rng(0))
    again = infer(mdp, [shown], config, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(posterior.weights, again.weights)
    np.testing.assert_allclose(np.abs(posterior.weights).sum(axis=1), 1.0)
    guess = solve(mdp, mdp.rewards(posterior.map_weights))
    assert guess.is_optimal[shown.states, shown.actions].all()
    for each, values in zip(
        posterior.weights[::50], posterior.optimal_values[::50], strict=True
    ):
        np.testing.assert_allclose(
            values, solve(mdp, mdp.rewards(each)).values, atol=1e-10
        )


def test_the_sound_chain_samples_the_posterior():
    """Against a sum over a fine grid of directions, in two dimensions."""
    mdp = make_grid(np.random.default_rng(0).random((9, 2)), 3)
    evidence = Evidence.of_pairs([(0, 3), (4, 1)])
    likelihood = MdpLikelihood(mdp, evidence, 3.0)
    steps = np.linspace(-1.0, 1.0, 4001)
    half = np.stack([steps, 1.0 - np.abs(steps)], axis=1)
    directions = np.concatenate([half, -half])
    shares = np.exp(likelihood(directions))
    shares /= shares.sum()
    posterior = infer(
        mdp, [evidence], McmcConfig(), beta=3.0, rng=np.random.default_rng(0)
    )
    assert posterior.is_sound
    expected = shares @ directions
    deviation = np.sqrt(shares @ (directions - expected) ** 2)
    errors = np.abs(posterior.weights.mean(axis=0) - expected)
    assert (errors < 4.0 * deviation / np.sqrt(posterior.kept_ess)).all()


@pytest.mark.parametrize("kind", ["slip", "slip and ends"])
def test_a_large_uncertain_world_is_solved_by_sweeps_alike(kind, monkeypatch):
    expected_mdp, weights = small_world(kind)
    expected = optimal_values(expected_mdp, random_weights(20, 6))
    evidence = mixed_evidence(expected_mdp, weights)
    chain = CoordinateChain(num_samples=100)
    rng = np.random.default_rng
    dense = infer(expected_mdp, [evidence], chain, rng=rng(0))
    monkeypatch.setattr("gridworld_bench.mdp._MOST_DENSE", 0)
    mdp, _ = small_world(kind)
    assert len(mdp.compiled.starts) > 1
    found = optimal_values(mdp, random_weights(20, 6))
    np.testing.assert_allclose(found, expected, atol=1e-6)
    swept = infer(mdp, [evidence], chain, rng=rng(0))
    np.testing.assert_allclose(swept.weights, dense.weights, atol=1e-9)
    np.testing.assert_allclose(swept.log_posts, dense.log_posts, atol=1e-4)
