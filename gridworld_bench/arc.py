r"""Active Reward learning from Critiques (Cui & Niekum 2018), by reweighting one chain.

A pair's gain is what its label, good or bad, tells of the reward: :math:`I(l; w) =
H(\bar p) - \overline{H(p)}`, with p the probability that a sample gives the action. A path
takes the pair of most gain in each state, and goes on as if that had got its likelier
label: samples are weighed by it, where the original samples fresh chains.
"""

import numpy as np

from gridworld_bench.mdp import Mdp
from gridworld_bench.outlook import MdpOutlook
from gridworld_bench.posterior import BETA, MdpPosterior
from gridworld_bench.queries import LENGTH, Query, step
from tablesetting.irl.arrays import Array
from tablesetting.irl.risk import RiskConfig

NUM_STARTS = 8
"""Initial states, drawn at random, from which paths are built."""


def propose_informative_paths(
    mdp: Mdp, posterior: MdpPosterior, rng: np.random.Generator
) -> list[Query]:
    """Build a path from some initial states, each by the greatest gain."""
    starts = rng.permutation(mdp.initial_states)[:NUM_STARTS]
    outlook = MdpOutlook(mdp, [], posterior, BETA)
    return [_build_path(outlook, int(start), rng) for start in starts]


def score_arc(outlook: MdpOutlook, risk: RiskConfig, rng: np.random.Generator) -> Array:
    """Score paths by the sum of the gains of their pairs, one after the other.

    Args:
        outlook: What the posterior says of Q critique queries.
        risk: Not used.
        rng: Not used.

    Returns:
        Gains, shape (Q,), in nats.
    """
    return np.array([_gain_of_path(outlook, query) for query in outlook.queries])


def information(good: Array, shares: Array) -> Array:
    """Return what labels tell of the reward.

    Args:
        good: Probability of each label being good under each sample, shape (M, ...).
        shares: Probability of each sample, of sum 1, shape (M,).

    Returns:
        Mutual information of each label and the sample, shape (...), in nats.
    """
    mean = np.tensordot(shares, good, axes=1)
    return _entropy(mean) - np.tensordot(shares, _entropy(good), axes=1)


def _entropy(chances: Array) -> Array:
    """Return the entropy of events of such probability, in nats."""
    others = 1.0 - chances
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = chances * np.log(chances), others * np.log(others)
    return -np.nan_to_num(terms[0]) - np.nan_to_num(terms[1])


def _build_path(outlook: MdpOutlook, start: int, rng: np.random.Generator) -> Query:
    mdp, (rows, counts) = outlook.mdp, outlook.distinct_rows
    shares = counts / counts.sum()
    states, actions, state = list[int](), list[int](), start
    while len(states) < LENGTH:
        good = outlook.action_probabilities([state], rows)[:, 0]
        action = int(information(good, shares).argmax())
        states.append(state)
        actions.append(action)
        if mdp.is_terminal[state]:
            break
        shares = _weigh_by_label(shares, good[:, action])
        state = step(mdp, state, action, rng=rng)
    return Query(np.array(states), np.array(actions))


def _gain_of_path(outlook: MdpOutlook, query: Query) -> float:
    rows, counts = outlook.distinct_rows
    shares, total = counts / counts.sum(), 0.0
    assert query.actions is not None
    chances = outlook.action_probabilities(query.states, rows)
    for k, action in enumerate(query.actions):
        good = chances[:, k, action]
        total += float(information(good, shares))
        shares = _weigh_by_label(shares, good)
    return total


def _weigh_by_label(shares: Array, good: Array) -> Array:
    """Weigh samples as if a pair had got its likelier label."""
    is_good = float(shares @ good) >= 0.5
    weighed = shares * (good if is_good else 1.0 - good)
    return weighed / weighed.sum()
