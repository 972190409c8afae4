"""The arm's joints as a Gymnasium environment."""

from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium import spaces

from tablesetting.envs.picture import RENDER_MODE, Painter, Pixels
from tablesetting.irl.arrays import Array
from tablesetting.scene.environment import CONTROL_TIMESTEP, load

_BOUNDS: Final = {
    "arm_position": 8.0 * np.pi,
    "arm_velocity": 50.0,
    "jaw_opening": 0.1,
    "tool_position": 2.0,
    "item_position": 2.0,
    "item_quaternion": 1.0,
    "object_positions": 2.0,
}
"""Observations are clipped here; what lies on the table never gets there."""


class JointEnv(gymnasium.Env[dict[str, Any], Any]):
    """Move the joints at 25 Hz so that the item comes to stand where the person wants it.

    Observation and reward are those of `tablesetting.scene.load`. An action in [-1, 1],
    shape (7,), spans the ranges of the six joints' servos and the jaw's; see
    `action_for`. The episode is truncated at the time limit, and terminated if the
    simulation diverges.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012, as the base class has it.
        "render_modes": [RENDER_MODE],
        "render_fps": round(1.0 / CONTROL_TIMESTEP),
    }

    def __init__(self, task: str, *, render_mode: str | None = None) -> None:
        """Set the table.

        Args:
            task: One of `tablesetting.reward.tasks.TASKS`.
            render_mode: "rgb_array" for pictures by `render`.

        Raises:
            TableSettingError: If there is no such task, or MuJoCo cannot draw here.
            ValueError: If `render_mode` is another.
        """
        self._environment = load(task)
        self._painter = Painter(self._environment.physics.model.ptr, render_mode)
        self.render_mode = render_mode
        self._is_over = True
        servos = self._environment.action_spec()
        self._center = (servos.maximum + servos.minimum) / 2.0
        self._reach = (servos.maximum - servos.minimum) / 2.0
        self.action_space = spaces.Box(-1.0, 1.0, servos.shape, np.float32)
        self.observation_space = spaces.Dict(
            {
                name: spaces.Box(-_BOUNDS[name], _BOUNDS[name], view.shape, np.float32)
                for name, view in self._environment.observation_spec().items()
            }
        )

    def action_for(self, joints: Array, opening: float) -> Array:
        """Return the action for joint targets (6,), in [rad], and an opening, in [m].

        What is beyond the range of a servo becomes its end.
        """
        action = (np.array([*joints, opening]) - self._center) / self._reach
        return np.clip(action, -1.0, 1.0).astype(np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay the table at random.

        Args:
            seed: Of this episode and those after it; goes on from the last one if None.
            options: Of no effect.

        Returns:
            The observation, and no further information.
        """
        super().reset(seed=seed)
        self._environment.random_state.seed(self.np_random.integers(2**32))
        self._is_over = False
        return self._observed(self._environment.reset().observation), {}

    def step(
        self, action: Any
    ) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Move for one control step, of 0.04 s.

        Raises:
            ValueError: If the action is not of shape (7,).
            gymnasium.error.ResetNeeded: If the episode is over.
        """
        if self._is_over:
            raise gymnasium.error.ResetNeeded(
                "the episode is over; call `reset` before the next step"
            )
        if np.shape(action) != self.action_space.shape:
            raise ValueError(
                f"`action` must have the shape {self.action_space.shape}; got "
                f"{np.shape(action)}"
            )
        targets = self._center + self._reach * np.clip(action, -1.0, 1.0)
        moment = self._environment.step(targets)
        self._is_over = moment.last()
        has_diverged = moment.last() and moment.discount == 0.0
        is_truncated = moment.last() and not has_diverged
        observation = self._observed(moment.observation)
        return observation, float(moment.reward), has_diverged, is_truncated, {}

    def render(self) -> Pixels | None:
        """Draw the table, shape (480, 640, 3); None without a render mode."""
        return self._painter.draw(self._environment.physics.data.ptr)

    def close(self) -> None:
        """Free the graphics card."""
        self._painter.close()

    def _observed(self, observation: dict[str, Array]) -> dict[str, Any]:
        return {
            name: np.clip(value, -_BOUNDS[name], _BOUNDS[name]).astype(np.float32)
            for name, value in observation.items()
        }
