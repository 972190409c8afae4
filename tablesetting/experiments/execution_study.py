"""How well the arm does what it is told, in random layouts."""

import hashlib
from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np

from tablesetting.experiments.arm import Arm
from tablesetting.experiments.config import ArmConfig, TaskName
from tablesetting.experiments.rows import rounded
from tablesetting.experiments.study_config import ExecutionStudyConfig, GoalName
from tablesetting.experiments.trials import Trial
from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution, is_inside, run_to_end
from tablesetting.planner.goal import Reason, Refusal, gap_at
from tablesetting.planner.place import place
from tablesetting.planner.receptacle import RECEPTACLES
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import TASKS
from tablesetting.scene.perception import Camera
from tablesetting.scene.scene import Scene

_COLUMNS = (
    *("task", "goal", "trial", "request", "x", "y", "yaw_deg"),
    *("refusal", "fault", "success", "error_mm", "yaw_error_deg", "tilt_deg"),
    *("inside", "shift_mm", "touched", "tries", "speed_share", "torque_share"),
    *("overrun_rad", "simulated_seconds", "moved", "state"),
)
_MAX_DRAWS = 1000  # Of places on the table, until the item fits.
_OUT_OF_REACH = 0.80  # Of the tool from the foot of the arm, and more, in [m].


@dataclass(frozen=True)
class Request:
    """What the arm is asked for.

    Attributes:
        target: Where the item shall be, shape (2,), in [m].
        yaw: Its heading, in [rad]; None for any that will do.
        expected: Why it is to be refused; None if it can be done.
    """

    target: Array
    yaw: float | None
    expected: Reason | None = None


def columns(config: ExecutionStudyConfig) -> list[str]:
    """List the columns of rounds.csv."""
    return list(_COLUMNS)


def run_trial(config: ExecutionStudyConfig, trial: Trial) -> list[dict[str, object]]:
    """Ask for one placement of every kind in a random layout.

    Args:
        config: The study.
        trial: Which trial.

    Returns:
        Rows of rounds.csv, one for each kind of goal.
    """
    task, seeds = TASKS[trial.task], trial.seeds(config.seed)
    layout_seeds, *goal_seeds = seeds.spawn(4)
    space = LayoutSpace.of_task(task, are_points=False)
    layout = space.sample(1, rng=np.random.default_rng(layout_seeds))[0]
    arm = _arm(trial.task, config.arm)
    rows = []
    for goal in config.goals_of(trial.task):
        # A goal has its own randomness, whatever other goals there are.
        seed = goal_seeds[_GOALS.index(goal)]
        rng = np.random.default_rng(seed)
        arm.lay(layout, rng=rng)
        request = draw_request(goal, arm.scene, trial, rng=rng)
        key = {"task": trial.task, "goal": goal, "trial": trial.index}
        rows.append(rounded(key | _attempt(arm, request, rng)))
    return rows


def draw_request(
    goal: GoalName, scene: Scene, trial: Trial, *, rng: np.random.Generator
) -> Request:
    """Draw what to ask for on a table that is laid.

    Args:
        goal: The kind of it.
        scene: The table.
        trial: Which trial; those that cannot be met take turns.
        rng: Source of the place.
    """
    return _REQUESTS[goal](scene, trial, rng)


@cache
def _arm(task: TaskName, config: ArmConfig) -> Arm:
    """One scene for each set of objects, compiled once in every process."""
    return Arm(TASKS[task].objects, TASKS[task].item, config)


def _attempt(arm: Arm, request: Request, rng: np.random.Generator) -> dict[str, object]:
    """Let the arm do what is requested; return the cells of the row."""
    scene = arm.scene
    before = scene.data.qpos.copy()
    outcome = run_to_end(
        place(scene, request.target, request.yaw, camera=arm.camera(rng=rng))
    )
    where = scene.frame.from_world(request.target)
    cells: dict[str, object] = {
        "request": request.expected or "",
        "x": float(where[0]),
        "y": float(where[1]),
        "yaw_deg": "" if request.yaw is None else float(np.degrees(request.yaw)),
        "success": 0,
        "moved": int(not np.array_equal(before, scene.data.qpos)),
        "state": _digest(scene.data.qpos),
    }
    if isinstance(outcome, Refusal):
        cells |= {"refusal": outcome.reason}
    else:
        cells |= _cells(scene, outcome)
    # What was not done has empty cells.
    return {name: cells.get(name, "") for name in _COLUMNS[3:]}


