"""Small worlds of every kind, and plain code that fast code is held against."""

import numpy as np

from gridworld_bench.gridworlds import make_grid, random_world
from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import solve

KINDS = {
    "grid": {},
    "slip": {"slip": 0.3},
    "ends": {"terminal_states": [3, 10], "initial_states": [0, 1, 8]},
    "slip and ends": {"slip": 0.1, "terminal_states": [7], "discount": 0.8},
}


def small_world(kind, seed=0, num_features=6):
    """Make a world of 4 x 4 cells, with true weights."""
    rng = np.random.default_rng(seed)
    weights = rng.laplace(size=num_features)
    features = rng.random((16, num_features))
    return make_grid(features, 4, **KINDS[kind]), weights / np.abs(weights).sum()


def random_weights(num, dim, seed=1):
    weights = np.random.default_rng(seed).laplace(size=(num, dim))
    return weights / np.abs(weights).sum(axis=1, keepdims=True)


def mixed_evidence(mdp, weights, seed=2):
    """Judge some pairs, one of them twice, half of them bad."""
    rng = np.random.default_rng(seed)
    policy = solve(mdp, mdp.rewards(weights)).policy
    states = rng.choice(mdp.num_states, size=6, replace=False)
    good = Evidence(states[:3], policy[states[:3]], np.ones(3, dtype=bool))
    actions = (policy[states[3:]] + 1) % mdp.num_actions
    bad = Evidence(states[3:], actions, np.zeros(3, dtype=bool))
    return Evidence.join(
        [good, bad, Evidence.of_pairs([(states[0], policy[states[0]])])]
    )


def plain_log_likelihood(mdp, evidence, beta, weights):
    """Evaluate one reward as the formulas say."""
    q_values = beta * solve(mdp, mdp.rewards(weights)).q_values
    total = 0.0
    for state, action, is_good in zip(
        evidence.states, evidence.actions, evidence.is_good, strict=True
    ):
        others = np.delete(q_values[state], action) - q_values[state, action]
        log_odds = np.logaddexp.reduce(others)  # Against the action.
        total -= np.logaddexp(0.0, log_odds if is_good else -log_odds)
    return total


def world_of_eight(seed):
    return random_world(rng=np.random.default_rng(seed))
