import numpy as np
import pytest
from scipy.optimize import linprog
from worlds import KINDS, random_weights, small_world

from gridworld_bench import _kernels
from gridworld_bench.gridworlds import barrier_world, example_world, make_grid
from gridworld_bench.likelihood import Evidence, MdpLikelihood
from gridworld_bench.mdp import (
    Mdp,
    best_policy,
    feature_expectations,
    optimal_values,
    random_policy_features,
    solve,
)


def by_linear_program(mdp, rewards):
    """Find optimal values as the least that no action exceeds."""
    num = mdp.num_states
    rows, bounds = [], []
    for state in range(num):
        for action in range(mdp.num_actions):
            row = np.zeros(num)
            row[state] -= 1.0
            for there, chance in zip(
                mdp.successors[state, action],
                mdp.probabilities[state, action],
                strict=True,
            ):
                row[there] += mdp.continuations[state] * chance
            rows.append(row)
            bounds.append(-rewards[state])
    free = [(None, None)] * num
    options = {
        "dual_feasibility_tolerance": 1e-10,
        "primal_feasibility_tolerance": 1e-10,
    }
    return linprog(np.ones(num), rows, bounds, bounds=free, options=options).x


@pytest.mark.parametrize("kind", KINDS)
def test_optimal_values_are_those_of_a_linear_program(kind):
    for seed in range(5):
        mdp, weights = small_world(kind, seed)
        rewards = mdp.rewards(weights)
        expected = by_linear_program(mdp, rewards)
        np.testing.assert_allclose(solve(mdp, rewards).values, expected, atol=1e-9)


def test_two_states_by_hand():
    """One can stay for 1 a step, or leave for 10 once."""
    mdp = Mdp(
        successors=np.array([[[0], [1]], [[1], [1]]]),
        probabilities=np.ones((2, 2, 1)),
        features=np.eye(2),
        discount=0.5,
        initial_states=np.array([0]),
        is_terminal=np.array([False, True]),
    )
    solution = solve(mdp, np.array([1.0, 10.0]))
    np.testing.assert_allclose(solution.values, [6.0, 10.0])
    np.testing.assert_allclose(solution.q_values, [[4.0, 6.0], [10.0, 10.0]])
    assert solution.policy[0] == 1
    assert solution.is_optimal.tolist() == [[False, True], [True, True]]


@pytest.mark.parametrize("kind", KINDS)
def test_compiled_code_finds_the_same(kind):
    mdp, _ = small_world(kind)
    weights = random_weights(20, mdp.num_features)
    for each, values in zip(weights, optimal_values(mdp, weights), strict=True):
        expected = solve(mdp, mdp.rewards(each)).values
        np.testing.assert_allclose(values, expected, atol=1e-11)
        found = feature_expectations(mdp, best_policy(mdp, each)) @ each
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_one_policy_is_valued_under_every_reward_at_once(kind):
    mdp, _ = small_world(kind)
    rng = np.random.default_rng(3)
    policy = rng.integers(mdp.num_actions, size=mdp.num_states)
    weights = random_weights(4, mdp.num_features)
    values = weights @ feature_expectations(mdp, policy).T
    reached = mdp.transitions(policy).toarray()
    for each, found in zip(weights, values, strict=True):
        expected = np.zeros(mdp.num_states)
        for _ in range(2000):
            expected = mdp.rewards(each) + mdp.continuations * (reached @ expected)
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_no_policy_is_worth_more_than_the_best_and_a_warm_start_finds_it_too(kind):
    mdp, weights = small_world(kind)
    best = solve(mdp, mdp.rewards(weights))
    rng = np.random.default_rng(3)
    for _ in range(20):
        policy = rng.integers(mdp.num_actions, size=mdp.num_states)
        values = feature_expectations(mdp, policy) @ weights
        assert (values <= best.values + 1e-12).all()
        warm = solve(mdp, mdp.rewards(weights), policy)
        np.testing.assert_allclose(warm.values, best.values, atol=1e-12)
    assert (random_policy_features(mdp) @ weights <= best.values + 1e-12).all()


