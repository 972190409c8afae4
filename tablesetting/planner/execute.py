"""Carry a plan out in the simulator, and say how well it went."""

from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.goal import Goal, Refusal
from tablesetting.planner.grasp import GRASPS, Hold
from tablesetting.planner.load import Load
from tablesetting.planner.pick_place import HOLDING, Plan, replan_placing
from tablesetting.planner.receptacle import RECEPTACLES
from tablesetting.planner.trajectory import CONTROL_PERIOD, Step, brake
from tablesetting.planner.watchdog import Effort, Failure, Fault, Watchdog
from tablesetting.scene.perception import Camera
from tablesetting.scene.props import PROPS
from tablesetting.scene.scene import Scene, Snapshot

MAX_ERROR_MM: Final = 10.0
"""Largest error of a placement that counts as a success."""
MAX_TILT_DEG: Final = 5.0
"""Largest tilt of a placed item that counts as a success; not in a receptacle."""
MAX_YAW_ERROR_DEG: Final = 5.0
"""Largest turn of a placed item that counts as a success; not in a receptacle."""
MAX_SHIFT_MM: Final = 2.0
"""Furthest that a bystander may move."""

_MAX_SLIP: Final = 0.010  # Of a held item since the jaw closed, in [m].


@dataclass(frozen=True)
class Execution:
    """What came of a plan.

    Attributes:
        commanded: Where the item should be, shape (2,), in [m]: the centre of its
            footprint or, in a receptacle, its centre of mass.
        settled: Where that is at the end, shape (2,), in [m].
        tilt_deg: Angle of the item to the upright it started with.
        yaw_error_deg: Heading of the item against the one planned, without sign; 0 for an
            item that looks the same from all sides.
        max_bystander_shift_mm: Furthest that any other prop has moved: its foot, its top
            or, of cutlery, its ends.
        failure: What went wrong; None if the placement succeeded.
        duration: Simulated time, in [s].
        receptacle: What the item was put into; None on the table.
        touched: Bystanders that arm or item have touched.
        effort: How far the motion went towards the limits of the joints.
        num_tries: 2 if the item was lost once and picked up again.
    """

    commanded: Array
    settled: Array
    tilt_deg: float
    yaw_error_deg: float
    max_bystander_shift_mm: float
    failure: Failure | None
    duration: float
    receptacle: str | None = None
    touched: frozenset[str] = frozenset()
    effort: Effort = field(default_factory=Effort)
    num_tries: int = 1

    @property
    def error_mm(self) -> float:
        """Distance of the settled from the commanded position."""
        return 1e3 * float(np.linalg.norm(self.settled - self.commanded))

    @property
    def success(self) -> bool:
        """Whether the item is where it should and nothing else has moved, but for 2 mm."""
        return self.failure is None


def execute(
    scene: Scene, plan: Plan, frame_rate: float = 30.0, camera: Camera | None = None
) -> Generator[Snapshot, None, Execution]:
    """Carry a plan out.

    Above the target, the item is measured once and what it has slipped in the hand is
    made good in the descent.

    Args:
        scene: As it stood when the plan was made.
        plan: What to do.
        frame_rate: Snapshots per second of simulated time.
        camera: Measures the item; without error if None.

    Yields:
        The state of the world, evenly spaced in simulated time.

    Returns:
        How the item and its neighbours stand in the end, or where the motion was
        broken off.

    Raises:
        ValueError: If `frame_rate` is not positive.
    """
    before = outer_points(scene)
    driver = Driver(scene, frame_rate, plan.goal.receptacle)
    failure = yield from carry_out(driver, plan, camera or Camera(scene))
    return score(driver, plan.goal, before, failure)


def run_to_end(execution: Generator[Snapshot, None, Any]) -> Any:
    """Carry a plan out when nobody looks at the snapshots."""
    while True:
        try:
            next(execution)
        except StopIteration as stop:
            return stop.value


