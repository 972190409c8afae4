r"""Active Reward learning from Critiques (Cui & Niekum 2018).

A path takes the pair of most gain in each state, and goes on as if that had got its
likelier label. There are two gains:

- the fast one weighs the samples of the one chain. What a label, good or bad, tells of the
  reward is :math:`I(l; w) = H(\bar p) - \overline{H(p)}`, with p the probability that a
  sample gives the action;
- the faithful one is the mean divergence of the posterior after each label from that
  before, each sampled by a fresh chain, by nearest neighbours (Wang, Kulkarni & Verdu
  2009).
"""

import numpy as np
from scipy.spatial.distance import cdist

from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import Mdp
from gridworld_bench.outlook import MdpOutlook, action_probabilities
from gridworld_bench.posterior import BETA, CoordinateChain, MdpPosterior, infer
from gridworld_bench.queries import LENGTH, Query, step
from tablesetting.irl.arrays import Array
from tablesetting.irl.risk import RiskConfig

NUM_STARTS = 8
"""Initial states, drawn at random, from which paths are built."""

_MOST_SAMPLES = 2000  # Distinct ones that gains are means over.
_NEIGHBOUR = 4  # Which nearest one a density is read from.


def propose_informative_paths(
    mdp: Mdp, posterior: MdpPosterior, rng: np.random.Generator
) -> list[Query]:
    """Build a path from some initial states, each by the greatest fast gain."""
    starts = rng.permutation(mdp.initial_states)[:NUM_STARTS]
    samples, paths = _Reweighted(mdp, posterior), []
    for start in starts:
        samples.restart()
        paths.append(_build_path(mdp, samples, int(start), rng))
    return paths


def propose_faithful_paths(
    mdp: Mdp,
    posterior: MdpPosterior,
    rng: np.random.Generator,
    *,
    num_samples: int = 1000,
) -> list[Query]:
    """Build such paths by the faithful gain.

    Args:
        mdp: The world.
        posterior: The posterior, of which the evidence is used.
        rng: Source of the starts and of all chains.
        num_samples: Samples of each fresh chain.
    """
    starts = rng.permutation(mdp.initial_states)[:NUM_STARTS]
    return [
        _build_path(
            mdp,
            _Fresh(mdp, posterior.evidence, posterior.beta, num_samples, rng),
            int(s),
            rng,
        )
        for s in starts
    ]


def score_gain(
    outlook: MdpOutlook, risk: RiskConfig, rng: np.random.Generator
) -> Array:
    """Score paths by the sum of the gains that they were built by.

    Args:
        outlook: Has Q critique queries.
        risk: Not used.
        rng: Not used.

    Returns:
        Gains, shape (Q,), in nats.
    """
    return np.array([query.gain for query in outlook.queries])


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


def gain_of_path(mdp: Mdp, posterior: MdpPosterior, query: Query) -> float:
    """Return the sum of the fast gains of a path, by any posterior, in nats."""
    assert query.actions is not None
    samples, total = _Reweighted(mdp, posterior), 0.0
    for state, action in zip(query.states, query.actions, strict=True):
        total += float(samples.gains(int(state))[action])
        samples.suppose(int(state), int(action))
    return total


def faithful_gain(
    mdp: Mdp,
    evidence: Evidence,
    pair: tuple[int, int],
    num_samples: int,
    *,
    beta: float = BETA,
    rng: np.random.Generator,
) -> float:
    """Return the faithful gain of one pair, by fresh chains, in nats."""
    samples = _Fresh(mdp, evidence, beta, num_samples, rng)
    return float(samples.gains(pair[0], [pair[1]])[0])


def nearest_neighbour_divergence(samples: Array, others: Array) -> float:
    r"""Estimate the Kullback-Leibler divergence of two densities from draws of each.

    :math:`\frac{d - 1}{n} \sum_i \log \frac{\nu_k(i)}{\rho_k(i)} + \log \frac{m}{n - 1}`, with
    :math:`\rho_k` and :math:`\nu_k` the distances to the k-th nearest of the other draws
    and of those of the second density.

    Source: Wang, Kulkarni & Verdu 2009, with k = 4.

    Args:
        samples: Distinct draws of the first density, on the L1 sphere, which has a
            dimension less, shape (n, d).
        others: Distinct draws of the second one, shape (m, d).

    Returns:
        The divergence, in nats; it can be negative. 0 with too few draws.
    """
    num, dim = len(samples), samples.shape[1] - 1
    if min(num, len(others)) <= _NEIGHBOUR:
        return 0.0
    own = np.partition(cdist(samples, samples), _NEIGHBOUR, axis=1)[:, _NEIGHBOUR]
    to_others = np.partition(cdist(samples, others), _NEIGHBOUR - 1, axis=1)
    ratios = np.maximum(to_others[:, _NEIGHBOUR - 1], 1e-12) / np.maximum(own, 1e-12)
    return float(dim * np.log(ratios).mean() + np.log(len(others) / (num - 1)))


