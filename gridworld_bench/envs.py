"""Worlds as Gymnasium environments; needs the extra `tablesetting[gym]`."""

from typing import Any

import gymnasium as gym
from gymnasium import spaces

from gridworld_bench.mdp import Mdp
from tablesetting.irl.arrays import Array

Outcome = tuple[float, int, float, bool]
"""Probability, next state, reward and whether it ends there."""


class MdpEnv(gym.Env[Any, Any]):
    r"""A world with a reward, in the manner of Gymnasium's toy text environments.

    A step gives the reward of the state that is left. One that ends the episode adds
    that of the terminal state, discounted, so that the discounted sum of all rewards is
    :math:`V(s)` of `gridworld_bench.mdp`, unless the episode starts where it ends.

    Attributes:
        P: For each state and action, the outcomes: `P[state][action]`.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, mdp: Mdp, weights: Array):
        """Make the environment.

        Args:
            mdp: The world.
            weights: Reward weights, shape (D,).
        """
        self.mdp = mdp
        self.observation_space = spaces.Discrete(mdp.num_states)
        self.action_space = spaces.Discrete(mdp.num_actions)
        self.P = tabulate(mdp, weights)
        self._state = int(mdp.initial_states[0])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[int, dict[str, Any]]:
        """Start in one of the initial states."""
        super().reset(seed=seed)
        self._state = int(self.np_random.choice(self.mdp.initial_states))
        return self._state, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        """Act; return state, reward, whether it ends, False, and the probability."""
        outcomes = self.P[self._state][int(action)]
        chosen = self.np_random.choice(len(outcomes), p=[each[0] for each in outcomes])
        probability, self._state, reward, is_end = outcomes[chosen]
        return self._state, reward, is_end, False, {"prob": probability}


def tabulate(mdp: Mdp, weights: Array) -> dict[int, dict[int, list[Outcome]]]:
    """List the outcomes of each action in each state."""
    rewards = mdp.rewards(weights)

    def outcomes(state: int, action: int) -> list[Outcome]:
        chances: dict[int, float] = {}
        total = float(mdp.probabilities[state, action].sum())
        for there, chance in zip(
            mdp.successors[state, action].tolist(),
            mdp.probabilities[state, action].tolist(),
            strict=True,
        ):
            chances[there] = chances.get(there, 0.0) + chance / total
        if mdp.is_terminal[state]:
            return [(1.0, state, 0.0, True)]
        return [
            (
                chance,
                there,
                float(
                    rewards[state]
                    + mdp.is_terminal[there] * mdp.discount * rewards[there]
                ),
                bool(mdp.is_terminal[there]),
            )
            for there, chance in chances.items()
        ]

    return {
        state: {action: outcomes(state, action) for action in range(mdp.num_actions)}
        for state in range(mdp.num_states)
    }
