"""Finite MDPs with rewards that are linear in features of the state, solved exactly."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array, eye_array
from scipy.sparse.linalg import splu

from gridworld_bench._kernels import NO_PAIRS, Unsigned, World, weigh_all
from gridworld_bench.grid import grid_successors
from tablesetting.irl.arrays import Array, Booleans, Indices

TIE = 1e-9
"""Actions whose values differ by less, relative to the largest, are equally good."""

_ROUNDING = 1e-12  # Of an improvement, relative to the values.
_MOST_DENSE = 128  # States of an uncertain world to be solved by dense linear systems.
_Outcomes = tuple[Unsigned, Unsigned, Unsigned, Array]
_NO_OUTCOMES: _Outcomes = (
    np.empty((0, 0), dtype=np.uint32),
    np.zeros(1, dtype=np.uint32),
    np.empty(0, dtype=np.uint32),
    np.empty(0),
)


@dataclass(frozen=True)
class Mdp:
    r"""A finite MDP; the reward of state s is :math:`R(s) = w \cdot \phi(s)`.

    A policy collects the reward of the state that it is in and then moves on, but for
    terminal states, where it ends: :math:`V(s) = R(s) + \gamma \sum_{s'} P(s' | s, a)
    V(s')`.

    Attributes:
        successors: States that an action leads to, shape (S, A, B).
        probabilities: How probable each of them is, of sum 1 over the last axis, shape
            (S, A, B).
        features: Features of each state, shape (S, D).
        discount: Discount, in [0, 1).
        initial_states: States in which an episode can start, shape (I,).
        is_terminal: Where an episode ends, shape (S,).
    """

    successors: Indices
    probabilities: Array
    features: Array
    discount: float
    initial_states: Indices
    is_terminal: Booleans

    def __post_init__(self) -> None:
        num_states = len(self.features)
        shape = self.successors.shape
        if len(shape) != 3 or shape[0] != num_states or self.features.ndim != 2:
            raise ValueError(
                f"`successors` must have the shape (S, A, B) and `features` (S, D); got "
                f"{shape} and {self.features.shape}"
            )
        if self.probabilities.shape != shape or self.is_terminal.shape != (num_states,):
            raise ValueError(
                f"`probabilities` must have the shape {shape} and `is_terminal` "
                f"({num_states},); got {self.probabilities.shape} and "
                f"{self.is_terminal.shape}"
            )
        for name in ("successors", "initial_states"):
            states = getattr(self, name)
            if not states.size or states.min() < 0 or states.max() >= num_states:
                raise ValueError(
                    f"`{name}` must be states, at least one, below {num_states}"
                )
        if (
            not np.allclose(self.probabilities.sum(axis=-1), 1.0, rtol=0.0, atol=1e-9)
            or (self.probabilities < 0.0).any()
        ):
            raise ValueError(
                "`probabilities` must be 0 or more, of sum 1 for each action"
            )
        if not self.features.shape[1] or not np.isfinite(self.features).all():
            raise ValueError("`features` must be finite, at least one of each state")
        if not 0.0 <= self.discount < 1.0:
            raise ValueError(f"`discount` must be in [0, 1); got {self.discount}")

    @property
    def num_states(self) -> int:
        """Number of states, S."""
        return len(self.features)

    @property
    def num_actions(self) -> int:
        """Number of actions, A."""
        return self.successors.shape[1]

    @property
    def num_features(self) -> int:
        """Number of features, D."""
        return self.features.shape[1]

    @cached_property
    def continuations(self) -> Array:
        """The discount; 0 where an episode ends, shape (S,)."""
        return np.where(self.is_terminal, 0.0, self.discount)

    @cached_property
    def compiled(self) -> World:
        """The world as the kernels take it."""
        return _compile(self)

    def rewards(self, weights: Array) -> Array:
        """Return the reward of every state, shape (..., S), of weights (..., D)."""
        return weights @ self.features.T

    def transitions(self, policy: Indices) -> csr_array:
        """Return where a policy, shape (S,), leads from each state, (S, S), sparse."""
        rows = np.arange(self.num_states)
        columns, chances = (
            self.successors[rows, policy],
            self.probabilities[rows, policy],
        )
        rows = np.repeat(rows, columns.shape[1])
        shape = (self.num_states, self.num_states)
        return csr_array((chances.ravel(), (rows, columns.ravel())), shape=shape)


@dataclass(frozen=True)
class Solution:
    """What is best for one reward.

    Attributes:
        values: Optimal value of each state, shape (S,).
        q_values: Value of each action and the best ones after it, shape (S, A).
        policy: A best action for each state, shape (S,).
    """

    values: Array
    q_values: Array
    policy: Indices

    @cached_property
    def is_optimal(self) -> Booleans:
        """Which actions are as good as any, shape (S, A)."""
        best = self.q_values.max(axis=1, keepdims=True)
        return self.q_values >= best - TIE * max(1.0, float(np.abs(best).max()))


def q_values(mdp: Mdp, rewards: Array, values: Array) -> Array:
    """Return the value of each action, shape (S, A), with `values` (S,) after it."""
    expected = (mdp.probabilities * values[mdp.successors]).sum(axis=-1)
    return rewards[:, None] + mdp.continuations[:, None] * expected


def feature_expectations(mdp: Mdp, policy: Indices) -> Array:
    """Return the discounted features that a policy collects from each state.

    Its value under any weights w is that times w: one solve serves all rewards.

    Args:
        mdp: The MDP.
        policy: An action for each state, shape (S,).

    Returns:
        Feature expectations, shape (S, D).
    """
    return _discounted(mdp, mdp.transitions(policy), mdp.features)


def random_policy_features(mdp: Mdp) -> Array:
    """Return the feature expectations of acting uniformly at random, shape (S, D)."""
    num = mdp.num_actions
    mean = sum(
        (mdp.transitions(np.full(mdp.num_states, a)) for a in range(num)),
        start=csr_array((mdp.num_states, mdp.num_states)),
    )
    return _discounted(mdp, mean / num, mdp.features)


def solve(mdp: Mdp, rewards: Array, policy: Indices | None = None) -> Solution:
    """Find an optimal policy by policy iteration.

    Args:
        mdp: The MDP; its features are not used.
        rewards: Reward of each state, shape (S,).
        policy: Where to start, shape (S,); the first action everywhere if None.

    Returns:
        Exact values and a best policy.
    """
    states = np.arange(mdp.num_states)
    policy = (
        np.zeros(mdp.num_states, dtype=np.intp) if policy is None else policy.copy()
    )
    while True:
        values = _discounted(mdp, mdp.transitions(policy), rewards)
        of_actions = q_values(mdp, rewards, values)
        better = of_actions.argmax(axis=1)
        gains = of_actions[states, better] - of_actions[states, policy]
        is_better = gains > _ROUNDING * max(1.0, float(np.abs(values).max()))
        if not is_better.any():
            return Solution(values, of_actions, policy)
        policy[is_better] = better[is_better]


def optimal_values(mdp: Mdp, weights: Array) -> Array:
    """Return optimal values, (N, S), of many rewards, (N, D), by compiled code."""
    return weigh_all(mdp.compiled, mdp.rewards(weights), NO_PAIRS, 1.0)[1]


def best_policy(mdp: Mdp, weights: Array) -> Indices:
    """Return a best policy, shape (S,), for weights of shape (D,), by compiled code."""
    values = optimal_values(mdp, weights[None])[0]
    return q_values(mdp, mdp.rewards(weights), values).argmax(axis=1)


def _discounted(
    mdp: Mdp, transitions: csr_array, collected: npt.NDArray[np.float64]
) -> Array:
    """Sum what is collected in each state, (S,) or (S, D), along a Markov chain."""
    steps = transitions.multiply(mdp.continuations[:, None])
    system = splu((eye_array(mdp.num_states) - steps).tocsc())
    return np.asarray(system.solve(collected))


def _compile(mdp: Mdp) -> World:
    """Return a world as the kernels take it."""
    is_certain = mdp.successors.shape[2] == 1
    nexts = np.empty((0, 0), dtype=np.uint32)
    if is_certain:
        nexts = np.ascontiguousarray(mdp.successors[:, :, 0].T.astype(np.uint32))
    sides = _sides(mdp) if is_certain and not mdp.is_terminal.any() else (0, 0)
    outcomes, starts, reached, chances = _NO_OUTCOMES
    if not is_certain and mdp.num_states > _MOST_DENSE:
        outcomes, starts, reached, chances = _outcomes(mdp)
    return World(
        nexts,
        mdp.successors,
        mdp.probabilities,
        mdp.continuations,
        *sides,
        outcomes,
        starts,
        reached,
        chances,
    )


def _outcomes(mdp: Mdp) -> _Outcomes:
    """List what actions can lead to, each outcome once, as `World` has it."""
    num_states, num_actions, _ = mdp.successors.shape
    is_used = mdp.probabilities > 0.0
    successors = np.where(is_used, mdp.successors, num_states)
    order = successors.argsort(axis=-1, kind="stable")
    rows = np.concatenate(
        [
            np.take_along_axis(successors, order, axis=-1),
            np.take_along_axis(mdp.probabilities, order, axis=-1),
        ],
        axis=-1,
    ).reshape(num_states * num_actions, -1)
    distinct, outcomes = np.unique(rows, axis=0, return_inverse=True)
    reached, chances = np.hsplit(distinct, 2)
    is_used = chances > 0.0
    starts = np.concatenate([[0], is_used.sum(axis=1).cumsum()])
    return (
        outcomes.reshape(num_states, num_actions).astype(np.uint32),
        starts.astype(np.uint32),
        reached[is_used].astype(np.uint32),
        chances[is_used],
    )


def _sides(mdp: Mdp) -> tuple[int, int]:
    """Return rows and columns of a world that is a plain grid; zeros of another."""
    if mdp.num_actions == 4:
        num_states = mdp.num_states
        for num_rows in range(1, num_states + 1):
            if num_states % num_rows == 0:
                sides = num_rows, num_states // num_rows
                if np.array_equal(mdp.successors, grid_successors(*sides)):
                    return sides
    return 0, 0
