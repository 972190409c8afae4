"""Carry a plan out in the simulator, and say how well it went."""

from collections.abc import Generator, Iterable
from dataclasses import dataclass, replace
from typing import Final

import mujoco
import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.grasp import Hold
from tablesetting.planner.pick_place import Plan, Refusal, replan_placing
from tablesetting.planner.trajectory import CONTROL_PERIOD, Step
from tablesetting.scene.scene import Scene, Snapshot

MAX_ERROR_MM: Final = 10.0
"""Largest error of a placement that counts as a success."""
MAX_TILT_DEG: Final = 5.0
"""Largest tilt of a placed item that counts as a success."""
MAX_YAW_ERROR_DEG: Final = 5.0
"""Largest turn of a placed item that counts as a success."""
MAX_SHIFT_MM: Final = 2.0
"""Furthest that a bystander may move."""

_MAX_SLIP: Final = 0.010  # Of a held item since the jaw closed, in [m].
_MAX_LAG: Final = 0.2  # Of a joint behind its command, in [rad].
_DIVERGENCE: Final = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass(frozen=True)
class Execution:
    """What came of a plan.

    Attributes:
        commanded: Where the item's centre should stand, shape (2,), in [m].
        settled: Where it stands at the end, shape (2,), in [m].
        tilt_deg: Angle of the item to the upright it started with.
        yaw_error_deg: Heading of the item against 0, without sign; 0 for an item
            that looks the same from all sides.
        max_bystander_shift_mm: Furthest that any other prop has moved.
        failure: What went wrong; None if the placement succeeded.
        duration: Simulated time, in [s].
    """

    commanded: Array
    settled: Array
    tilt_deg: float
    yaw_error_deg: float
    max_bystander_shift_mm: float
    failure: str | None
    duration: float

    @property
    def error_mm(self) -> float:
        """Distance of the settled from the commanded position."""
        return 1e3 * float(np.linalg.norm(self.settled - self.commanded))

    @property
    def success(self) -> bool:
        """Whether the item stands where it should and nothing else has moved."""
        return self.failure is None


def execute(
    scene: Scene, plan: Plan, frame_rate: float = 30.0
) -> Generator[Snapshot, None, Execution]:
    """Carry a plan out.

    Above the target, the item is measured once and what it has slipped in the hand is
    made good in the descent.

    Args:
        scene: As it stood when the plan was made.
        plan: What to do.
        frame_rate: Snapshots per second of simulated time.

    Yields:
        The state of the world, evenly spaced in simulated time.

    Returns:
        How the item and its neighbours stand in the end, or where the motion was
        broken off.

    Raises:
        ValueError: If `frame_rate` is not positive.
    """
    if not frame_rate > 0.0:
        raise ValueError(f"`frame_rate` must be positive, in [Hz]; got {frame_rate}")
    before = {name: scene.position(name) for name in scene.objects}
    driver = _Driver(scene, plan, frame_rate)
    failure = yield from driver.run()
    return _score(scene, plan, before, failure)


def run_to_end(execution: Generator[Snapshot, None, Execution]) -> Execution:
    """Carry a plan out when nobody looks at the snapshots."""
    while True:
        try:
            next(execution)
        except StopIteration as stop:
            return stop.value


