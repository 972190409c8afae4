"""What a posterior says of the questions that could be asked in an MDP."""

from collections.abc import Sequence
from functools import cached_property
from itertools import product

import numpy as np

from gridworld_bench.mdp import Mdp, best_policy, feature_expectations, optimal_values
from gridworld_bench.posterior import MdpPosterior
from gridworld_bench.queries import Query
from tablesetting.irl.arrays import Array, Indices
from tablesetting.irl.outlook import Answers

_NUM_COMPARED = 50  # Samples that are compared with each other.


class MdpOutlook:
    """Losses, answers and policies of the samples; implements `irl.outlook.Outlook`.

    Attributes:
        mdp: The world.
        queries: The candidates, Q of them.
        posterior: The posterior.
    """

    def __init__(self, mdp: Mdp, queries: Sequence[Query], posterior: MdpPosterior):
        self.mdp = mdp
        self.queries = queries
        self.posterior = posterior

    @property
    def num_queries(self) -> int:
        """Number of candidates, Q."""
        return len(self.queries)

    @property
    def ess(self) -> float:
        """Independent draws that the N samples are worth."""
        return self.posterior.kept_ess

    @cached_property
    def losses(self) -> Array:
        """What the robot's policy loses from each start under each sample, (Q, N)."""
        return self.losses_at(np.array([query.start for query in self.queries]))

    @property
    def deployed_losses(self) -> Array:
        """The same in the initial states, under the M samples, shape (T, M)."""
        losses = self.losses_at(self.mdp.initial_states)
        return losses[:, self._compared]

    @cached_property
    def path_losses(self) -> Array:
        r"""What the distinct pairs of each path lose under each sample, (Q, N).

        A pair loses :math:`V^*(s) - Q^*(s, a)`: what a policy loses is the discounted sum
        of these along its way (Kakade & Langford 2002). A path that runs in circles
        counts each pair once, as its label is known after that.
        """
        pairs = [np.stack(query.distinct_pairs(), axis=1) for query in self.queries]
        distinct, inverse = np.unique(
            np.concatenate(pairs), axis=0, return_inverse=True
        )
        states, actions = distinct.T
        mdp, posterior = self.mdp, self.posterior
        values = posterior.optimal_values.T
        reached = mdp.successors[states, actions]
        chances = mdp.probabilities[states, actions]
        expected = np.einsum("pb,pbn->pn", chances, values[reached])
        rewards = mdp.features[states] @ posterior.weights.T
        losses = values[states] - rewards
        losses -= mdp.continuations[states][:, None] * expected
        ends = np.cumsum([len(each) for each in pairs])[:-1]
        rows = np.split(inverse.ravel(), ends)
        return np.stack([np.maximum(losses[each], 0.0).sum(axis=0) for each in rows])

    def answers(self, query: int) -> Answers:
        """Return all answers: each action, or each way to judge the pairs of a path."""
        asked = self.queries[query]
        if asked.actions is None:
            likelihoods = self.action_probabilities([asked.start])[:, 0]
        else:
            states, actions = asked.distinct_pairs()
            good = self.action_probabilities(states)[:, np.arange(len(states)), actions]
            judged = np.array(list(product((True, False), repeat=len(states))))
            of_each = np.where(judged, good[:, None], 1.0 - good[:, None])
            likelihoods = of_each.prod(axis=-1)
        return Answers(likelihoods, likelihoods.mean(axis=0))

    def classes(self, query: int) -> Indices:
        """Return what the best policy of each sample does first, shape (M,)."""
        return self.action_probabilities([self.queries[query].start])[:, 0].argmax(
            axis=1
        )

    def values(self, query: int) -> Array:
        """Return what sample i makes of the best policy of sample j, shape (M, M)."""
        collected = self._policy_features[:, self.queries[query].start]
        weights: Array = self.posterior.weights[self._compared]
        return weights @ collected.T

    def distances(self, query: int) -> Array:
        """Return what sample i loses by the best policy of sample j, shape (M, M)."""
        values = self.values(query)
        return np.diagonal(values)[:, None] - values

    def best_mean_value(self, query: int) -> float:
        """Return the value of the best policy for the mean of the M samples."""
        return float(self._mean_values[self.queries[query].start])

    @property
    def deployed_distances(self) -> Array:
        """Return such losses, on average over the initial states, shape (M, M)."""
        collected = self._policy_features[:, self.mdp.initial_states].mean(axis=1)
        values = self.posterior.weights[self._compared] @ collected.T
        return np.diagonal(values)[:, None] - values

    def action_probabilities(
        self, states: Sequence[int] | Indices, rows: Indices | None = None
    ) -> Array:
        """Return how probable each action is under samples, shape (M, K, A).

        Args:
            states: States, K of them.
            rows: Samples, M of them; those that are compared if None.
        """
        chosen = self._compared if rows is None else rows
        values = self.posterior.optimal_values[chosen]
        return action_probabilities(self.mdp, states, values, self.posterior.beta)

    @cached_property
    def _compared(self) -> Indices:
        num = len(self.posterior.weights)
        return np.linspace(0, num - 1, min(_NUM_COMPARED, num)).astype(np.intp)

    def losses_at(self, states: Indices) -> Array:
        """Return what the robot's policy loses from some states, shape (K, N)."""
        posterior, mdp = self.posterior, self.mdp
        policy = best_policy(mdp, posterior.guessed_weights)
        collected = feature_expectations(mdp, policy)[states]
        losses = collected @ posterior.weights.T
        np.subtract(posterior.optimal_values.T[states], losses, out=losses)
        return np.maximum(losses, 0.0, out=losses)  # Rounding may be below.

    @cached_property
    def _policy_features(self) -> Array:
        """Feature expectations of the best policies of the M samples, (M, S, D)."""
        mdp, weights = self.mdp, self.posterior.weights[self._compared]
        policies = [best_policy(mdp, each) for each in weights]
        return np.stack([feature_expectations(mdp, policy) for policy in policies])

    @cached_property
    def _mean_values(self) -> Array:
        mean = self.posterior.weights[self._compared].mean(axis=0)
        return optimal_values(self.mdp, mean[None])[0]


def action_probabilities(
    mdp: Mdp, states: Sequence[int] | Indices, values: Array, beta: float
) -> Array:
    """Return how probable each action is, shape (M, K, A).

    Args:
        mdp: The world.
        states: States, K of them.
        values: Optimal values of every state, shape (M, S).
        beta: Rationality of the demonstrator.
    """
    reached = values[:, mdp.successors[states]]
    exponents = (mdp.probabilities[states] * reached).sum(axis=-1)
    exponents *= beta * mdp.continuations[states][:, None]
    exponents -= exponents.max(axis=-1, keepdims=True)
    np.exp(exponents, out=exponents)
    exponents /= exponents.sum(axis=-1, keepdims=True)
    return exponents
