from itertools import product

import numpy as np
import pytest
from scipy.special import digamma
from worlds import KINDS, small_world, world_of_eight

from gridworld_bench.arc import (
    faithful_gain,
    gain_of_path,
    information,
    nearest_neighbour_divergence,
    propose_faithful_paths,
    propose_informative_paths,
    score_gain,
)
from gridworld_bench.mdp import feature_expectations, solve
from gridworld_bench.posterior import CoordinateChain
from gridworld_bench.problem import MdpConfig, MdpProblem
from gridworld_bench.queries import Query, roll_out
from gridworld_bench.strategies import (
    ACTION_METHODS,
    CRITIQUE_METHODS,
    score_active_sampling,
)
from tablesetting.irl.active import run_active
from tablesetting.irl.risk import RiskConfig
from tablesetting.irl.strategies import STRATEGIES

RISK = RiskConfig()
SHORT = MdpConfig(CoordinateChain(num_samples=300))


def problem_of(kind, method=None, seed=0):
    mdp, truth = small_world(kind, seed)
    propose = {} if method is None else {"propose": method.propose}
    return MdpProblem(mdp, truth, SHORT, **propose)


def posterior_of(problem, num=3):
    first = problem.demonstrate_first(num, rng=np.random.default_rng(0))
    return problem.infer([first], None, rng=np.random.default_rng(1))


@pytest.mark.parametrize("kind", KINDS)
def test_losses_are_those_of_a_direct_evaluation(kind):
    """And never negative; the highest 0.95-quantile is asked about."""
    for seed in range(25):
        problem = problem_of(kind, seed=seed)
        mdp, posterior = problem.mdp, posterior_of(problem)
        queries = problem.propose_queries([], posterior, rng=np.random.default_rng(0))
        outlook = problem.outlook(queries, posterior)
        policy = solve(mdp, mdp.rewards(posterior.map_weights)).policy
        collected = feature_expectations(mdp, policy)
        chosen = range(0, 300, 60)
        for sample in chosen:
            weights = posterior.weights[sample]
            best = solve(mdp, mdp.rewards(weights)).values
            expected = (best - collected @ weights)[mdp.initial_states]
            np.testing.assert_allclose(outlook.losses[:, sample], expected, atol=1e-9)
        assert (outlook.losses >= 0.0).all()
        scores = STRATEGIES["active-var"](outlook, RISK, np.random.default_rng(0))
        expected = np.sort(outlook.losses, axis=1)[:, 284]  # The 285th of 300.
        np.testing.assert_array_equal(scores, expected)


def test_policy_losses_are_true_ones():
    problem = problem_of("ends")
    posterior = posterior_of(problem)
    losses = problem.policy_losses(posterior)
    assert losses.shape == (3,)
    assert (losses >= -1e-12).all()
    best = solve(problem.mdp, problem.mdp.rewards(problem.true_weights))
    assert problem.losses_of_policy(best.policy) == pytest.approx(0.0)


def test_a_demonstrator_gives_best_actions_and_judges_by_them():
    problem = problem_of("grid")
    best = problem.truth.is_optimal
    for state in range(16):
        answer = problem.demonstrate(
            Query(np.array([state])), rng=np.random.default_rng(0)
        )
        assert answer.is_good.tolist() == [True]
        assert best[state, answer.actions[0]]
    path = Query(np.array([0, 1, 2]), np.array([0, 1, 2]))
    judged = problem.demonstrate(path, rng=np.random.default_rng(0))
    assert judged.is_good.tolist() == [bool(best[k, k]) for k in range(3)]
    first = problem.demonstrate_first(4, rng=np.random.default_rng(0))
    assert len(set(first.states)) == 4


def test_a_roll_out_follows_the_policy_until_it_ends():
    mdp, _ = small_world("ends")
    right = np.full(16, 3)
    path = roll_out(mdp, right, 0, rng=np.random.default_rng(0))
    assert path.states.tolist() == [0, 1, 2, 3]  # Which ends it.
    down = roll_out(mdp, np.full(16, 1), 0, rng=np.random.default_rng(0))
    assert down.states.tolist() == [0, 4, 8, *[12] * 5]
    assert down.distinct_pairs()[0].tolist() == [0, 4, 8, 12]


