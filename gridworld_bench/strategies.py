"""Which question to ask next in an MDP: strategies of the table, and three of its own."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gridworld_bench.arc import (
    propose_faithful_paths,
    propose_informative_paths,
    score_gain,
)
from gridworld_bench.outlook import MdpOutlook
from gridworld_bench.problem import Proposer
from gridworld_bench.queries import propose_roll_outs, propose_states
from tablesetting.irl.arrays import Array
from tablesetting.irl.risk import RiskConfig, value_at_risk
from tablesetting.irl.strategies import STRATEGIES

_NUM_BINS = 10

Score = Callable[[Any, RiskConfig, np.random.Generator], Array]


@dataclass(frozen=True)
class Method:
    """How questions are made, and which of them is asked."""

    propose: Proposer
    """Makes the candidates."""
    score: Score
    """Scores them; the highest is asked."""


def score_active_sampling(
    outlook: MdpOutlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    """Score states by how undecided the samples are about what to do there.

    For each action, the probability that each sample gives it is sorted into ten bins;
    the score is the entropy of these histograms, on average over the actions.

    Source: Lopes, Melo & Montesano 2009.

    Args:
        outlook: What the posterior says of Q candidates.
        risk: Not used.
        rng: Not used.

    Returns:
        Entropies, shape (Q,), in nats.
    """
    rows, counts = outlook.posterior.distinct_rows
    states = np.array([query.start for query in outlook.queries])
    chances = outlook.action_probabilities(states, rows)
    num_cells = chances[0].size
    bins = np.minimum((_NUM_BINS * chances).astype(np.intp), _NUM_BINS - 1)
    bins += _NUM_BINS * np.arange(num_cells).reshape(chances[0].shape)
    filled = np.bincount(
        bins.ravel(),
        weights=np.repeat(counts, num_cells),
        minlength=_NUM_BINS * num_cells,
    )
    shares = filled.reshape(*chances[0].shape, _NUM_BINS) / counts.sum()
    logs = np.log(shares, out=np.zeros_like(shares), where=shares > 0.0)
    return np.asarray(-(shares * logs).sum(axis=-1).mean(axis=-1))


def score_path_var(
    outlook: MdpOutlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    r"""Score paths by the :math:`\alpha`-VaR of what their distinct pairs lose.

    The loss from a start, which `active-var` looks at, is dominated by the circle that
    the robot's policy ends in. To have that judged again tells nothing, so here each pair
    counts once.

    Args:
        outlook: What the posterior says of Q critique queries.
        risk: The quantile.
        rng: Not used.

    Returns:
        Value at risk, shape (Q,), in the unit of the reward.
    """
    return value_at_risk(outlook.path_losses, risk.alpha, rank_offset=risk.rank_offset)


_SHARED = ("active-var", "random", "cvar", "information-gain", "max-regret")

ACTION_METHODS: Mapping[str, Method] = {
    **{name: Method(propose_states, STRATEGIES[name]) for name in _SHARED},
    "active-sampling": Method(propose_states, score_active_sampling),
}
"""For action queries, by name."""

CRITIQUE_METHODS: Mapping[str, Method] = {
    **{name: Method(propose_roll_outs, STRATEGIES[name]) for name in _SHARED},
    "path-var": Method(propose_roll_outs, score_path_var),
    "arc": Method(propose_informative_paths, score_gain),
    "arc-faithful": Method(propose_faithful_paths, score_gain),
}
"""For critique queries, by name."""
