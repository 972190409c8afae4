"""Questions to a demonstrator: which action is best, and which of a path are good."""

from dataclasses import dataclass

import numpy as np

from gridworld_bench.mdp import Mdp, best_policy
from gridworld_bench.posterior import MdpPosterior
from tablesetting.irl.arrays import Indices

LENGTH = 8
"""Pairs of a path that is to be judged."""


@dataclass(frozen=True)
class Query:
    """An action query, or a critique query if it has actions.

    Attributes:
        states: The state that is asked about, or those of a path, shape (L,).
        actions: What is done in each, shape (L,); None asks for the best action.
        gain: What its answer would tell, in nats, where it was made for that.
    """

    states: Indices
    actions: Indices | None = None
    gain: float = 0.0

    @property
    def start(self) -> int:
        """The first state."""
        return int(self.states[0])

    def distinct_pairs(self) -> tuple[Indices, Indices]:
        """Return states and actions of a path, each pair once."""
        assert self.actions is not None
        pairs = np.unique(np.stack([self.states, self.actions], axis=1), axis=0)
        return pairs[:, 0], pairs[:, 1]


def propose_states(
    mdp: Mdp, posterior: MdpPosterior, rng: np.random.Generator
) -> list[Query]:
    """Ask for the best action in any initial state."""
    return [Query(np.array([state])) for state in mdp.initial_states]


def propose_roll_outs(
    mdp: Mdp, posterior: MdpPosterior, rng: np.random.Generator
) -> list[Query]:
    """Ask for a critique of the robot's policy, from any initial state."""
    policy = best_policy(mdp, posterior.guessed_weights)
    return [roll_out(mdp, policy, int(start), rng=rng) for start in mdp.initial_states]


def roll_out(
    mdp: Mdp,
    policy: Indices,
    start: int,
    length: int = LENGTH,
    *,
    rng: np.random.Generator,
) -> Query:
    """Follow a policy; a terminal state ends the path."""
    states, actions, state = list[int](), list[int](), start
    for _ in range(length):
        states.append(state)
        actions.append(int(policy[state]))
        if mdp.is_terminal[state]:
            break
        state = step(mdp, state, actions[-1], rng=rng)
    return Query(np.array(states), np.array(actions))


def step(mdp: Mdp, state: int, action: int, *, rng: np.random.Generator) -> int:
    """Draw the state that an action leads to."""
    chances = mdp.probabilities[state, action]
    if len(chances) == 1:
        return int(mdp.successors[state, action, 0])
    chances = chances / chances.sum()
    return int(rng.choice(mdp.successors[state, action], p=chances))