def _cells(scene: Scene, execution: Execution) -> dict[str, object]:
    receptacle = execution.receptacle
    return {
        "fault": execution.failure.fault if execution.failure else "",
        "success": int(execution.success),
        "error_mm": execution.error_mm,
        "yaw_error_deg": execution.yaw_error_deg,
        "tilt_deg": execution.tilt_deg,
        "inside": int(receptacle is not None and is_inside(scene, receptacle)),
        "shift_mm": execution.max_bystander_shift_mm,
        "touched": len(execution.touched),
        "tries": execution.num_tries,
        "speed_share": execution.effort.speed,
        "torque_share": execution.effort.torque,
        "overrun_rad": execution.effort.overrun,
        "simulated_seconds": execution.duration,
    }


def _digest(qpos: Array) -> str:
    """Tell two final states apart by a few letters, bit for bit."""
    return hashlib.sha256(qpos.tobytes()).hexdigest()[:12]


def _on_table(scene: Scene, trial: Trial, rng: np.random.Generator) -> Request:
    """Ask for a random place on the square where the item has the task's clearance."""
    seen = Camera(scene).look()
    clearance = TASKS[trial.task].clearance * scene.frame.size[0]
    for _ in range(_MAX_DRAWS):
        target = scene.frame.to_world(rng.random(2))
        yaw = float(rng.uniform(-np.pi, np.pi))
        gaps = [gap_at(scene, seen, target, yaw, name) for name in scene.objects]
        if min(gaps) >= clearance:
            break
    return Request(target, yaw)  # Refused, and no success, if there is no such place.


def _in_bowl(scene: Scene, trial: Trial, rng: np.random.Generator) -> Request:
    """Ask for a random place in the bowl, evenly over the disc that is in reach."""
    radius = RECEPTACLES[scene.item, "bowl"].radius * np.sqrt(rng.random())
    angle = rng.uniform(0.0, 2.0 * np.pi)
    offset = radius * np.array([np.cos(angle), np.sin(angle)])
    return Request(scene.position("bowl")[:2] + offset, None)


def _infeasible(scene: Scene, trial: Trial, rng: np.random.Generator) -> Request:
    """Ask for a place off the table, on another object, or out of reach, in turns."""
    return _INFEASIBLE[trial.index % len(_INFEASIBLE)](scene, rng)


def _off_table(scene: Scene, rng: np.random.Generator) -> Request:
    top, angle = scene.model.geom("top"), rng.uniform(0.0, 2.0 * np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    distance = np.min(top.size[:2] / np.maximum(np.abs(direction), 1e-9))
    target = top.pos[:2] + direction * (distance + rng.uniform(0.0, 0.5))
    return Request(target, None, Reason.OUTSIDE)


def _on_object(scene: Scene, rng: np.random.Generator) -> Request:
    names = [name for name in scene.objects if (scene.item, name) not in RECEPTACLES]
    center = scene.position(names[rng.integers(len(names))])[:2]
    return Request(center + rng.uniform(-0.008, 0.008, 2), None, Reason.OCCUPIED)


def _far_away(scene: Scene, rng: np.random.Generator) -> Request:
    """Ask for a place on the table that is too far from the arm, among no objects."""
    top = scene.model.geom("top")
    foot = scene.model.body("jaco/").pos[:2]
    while True:
        target = rng.uniform(top.pos[:2] - top.size[:2], top.pos[:2] + top.size[:2])
        is_inside_edge = (np.abs(target - top.pos[:2]) < top.size[:2] - 0.1).all()
        is_off_square = (np.abs(target) > 0.5 * np.array(scene.frame.size) + 0.2).any()
        is_far = np.linalg.norm(target - foot) > _OUT_OF_REACH
        if is_inside_edge and is_off_square and is_far:
            return Request(target, None, Reason.UNREACHABLE)


_INFEASIBLE = (_off_table, _on_object, _far_away)
_REQUESTS = {"table": _on_table, "bowl": _in_bowl, "infeasible": _infeasible}
_GOALS = cast(tuple[GoalName, ...], tuple(_REQUESTS))