def test_a_step_off_the_grid_stays_in_place():
    mdp = make_grid(np.zeros((6, 1)), 3)
    assert mdp.successors[..., 0].tolist() == [
        [0, 3, 0, 1],
        [1, 4, 0, 2],
        [2, 5, 1, 2],
        [0, 3, 3, 4],
        [1, 4, 3, 5],
        [2, 5, 4, 5],
    ]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"discount": 1.0}, "discount"),
        ({"probabilities": np.full((6, 4, 1), 0.5)}, "sum 1"),
        ({"probabilities": np.ones((6, 4, 2))}, "shape"),
        ({"successors": np.full((6, 4, 1), 6)}, "below 6"),
        ({"initial_states": np.array([], dtype=int)}, "at least one"),
        ({"features": np.full((6, 1), np.nan)}, "finite"),
        ({"features": np.zeros((5, 1))}, "shape"),
    ],
)
def test_what_is_no_mdp_is_refused(change, message):
    known = vars(make_grid(np.zeros((6, 1)), 3))
    with pytest.raises(ValueError, match=message):
        Mdp(**known | change)


def test_a_barrier_has_to_be_crossed_to_what_is_wanted():
    for seed in range(20):
        mdp, weights = barrier_world(7, 4, rng=np.random.default_rng(seed))
        colors = mdp.features.argmax(axis=1).reshape(7, 7)
        assert (colors[3] >= 2).all()
        assert set(colors[3]) == set(range(2, 6))
        assert (colors == 0).sum() == mdp.is_terminal.sum() == 1
        assert mdp.is_terminal[:7][colors[0] == 0].all()
        assert weights[0] > 0.0 > weights[1:].max()
        assert np.abs(weights).sum() == pytest.approx(1.0)


def test_the_example_starts_in_white_and_wants_green():
    mdp, weights = example_world()
    colors = mdp.features.argmax(axis=1)
    assert (colors[mdp.initial_states] == 0).all()
    assert colors[solve(mdp, mdp.rewards(weights)).values.argmax()] == 2


@pytest.mark.parametrize("kind", ["grid", "ends"])
def test_features_are_expected_along_paths_as_by_linear_algebra(kind):
    mdp, _ = small_world(kind)
    world = mdp.compiled
    for seed in range(20):
        policy = np.random.default_rng(seed).integers(mdp.num_actions, size=16)
        choice = world.nexts[policy, np.arange(16)]
        found = np.full(mdp.features.shape, np.nan)
        order, mark = np.empty((2, 16), dtype=np.uint32)
        _kernels._expect_features(
            choice, world.continuations, mdp.features, found, order, mark
        )
        expected = feature_expectations(mdp, policy)
        np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_sweeps_give_up_no_reward_that_is_likely_enough():
    """Where nothing mixes the bound is tight: values start too far apart here."""
    num = 200
    successors = np.tile(np.arange(num)[:, None, None], (1, 2, 2))
    successors[0] = [[1, 1], [2, 2]]
    mdp = Mdp(
        successors,
        np.full((num, 2, 2), 0.5),
        np.r_[0.0, 1.0, -1.0, np.zeros(num - 3)][:, None],
        discount=0.9,
        initial_states=np.arange(num),
        is_terminal=np.zeros(num, dtype=bool),
    )
    likelihood = MdpLikelihood(mdp, Evidence.of_pairs([(0, 1)]), 1.0)
    (exact,), _ = likelihood.weigh(np.ones((1, 1)))
    assert exact == pytest.approx(-18.0)  # The values are 10 and -10, discounted.
    for margin, is_enough in ((0.001, True), (-0.001, False)):
        found = _kernels._weigh_by_sweeps(
            mdp.compiled,
            0.9,
            mdp.features[:, 0].copy(),
            likelihood._pairs,
            1.0,
            exact - margin,
            100.0 * mdp.features[:, 0],
            _kernels._workspace(mdp.compiled),
        )
        assert np.isfinite(found) == is_enough
