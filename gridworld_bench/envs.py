"""Worlds as Gymnasium environments; needs the extra `tablesetting[drive]`.

Importing this module registers `gridworld_bench/Highway-v0`.
"""

from contextlib import ExitStack
from typing import Any, Literal

try:
    import gymnasium as gym
    from gymnasium import spaces
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "the environments need Gymnasium; install it by "
        "`pip install 'tablesetting[drive]'`",
        name=error.name,
    ) from error

from gridworld_bench.highway import DRIVERS, Highway, driver_weights
from gridworld_bench.mdp import Mdp
from gridworld_bench.road_picture import Picture, draw_road
from gridworld_bench.window import Window, open_window
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


class HighwayEnv(MdpEnv):
    """The highway; the reward is what a scripted driver wants, as there is no true one.

    Attributes:
        highway: The road.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array", "human"],
        "render_fps": 4,
    }

    def __init__(
        self,
        length: int = 10,
        driver: str = "safe",
        render_mode: Literal["rgb_array", "human"] | None = None,
    ):
        """Make the environment.

        Args:
            length: How many steps ahead the road is seen.
            driver: Whose reward it is, see `highway.DRIVERS`.
            render_mode: A picture on demand, or a window, which needs
                `tablesetting[drive]`.

        Raises:
            ValueError: If there is no such length, driver or mode.
        """
        if driver not in DRIVERS:
            raise ValueError(
                f"`driver` must be one of {', '.join(DRIVERS)}; got {driver!r}"
            )
        modes = (None, *self.metadata["render_modes"])
        if render_mode not in modes:
            raise ValueError(
                f"`render_mode` must be one of {modes}; got {render_mode!r}"
            )
        self.highway = Highway(length)
        super().__init__(self.highway.mdp, driver_weights(driver))
        self.render_mode = render_mode
        self._num_steps = 0
        self._window: Window | None = None
        self._opened = ExitStack()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[int, dict[str, Any]]:
        """Start anywhere.

        Raises:
            NoWindow: If the mode is "human" and no window can be opened.
        """
        found = super().reset(seed=seed, options=options)
        self._num_steps = 0
        self._show()
        return found

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        """Drive one step; driving never ends."""
        found = super().step(action)
        self._num_steps += 1
        self._show()
        return found

    def render(self) -> Picture | None:
        """Return a picture in the mode "rgb_array"; a window shows it by itself."""
        if self.render_mode != "rgb_array":
            return None
        situation = self.highway.situations[self._state]
        return draw_road(situation, self.highway.length, self._num_steps)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._window = None
        self._opened.close()

    def _show(self) -> None:
        if self.render_mode == "human":
            if self._window is None:
                opened = open_window(
                    self.highway.length, (), remedy="choose the render_mode rgb_array"
                )
                self._window = self._opened.enter_context(opened)
            situation = self.highway.situations[self._state]
            self._window.show(situation, self._num_steps)
            self._window.wait_for_frame(self.metadata["render_fps"])


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
            if chance > 0.0:  # Else it only fills a row.
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


if "gridworld_bench/Highway-v0" not in gym.registry:
    gym.register(
        "gridworld_bench/Highway-v0",
        entry_point="gridworld_bench.envs:HighwayEnv",
        max_episode_steps=1000,
    )