def test_the_chance_of_an_answer_is_that_of_the_likelihood():
    problem = problem_of("slip")
    posterior = posterior_of(problem)
    path = Query(np.array([0, 1, 0]), np.array([1, 2, 1]))
    queries = [Query(np.array([5])), path]
    outlook = problem.outlook(queries, posterior)
    actions, judgements = outlook.answers(0), outlook.answers(1)
    assert judgements.likelihoods.shape[1] == 4  # Two pairs are distinct.
    for answers in (actions, judgements):
        np.testing.assert_allclose(answers.likelihoods.sum(axis=1), 1.0)
        assert answers.probabilities.sum() == pytest.approx(1.0)
    sample = outlook._compared[7]
    q_values = solve(
        problem.mdp, problem.mdp.rewards(posterior.weights[sample])
    ).q_values
    chances = np.exp(100.0 * (q_values - q_values.max(axis=1, keepdims=True)))
    chances /= chances.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(actions.likelihoods[7], chances[5], atol=1e-9)
    expected = [
        np.prod([c if good else 1 - c for c, good in zip(pair, is_good, strict=True)])
        for pair in [(chances[0, 1], chances[1, 2])]
        for is_good in product((True, False), repeat=2)
    ]
    np.testing.assert_allclose(judgements.likelihoods[7], expected, atol=1e-9)


def test_what_a_sample_makes_of_anothers_policy():
    problem = problem_of("grid")
    posterior = posterior_of(problem)
    outlook = problem.outlook([Query(np.array([6]))], posterior)
    values, rows = outlook.values(0), outlook._compared
    mdp = problem.mdp
    for i, j in ((0, 1), (3, 9)):
        policy = solve(mdp, mdp.rewards(posterior.weights[rows[j]])).policy
        collected = feature_expectations(mdp, policy)[6]
        assert values[i, j] == pytest.approx(posterior.weights[rows[i]] @ collected)
    assert (outlook.distances(0) >= -1e-9).all()
    assert outlook.best_mean_value(0) <= np.diagonal(values).mean() + 1e-9


def test_active_sampling_is_the_entropy_of_ten_bins():
    problem = problem_of("grid")
    posterior = posterior_of(problem)
    states = [0, 7]
    outlook = problem.outlook([Query(np.array([s])) for s in states], posterior)
    scores = score_active_sampling(outlook, RISK, np.random.default_rng(0))
    chances = outlook.action_probabilities(states, np.arange(300))
    for k in range(2):
        entropies = []
        for action in range(4):
            counts = np.histogram(chances[:, k, action], bins=10, range=(0, 1))[0]
            shares = counts[counts > 0] / 300
            entropies.append(-(shares * np.log(shares)).sum())
        assert scores[k] == pytest.approx(np.mean(entropies))


@pytest.mark.parametrize("kind", KINDS)
def test_a_path_loses_what_its_distinct_pairs_do(kind):
    problem = problem_of(kind, CRITIQUE_METHODS["path-var"])
    mdp, posterior = problem.mdp, posterior_of(problem)
    queries = problem.propose_queries([], posterior, rng=np.random.default_rng(0))
    outlook = problem.outlook(queries, posterior)
    for sample in (0, 150):
        solution = solve(mdp, mdp.rewards(posterior.weights[sample]))
        for k in (0, len(queries) - 1):
            pairs = set(zip(queries[k].states, queries[k].actions, strict=True))
            expected = sum(
                solution.values[state] - solution.q_values[state, action]
                for state, action in pairs
            )
            found = outlook.path_losses[k, sample]
            assert found == pytest.approx(expected, abs=1e-9)


def test_information_of_labels_by_hand():
    shares = np.array([0.5, 0.5])
    good = np.array([[1.0, 0.5, 1.0], [0.0, 0.5, 1.0]])
    np.testing.assert_allclose(information(good, shares), [np.log(2), 0.0, 0.0])