class _Driver:
    """Feeds commands to the servos and watches what happens."""

    def __init__(self, scene: Scene, plan: Plan, frame_rate: float) -> None:
        self._scene = scene
        self._plan = plan
        self._frame_period = 1.0 / frame_rate
        self._next_frame = scene.data.time + self._frame_period
        self._num_substeps = round(CONTROL_PERIOD / scene.model.opt.timestep)
        servos = scene.robot.arm_ctrl
        # A servo lags by damping / stiffness; commanding ahead cancels it.
        stiffness = scene.model.actuator_gainprm[servos, 0]
        self._lead = -scene.model.actuator_biasprm[servos, 2] / stiffness
        self._grip_offset = np.zeros(3)

    def run(self) -> Generator[Snapshot, None, str | None]:
        """Do all steps; return what went wrong, if anything."""
        failure = yield from self._drive(self._plan.picking)
        if failure is not None:
            return failure
        placing = self._correct()
        if isinstance(placing, Refusal):
            return f"correction {placing.reason}: {placing.detail}"
        return (yield from self._drive((*placing, *self._plan.returning)))

    def _drive(self, steps: Iterable[Step]) -> Generator[Snapshot, None, str | None]:
        for step in steps:
            failure = yield from self._drive_step(step)
            if failure is not None:
                return f"{step.phase}: {failure}"
        return None

    def _drive_step(self, step: Step) -> Generator[Snapshot, None, str | None]:
        data, robot = self._scene.data, self._scene.robot
        data.ctrl[robot.jaw_ctrl] = step.opening
        commands = step.positions + self._lead * step.velocities
        for command, position in zip(commands, step.positions, strict=True):
            data.ctrl[robot.arm_ctrl] = command
            self._scene.step(self._num_substeps)
            if any(data.warning[kind].number for kind in _DIVERGENCE):
                return "the simulation diverged"
            if np.abs(data.qpos[robot.arm_qpos] - position).max() > _MAX_LAG:
                return "the arm is held up"
            if data.time >= self._next_frame - 1e-9:
                self._next_frame += self._frame_period
                yield self._scene.snapshot(step.phase)
        return self._check_grip(step.phase)

    def _check_grip(self, phase: str) -> str | None:
        """Compare the item's place in the hand with that after closing."""
        offset = self._item_in_tool()
        if phase == "close":
            self._grip_offset = offset
        elif phase in ("lift", "transfer", "hold"):
            slip = float(np.linalg.norm(offset - self._grip_offset))
            if slip > _MAX_SLIP:
                return f"the {self._scene.item} slipped {1e3 * slip:.0f} mm in the jaw"
        return None

    def _item_in_tool(self) -> Array:
        scene = self._scene
        rotation = scene.data.site_xmat[scene.robot.tcp].reshape(3, 3)
        tcp = scene.data.site_xpos[scene.robot.tcp]
        return rotation.T @ (scene.position(scene.item) - tcp)

    def _correct(self) -> tuple[Step, ...] | Refusal:
        """Plan the placing anew from where the item really is."""
        scene, plan = self._scene, self._plan
        # Against the commanded pose of the tool, so that its own error cancels too.
        position, yaw = scene.position(scene.item), scene.yaw(scene.item)
        return replan_placing(scene, plan, Hold.measure(plan.hover, position, yaw))


def _score(
    scene: Scene, plan: Plan, before: dict[str, Array], failure: str | None
) -> Execution:
    shifts = {
        name: 1e3 * float(np.linalg.norm(scene.position(name) - position))
        for name, position in before.items()
    }
    yaw = 0.0 if plan.grasp.is_symmetric else abs(scene.yaw(scene.item))
    execution = Execution(
        commanded=plan.target,
        settled=scene.position(scene.item)[:2],
        tilt_deg=float(np.degrees(scene.tilt(scene.item))),
        yaw_error_deg=float(np.degrees(yaw)),
        max_bystander_shift_mm=max(shifts.values(), default=0.0),
        failure=failure,
        duration=scene.data.time,
    )
    return execution if failure else _judge(execution, scene.item, shifts)


def _judge(execution: Execution, item: str, shifts: dict[str, float]) -> Execution:
    """Fill in why a completed motion is no success, if it is none."""
    faults = []
    if execution.error_mm >= MAX_ERROR_MM:
        faults.append(f"the {item} stands {execution.error_mm:.1f} mm off")
    if execution.tilt_deg >= MAX_TILT_DEG:
        faults.append(f"the {item} is tilted by {execution.tilt_deg:.1f} degrees")
    if execution.yaw_error_deg >= MAX_YAW_ERROR_DEG:
        faults.append(f"the {item} is turned by {execution.yaw_error_deg:.1f} degrees")
    faults += [
        f"the {name} was moved by {shift:.1f} mm"
        for name, shift in shifts.items()
        if shift > MAX_SHIFT_MM
    ]
    return replace(execution, failure="; ".join(faults) or None)
