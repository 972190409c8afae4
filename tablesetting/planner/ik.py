"""Inverse kinematics of a site: which configuration brings it to a pose.

Differential inverse kinematics (mink), iterated until it converges. Knows nothing of
tables or items: a model, the name of a site and a posture to stay close to are enough.
"""

from dataclasses import dataclass, replace
from typing import Final

import mink
import mujoco
import numpy as np

from tablesetting.irl.arrays import Array

_HINGE: Final = mujoco.mjtJoint.mjJNT_HINGE


@dataclass(frozen=True)
class IkConfig:
    """When to stop and how hard to try."""

    position_tol: float = 1e-4
    """Accepted distance from the target, in [m]."""
    orientation_tol: float = 1e-3
    """Accepted angle to the target, in [rad]."""
    max_iterations: int = 60
    """Steps of one descent."""
    max_step: float = 0.4
    """Largest change of a joint in one step, in [rad] or [m]."""
    num_restarts: int = 3
    """Descents from scattered starts after the first has failed."""
    restart_std: float = 0.4
    """How far those starts scatter about the posture, in [rad]."""

    def __post_init__(self) -> None:
        if not (self.position_tol > 0.0 and self.orientation_tol > 0.0):
            raise ValueError(
                "`position_tol` and `orientation_tol` must be positive; got "
                f"{self.position_tol} and {self.orientation_tol}"
            )


@dataclass(frozen=True)
class IkResult:
    """The best configuration found.

    Attributes:
        configuration: Joint positions of the whole model, shape (nq,).
        position_error: Distance of the site from the target, in [m].
        orientation_error: Angle between the site and the target, in [rad].
        is_solved: True if both errors are within tolerance.
    """

    configuration: Array
    position_error: float
    orientation_error: float
    is_solved: bool


class IkSolver:
    """Solves for one site of one model; keeps its buffers between calls."""

    # A stronger pull towards the posture stops short of targets near the base.
    _POSTURE_COST: Final = 1e-4
    _DAMPING: Final = 1e-6

    def __init__(
        self,
        model: mujoco.MjModel,
        site: str,
        posture: Array,
        config: IkConfig | None = None,
    ) -> None:
        """Set the solver up.

        Args:
            model: All of its joints are free to move, one coordinate each.
            site: Name of the site to be brought to a pose.
            posture: Where restarts begin and redundancy settles, shape (nq,).
            config: Tolerances and effort.

        Raises:
            ValueError: If the model has no such site or `posture` does not fit it.
        """
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site) < 0:
            raise ValueError(f"the model has no site {site!r}")
        if np.shape(posture) != (model.nq,):
            raise ValueError(
                f"`posture` needs one number per joint, shape ({model.nq},); got "
                f"{np.shape(posture)}"
            )
        self.config = IkConfig() if config is None else config
        self._site = site
        self._posture = np.array(posture, dtype=np.float64)
        self._state = mink.Configuration(model, self._posture)
        self._pose_task = mink.FrameTask(
            site, "site", position_cost=1.0, orientation_cost=0.3, lm_damping=1e-3
        )
        self._posture_task = mink.PostureTask(model, cost=self._POSTURE_COST)
        self._posture_task.set_target(self._posture)
        self._limits = [mink.ConfigurationLimit(model)]
        is_limited = model.jnt_limited == 1
        self._range = np.where(is_limited, model.jnt_range.T, [[-np.inf], [np.inf]])
        self._is_continuous = (model.jnt_type == _HINGE) & ~is_limited

    def solve(
        self, position: Array, rotation: Array, start: Array | None = None
    ) -> IkResult:
        """Find the configuration that brings the site to a pose.

        Args:
            position: Target of the site in the world, shape (3,), in [m].
            rotation: Target orientation, a matrix of shape (3, 3).
            start: Where to begin, shape (nq,); the posture if None. Joints without
                limits come out within half a turn of it.

        Returns:
            The solution, or, if there is none, the closest configuration found.
        """
        start = self._posture if start is None else start
        target = mink.SE3.from_rotation_and_translation(
            mink.SO3.from_matrix(rotation), position
        )
        self._pose_task.set_target(target)
        result = self._descend(start)
        rng = np.random.default_rng(0)  # The same restarts for the same question.
        for _ in range(self.config.num_restarts):
            if result.is_solved:
                break
            result = min(result, self._descend(self._scatter(rng)), key=_badness)
        return self._unwind(result, start)

    def forward(self, configuration: Array) -> tuple[Array, Array]:
        """Position (3,) and rotation (3, 3) of the site at a configuration (nq,)."""
        self._state.update(configuration)
        pose = self._state.get_transform_frame_to_world(self._site, "site")
        return pose.translation(), pose.rotation().as_matrix()

    def _descend(self, start: Array) -> IkResult:
        self._state.update(start)
        for _ in range(self.config.max_iterations):
            result = self._measure()
            if result.is_solved:
                return result
            velocity = mink.solve_ik(
                self._state,
                [self._pose_task, self._posture_task],
                dt=1.0,
                solver="daqp",
                damping=self._DAMPING,
                limits=self._limits,
            )
            largest = float(np.abs(velocity).max())
            self._state.integrate_inplace(
                velocity * min(1.0, self.config.max_step / max(largest, 1e-9)), 1.0
            )
        return self._measure()

    def _scatter(self, rng: np.random.Generator) -> Array:
        """Draw a start around the posture, within the joint limits."""
        offsets = rng.normal(0.0, self.config.restart_std, self._posture.size)
        return np.clip(self._posture + offsets, *self._range)

    def _measure(self) -> IkResult:
        error = self._pose_task.compute_error(self._state)
        position_error = float(np.linalg.norm(error[:3]))
        orientation_error = float(np.linalg.norm(error[3:]))
        return IkResult(
            configuration=self._state.q.copy(),
            position_error=position_error,
            orientation_error=orientation_error,
            is_solved=position_error <= self.config.position_tol
            and orientation_error <= self.config.orientation_tol,
        )

    def _unwind(self, result: IkResult, start: Array) -> IkResult:
        """Turn the joints without limits by whole turns towards `start`."""
        turns = np.round((start - result.configuration) / (2 * np.pi))
        configuration = result.configuration + 2 * np.pi * turns * self._is_continuous
        return replace(result, configuration=configuration)


def _badness(result: IkResult) -> tuple[bool, float]:
    return not result.is_solved, result.position_error