def test_arc_takes_the_pair_of_most_gain():
    problem = problem_of("grid", CRITIQUE_METHODS["arc"])
    mdp, posterior = problem.mdp, posterior_of(problem)
    rng = np.random.default_rng(0)
    paths = propose_informative_paths(mdp, posterior, rng)
    assert len(paths) == 8
    outlook = problem.outlook(paths, posterior)
    rows, counts = posterior.distinct_rows
    assert counts.sum() == 300
    for path, score in zip(paths, score_gain(outlook, RISK, rng), strict=True):
        good = outlook.action_probabilities([path.start], rows)[:, 0]
        gains = information(good, counts / counts.sum())
        assert path.actions[0] == gains.argmax()
        assert score >= gains.max() - 1e-12
        assert gain_of_path(mdp, posterior, path) == pytest.approx(score)
        moves = mdp.successors[path.states[:-1], path.actions[:-1], 0]
        assert (moves == path.states[1:]).all()


def test_a_label_that_is_supposed_tells_nothing_more():
    problem = problem_of("grid")
    mdp, posterior = problem.mdp, posterior_of(problem)
    rng = np.random.default_rng(0)
    paths = propose_informative_paths(mdp, posterior, rng)
    path = max(paths, key=lambda path: path.gain)
    state, action = path.states[:1], path.actions[:1]
    gains = [
        gain_of_path(mdp, posterior, Query(state.repeat(num), action.repeat(num)))
        for num in (1, 300, 301)
    ]
    assert gains[0] > 0.0
    assert gains[2] - gains[1] < 0.05 * gains[0]


def test_the_divergence_of_two_densities_on_the_sphere():
    rng = np.random.default_rng(0)
    first, second = (rng.dirichlet(shape, size=2500) for shape in ([3] * 3, [1] * 3))
    same = rng.dirichlet([3] * 3, size=2500)
    assert nearest_neighbour_divergence(first, same) == pytest.approx(0.0, abs=0.1)
    # log(8! / (2! 2! 2! 2!)) + 6 (psi(3) - psi(9)), of Dirichlet densities.
    expected = np.log(40320 / 16) + 6 * (digamma(3) - digamma(9))
    found = nearest_neighbour_divergence(first, second)
    assert found == pytest.approx(expected, abs=0.1)
    assert nearest_neighbour_divergence(first[:3], second) == 0.0


def test_the_faithful_gain_is_that_of_fresh_chains():
    problem = problem_of("grid")
    mdp, evidence = problem.mdp, posterior_of(problem).evidence
    gains = [
        faithful_gain(mdp, evidence, (5, 1), 200, rng=np.random.default_rng(seed))
        for seed in (0, 0, 1)
    ]
    assert gains[0] == gains[1] != gains[2]
    paths = propose_faithful_paths(
        mdp, posterior_of(problem), np.random.default_rng(0), num_samples=30
    )
    assert all(np.isfinite(path.gain) for path in paths)


@pytest.mark.parametrize("methods", [ACTION_METHODS, CRITIQUE_METHODS])
def test_every_method_learns(methods):
    for name, method in methods.items():
        if name == "arc-faithful":
            continue  # Seconds for each query.
        problem = problem_of("grid", method)
        first = problem.demonstrate_first(1, rng=np.random.default_rng(0))
        rounds = run_active(
            problem, [first], method.score, RISK, rng=np.random.default_rng(1)
        )
        for _, latest in zip(range(4), rounds, strict=False):
            assert np.isfinite(latest.scores).all()
        assert sum(len(demo.states) for demo in latest.demos) >= 4


def test_active_var_learns_in_the_world_of_the_paper():
    mdp, truth = world_of_eight(1)
    problem = MdpProblem(mdp, truth, MdpConfig(CoordinateChain(num_samples=1500)))
    method = ACTION_METHODS["active-var"]
    first = problem.demonstrate_first(2, rng=np.random.default_rng(0))
    rounds = run_active(
        problem, [first], method.score, RISK, rng=np.random.default_rng(1)
    )
    losses = [
        problem.policy_losses(latest.posterior).mean()
        for _, latest in zip(range(13), rounds, strict=False)
    ]
    assert losses[-1] < 0.3 * losses[0]