class Driver:
    """Feeds commands to the servos and watches what happens.

    Attributes:
        scene: What is driven.
        watchdog: What was seen on the way.
        started: When, on the clock of the scene, in [s].
        carried: What was done while the item was in the air, to go back by; the arm may
            still move, if the last of it was broken off.
    """

    def __init__(self, scene: Scene, frame_rate: float, receptacle: str | None) -> None:
        """Take hold of a scene.

        Raises:
            ValueError: If `frame_rate` is not positive.
        """
        if not frame_rate > 0.0:
            raise ValueError(
                f"`frame_rate` must be positive, in [Hz]; got {frame_rate}"
            )
        self.scene = scene
        self.watchdog = Watchdog(scene, receptacle)
        self.carried: list[Step] = []
        self.started = scene.data.time
        self._frame_period = 1.0 / frame_rate
        self._next_frame = scene.data.time + self._frame_period
        self._num_substeps = round(CONTROL_PERIOD / scene.model.opt.timestep)
        self._grip_offset: Array | None = None
        self._broken_off: tuple[Step, int] | None = None

    def drive(self, steps: Iterable[Step]) -> Generator[Snapshot, None, Failure | None]:
        """Do some steps; return what went wrong, if anything."""
        for step in steps:
            failure = yield from self._drive_step(step)
            if failure is not None:
                return replace(failure, detail=f"{step.phase}: {failure.detail}")
        return None

    def stop(
        self, load: Load, opening: float
    ) -> Generator[Snapshot, None, Failure | None]:
        """Come to rest after the item was lost.

        Args:
            load: What the arm carries.
            opening: Travel of each finger meanwhile, in [m].

        Returns:
            What went wrong, if anything.
        """
        if self._broken_off is None:
            return None
        step = replace(brake(*self._broken_off, load), opening=opening)
        self._broken_off = None
        self.carried.append(step)
        return (yield from self.drive([step]))

    def _drive_step(self, step: Step) -> Generator[Snapshot, None, Failure | None]:
        data, scene = self.scene.data, self.scene
        data.ctrl[scene.robot.jaw_ctrl] = step.opening
        for tick, position in enumerate(step.positions):
            scene.controller.track(
                data, position, step.velocities[tick], step.torques[tick]
            )
            scene.step(self._num_substeps)
            failure = self.watchdog.check(position) or self._check_grip(step, tick)
            if failure is not None:
                return failure
            if data.time >= self._next_frame - 1e-9:
                self._next_frame += self._frame_period
                yield scene.snapshot(step.phase)
        self._finish(step)
        return None

    def _finish(self, step: Step) -> None:
        if step.phase == "close":
            self._grip_offset = self._item_in_tool()
        elif step.phase in ("lift", "transfer"):
            self.carried.append(step)
        elif step.phase == "lower":
            self._grip_offset = None  # It stands, and may be let go.

    def _check_grip(self, step: Step, tick: int) -> Failure | None:
        """Compare the item's place in the hand with that after closing."""
        if self._grip_offset is None or step.phase not in HOLDING:
            return None
        slip = float(np.linalg.norm(self._item_in_tool() - self._grip_offset))
        if slip <= _MAX_SLIP:
            return None
        self._broken_off = step, tick
        self.carried.append(_part(step, tick + 1))
        self._grip_offset = None
        item = self.scene.item
        return Failure(
            Fault.LOST_GRIP, f"the {item} slipped {1e3 * slip:.0f} mm in the jaw"
        )

    def _item_in_tool(self) -> Array:
        scene = self.scene
        rotation = scene.data.site_xmat[scene.robot.tcp].reshape(3, 3)
        tcp = scene.data.site_xpos[scene.robot.tcp]
        return rotation.T @ (scene.position(scene.item) - tcp)


def carry_out(
    driver: Driver, plan: Plan, camera: Camera
) -> Generator[Snapshot, None, Failure | None]:
    """Do all steps of a plan; return what went wrong, if anything."""
    failure = yield from driver.drive(plan.picking)
    if failure is not None:
        return failure
    # Against the commanded pose of the tool, so that its own error cancels too.
    seen, item = camera.look(), driver.scene.item
    hold = Hold.measure(plan.hover, seen.position(item), seen.yaw(item))
    placing = replan_placing(driver.scene, plan, hold)
    if isinstance(placing, Refusal):
        detail = f"correction {placing.reason}: {placing.detail}"
        return Failure(Fault.NO_CORRECTION, detail)
    return (yield from driver.drive((*placing, *plan.returning)))