class _Reweighted:
    """The samples of one chain, weighed by labels that are supposed."""

    def __init__(self, mdp: Mdp, posterior: MdpPosterior):
        rows, counts = posterior.distinct_rows
        stride = -(-len(rows) // _MOST_SAMPLES)
        rows, counts = rows[::stride], counts[::stride]
        self._mdp = mdp
        self._beta = posterior.beta
        self._values = posterior.optimal_values[rows]
        self._counts = counts / counts.sum()
        self._known: dict[int, Array] = {}
        self.restart()

    def restart(self) -> None:
        """Suppose no label."""
        self._shares = self._counts

    def gains(self, state: int) -> Array:
        """Return the gain of each action."""
        return information(self._good(state), self._shares)

    def suppose(self, state: int, action: int) -> None:
        """Go on as if a pair had got its likelier label."""
        good = self._good(state)[:, action]
        is_good = float(self._shares @ good) >= 0.5
        weighed = self._shares * (good if is_good else 1.0 - good)
        self._shares = weighed / weighed.sum()

    def _good(self, state: int) -> Array:
        if state not in self._known:
            chances = action_probabilities(self._mdp, [state], self._values, self._beta)
            self._known[state] = chances[:, 0]
        return self._known[state]


class _Fresh:
    """Chains that are run anew for every label that is supposed."""

    def __init__(
        self,
        mdp: Mdp,
        evidence: Evidence,
        beta: float,
        num_samples: int,
        rng: np.random.Generator,
    ):
        self._mdp = mdp
        self._beta = beta
        self._evidence = evidence
        self._chain = CoordinateChain(num_samples=num_samples)
        self._rng = rng
        self._posterior = self._sample(evidence)

    def gains(self, state: int, actions: list[int] | None = None) -> Array:
        """Return the gain of each action, or of some."""
        chosen = range(self._mdp.num_actions) if actions is None else actions
        return np.array([self._gain(state, action) for action in chosen])

    def suppose(self, state: int, action: int) -> None:
        """Go on as if a pair had got its likelier label."""
        is_good = self._chance(state, action) >= 0.5
        self._evidence = self._with(state, action, is_good)
        self._posterior = self._sample(self._evidence)

    def _gain(self, state: int, action: int) -> float:
        chance, total = self._chance(state, action), 0.0
        before = self._posterior.weights[self._posterior.distinct_rows[0]]
        for is_good, share in ((True, chance), (False, 1.0 - chance)):
            if share > 0.0:
                found = self._sample(self._with(state, action, is_good))
                after = found.weights[found.distinct_rows[0]]
                total += share * nearest_neighbour_divergence(after, before)
        return total

    def _chance(self, state: int, action: int) -> float:
        values = self._posterior.optimal_values
        good = action_probabilities(self._mdp, [state], values, self._beta)[
            :, 0, action
        ]
        return float(good.mean())

    def _with(self, state: int, action: int, is_good: bool) -> Evidence:
        label = Evidence.of_pairs([(state, action)], is_good)
        return Evidence.join([self._evidence, label])

    def _sample(self, evidence: Evidence) -> MdpPosterior:
        return infer(self._mdp, [evidence], self._chain, beta=self._beta, rng=self._rng)


def _build_path(
    mdp: Mdp, samples: _Reweighted | _Fresh, start: int, rng: np.random.Generator
) -> Query:
    states, actions, state, total = list[int](), list[int](), start, 0.0
    while len(states) < LENGTH:
        gains = samples.gains(state)
        states.append(state)
        actions.append(int(gains.argmax()))
        total += float(gains.max())
        if mdp.is_terminal[state]:
            break
        samples.suppose(state, actions[-1])
        state = step(mdp, state, actions[-1], rng=rng)
    return Query(np.array(states), np.array(actions), total)


def _entropy(chances: Array) -> Array:
    """Return the entropy of events of such probability, in nats."""
    others = 1.0 - chances
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = chances * np.log(chances), others * np.log(others)
    return -np.nan_to_num(terms[0]) - np.nan_to_num(terms[1])
