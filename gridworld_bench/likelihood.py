r"""How probable a demonstrator's answers are, given reward weights.

A demonstrator of rationality :math:`\beta` takes action a in state s with probability
:math:`p(a | s, w) \propto \exp(\beta Q^*_w(s, a))` (Ramachandran & Amir 2007). A pair that
is called good counts :math:`\log p`, one that is called bad :math:`\log(1 - p)` (Cui &
Niekum 2018).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gridworld_bench import _kernels
from gridworld_bench._kernels import Pairs
from gridworld_bench.mdp import Mdp
from tablesetting.irl.arrays import Array, Booleans, Indices
from tablesetting.irl.random_walk import Proposals
from tablesetting.irl.sampler import Walk


@dataclass(frozen=True)
class Evidence:
    """State-action pairs that a demonstrator has called good or bad.

    Attributes:
        states: State of each pair, shape (K,).
        actions: Action of each pair, shape (K,).
        is_good: Whether it is what the demonstrator wants, shape (K,).
    """

    states: Indices
    actions: Indices
    is_good: Booleans

    @classmethod
    def of_pairs(
        cls, pairs: Sequence[tuple[int, int]], is_good: bool = True
    ) -> "Evidence":
        """Make evidence of (state, action) pairs that are all good, or all bad."""
        states, actions = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        return cls(states, actions, np.full(len(pairs), is_good))

    @classmethod
    def join(cls, parts: Sequence["Evidence"]) -> "Evidence":
        """Put evidence together."""
        return cls(
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("states", "actions", "is_good")
            )
        )


class MdpLikelihood:
    """Log likelihood of evidence, of a batch of reward weights.

    Implements `irl.random_walk.Walker`: steps that cannot be taken are not solved to
    their end.

    Attributes:
        mdp: The world.
        evidence: All that the demonstrator has said.
        beta: Rationality of the demonstrator.
    """

    def __init__(self, mdp: Mdp, evidence: Evidence, beta: float):
        self.mdp = mdp
        self.evidence = evidence
        self.beta = beta

    def __call__(self, weights: Array) -> Array:
        """Evaluate weights, shape (C, D), as shape (C,)."""
        return self.weigh(weights)[0]

    def weigh(self, weights: Array) -> tuple[Array, Array]:
        """Return log likelihoods, (N,), and optimal values, (N, S), of weights (N, D)."""
        rewards = self.mdp.rewards(weights)
        return _kernels.weigh_all(self.mdp.compiled, rewards, self._pairs, self.beta)

    def walk(self, start: Array, log_likelihoods: Array, proposals: Proposals) -> Walk:
        """Take steps as `irl.random_walk.walk` does.

        Ratios are those of the decisions, 0 and minus infinity: a step that is given up
        has no other.
        """
        states, logs, is_taken = _kernels.walk_sphere(
            self.mdp.compiled,
            self._columns,
            self._pairs,
            self.beta,
            start,
            log_likelihoods,
            proposals.steps,
            proposals.squared_noise,
            proposals.log_uniforms,
            proposals.is_prior_uniform,
            proposals.power,
        )
        return Walk(states, logs, np.where(is_taken, 0.0, -np.inf))

    def walk_coordinates(
        self,
        start: Array,
        coordinates: Indices,
        steps: Array,
        log_uniforms: Array,
        thinning: int,
    ) -> tuple[Array, Array, Array, Array, float, int]:
        """Walk the paper's chain, see `_kernels.walk_coordinates`."""
        return _kernels.walk_coordinates(
            self.mdp.compiled,
            self._columns,
            self._pairs,
            self.beta,
            start,
            coordinates,
            steps,
            log_uniforms,
            thinning,
        )

    @cached_property
    def _columns(self) -> Array:
        return np.ascontiguousarray(self.mdp.features.T)

    @cached_property
    def _pairs(self) -> Pairs:
        """Distinct pairs with how often each occurs, as the kernels take them."""
        signs = np.where(self.evidence.is_good, 1, -1)
        stacked = np.stack([self.evidence.states, self.evidence.actions, signs], axis=1)
        distinct, counts = np.unique(stacked, axis=0, return_counts=True)
        states, actions, signs = distinct.T
        nexts = self.mdp.compiled.nexts
        paths = np.empty((len(distinct), len(nexts)), dtype=np.uint32)
        for row, state, action in zip(paths, states, actions, strict=True):
            if len(nexts):
                row[0] = nexts[action, state]
                row[1:] = np.delete(nexts[:, state], action)
        return Pairs(
            states.astype(np.uint32),
            actions.astype(np.uint32),
            np.ascontiguousarray(signs),
            counts.astype(np.float64),
            paths,
        )