def score(
    driver: Driver, goal: Goal, before: Mapping[str, Array], failure: Failure | None
) -> Execution:
    """Say how everything stands.

    Args:
        driver: Has done what there was to do.
        goal: Where the item should be.
        before: Where the `outer_points` of the bystanders were.
        failure: What went wrong on the way.
    """
    scene, item = driver.scene, driver.scene.item
    shifts = {
        name: 1e3 * float(np.linalg.norm(points - before[name], axis=1).max())
        for name, points in outer_points(scene).items()
    }
    inside = goal.receptacle is not None
    settled = scene.center_of_mass(item) if inside else scene.position(item)
    turn = (scene.yaw(item) - goal.yaw + np.pi) % (2.0 * np.pi) - np.pi
    is_symmetric = GRASPS[item][0].is_symmetric
    execution = Execution(
        commanded=goal.target,
        settled=settled[:2],
        tilt_deg=float(np.degrees(scene.tilt(item))),
        yaw_error_deg=0.0 if is_symmetric else float(np.degrees(abs(turn))),
        max_bystander_shift_mm=max(shifts.values(), default=0.0),
        failure=failure,
        duration=scene.data.time - driver.started,
        receptacle=goal.receptacle,
        touched=frozenset(driver.watchdog.touched),
        effort=driver.watchdog.effort,
    )
    return execution if failure else _judge(execution, scene, shifts)


def outer_points(scene: Scene) -> dict[str, Array]:
    """Say where foot, top and ends of each bystander are, by name, shape (4, 3), in [m].

    The foot alone would not tell that a fork was turned or a glass tipped over.
    """
    return {
        name: scene.position(name) + _outer_offsets(name) @ scene.rotation(name).T
        for name in scene.objects
    }


def _outer_offsets(name: str) -> Array:
    length, height = PROPS[name].half_length, PROPS[name].height
    return np.array([[0, 0, 0], [0, 0, height], [0, length, 0], [0, -length, 0]])


def _judge(
    execution: Execution, scene: Scene, shifts: Mapping[str, float]
) -> Execution:
    """Fill in why a completed motion is no success, if it is none."""
    faults = _faults_of_item(execution, scene)
    moved = [
        f"the {name} was moved by {shift:.1f} mm"
        for name, shift in shifts.items()
        if shift > MAX_SHIFT_MM
    ]
    if not faults and not moved:
        return execution
    fault = Fault.MISPLACED if faults else Fault.DISTURBED
    return replace(execution, failure=Failure(fault, "; ".join([*faults, *moved])))


def _faults_of_item(execution: Execution, scene: Scene) -> list[str]:
    item, faults = scene.item, []
    if execution.error_mm >= MAX_ERROR_MM:
        faults.append(f"the {item} stands {execution.error_mm:.1f} mm off")
    if execution.receptacle is not None:
        if not is_inside(scene, execution.receptacle):
            faults.append(f"the {item} is not in the {execution.receptacle}")
        return faults
    if execution.tilt_deg >= MAX_TILT_DEG:
        faults.append(f"the {item} is tilted by {execution.tilt_deg:.1f} degrees")
    if execution.yaw_error_deg >= MAX_YAW_ERROR_DEG:
        faults.append(f"the {item} is turned by {execution.yaw_error_deg:.1f} degrees")
    return faults


def is_inside(scene: Scene, name: str) -> bool:
    """Tell whether the item lies in a receptacle: its centre of mass below the rim."""
    receptacle = RECEPTACLES[scene.item, name]
    center = scene.center_of_mass(scene.item)
    offset = center - scene.position(name)
    is_within = np.linalg.norm(offset[:2]) < PROPS[name].radius
    return bool(is_within and offset[2] < PROPS[name].height - receptacle.depth)


def _part(step: Step, num_ticks: int) -> Step:
    """The first commands of a step."""
    return replace(
        step,
        positions=step.positions[:num_ticks],
        velocities=step.velocities[:num_ticks],
        torques=step.torques[:num_ticks],
    )
