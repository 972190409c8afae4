"""Active learning of a reward in an MDP, as `tablesetting.irl.active` runs it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import cast

import numpy as np

from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import (
    Mdp,
    Solution,
    best_policy,
    feature_expectations,
    random_policy_features,
    solve,
)
from gridworld_bench.outlook import MdpOutlook
from gridworld_bench.posterior import (
    BETA,
    ChainConfig,
    CoordinateChain,
    MdpPosterior,
    infer,
)
from gridworld_bench.queries import Query, propose_states
from tablesetting.irl.arrays import Array, Indices
from tablesetting.irl.posterior import Posterior

Proposer = Callable[[Mdp, MdpPosterior, np.random.Generator], list[Query]]
"""Makes the candidate queries of a round."""


@dataclass(frozen=True)
class MdpConfig:
    """How a reward is learned."""

    chain: ChainConfig = field(default_factory=CoordinateChain)
    """The paper's chain, or the sound one."""
    beta: float = BETA
    """Rationality of the demonstrator."""


class MdpProblem:
    """A world with a demonstrator who knows what is wanted there.

    Implements `irl.active.Problem`.

    Attributes:
        mdp: The world.
        truth: What is best for the demonstrator.
        config: How the reward is learned.
    """

    def __init__(
        self,
        mdp: Mdp,
        true_weights: Array,
        config: MdpConfig,
        propose: Proposer = propose_states,
    ):
        """Solve the world for the demonstrator.

        Args:
            mdp: The world.
            true_weights: What is wanted, shape (D,).
            config: How the reward is learned.
            propose: Makes the candidate queries.
        """
        self.mdp = mdp
        self.true_weights = true_weights
        self.truth: Solution = solve(mdp, mdp.rewards(true_weights))
        self.config = config
        self._propose = propose

    @cached_property
    def random_features(self) -> Array:
        """Feature expectations of acting uniformly at random, shape (S, D)."""
        return random_policy_features(self.mdp)

    def infer(
        self,
        demos: Sequence[Evidence],
        previous: Posterior | None,
        *,
        rng: np.random.Generator,
    ) -> MdpPosterior:
        """Sample the posterior; what it was before does not matter."""
        config = self.config
        return infer(self.mdp, demos, config.chain, beta=config.beta, rng=rng)

    def propose_queries(
        self,
        demos: Sequence[Evidence],
        posterior: Posterior,
        *,
        rng: np.random.Generator,
    ) -> list[Query]:
        """Make the candidates."""
        return self._propose(self.mdp, cast(MdpPosterior, posterior), rng)

    def outlook(self, queries: Sequence[Query], posterior: Posterior) -> MdpOutlook:
        """Return what the posterior says of the candidates."""
        return MdpOutlook(self.mdp, queries, cast(MdpPosterior, posterior))

    def demonstrate(self, query: Query, *, rng: np.random.Generator) -> Evidence:
        """Ask the demonstrator: for a best action, or which pairs are as good as any."""
        is_optimal = self.truth.is_optimal
        if query.actions is None:
            best = np.flatnonzero(is_optimal[query.start])
            return Evidence.of_pairs([(query.start, int(rng.choice(best)))])
        return Evidence(
            query.states, query.actions, is_optimal[query.states, query.actions]
        )

    def demonstrate_first(self, num: int, *, rng: np.random.Generator) -> Evidence:
        """Draw best actions in distinct states, as many as are asked for."""
        states = rng.choice(self.mdp.num_states, size=num, replace=False)
        return Evidence.join(
            [self.demonstrate(Query(np.array([state])), rng=rng) for state in states]
        )

    def policy_losses(self, posterior: Posterior) -> Array:
        """Return what the robot's policy truly loses in each initial state, (I,)."""
        policy = best_policy(self.mdp, posterior.guessed_weights)
        return self.losses_of_policy(policy)

    def losses_of_policy(self, policy: Indices) -> Array:
        """Return what a policy truly loses in each initial state, shape (I,)."""
        values = feature_expectations(self.mdp, policy) @ self.true_weights
        return (self.truth.values - values)[self.mdp.initial_states]
