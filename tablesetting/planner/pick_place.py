"""Plan to pick the item up and put it down elsewhere, before anything moves.

The arm goes up before it goes sideways: every transfer, of the empty hand too, passes
over the tallest thing on the table.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.collision import CollisionChecker
from tablesetting.planner.grasp import GRASPS, Grasp, Hold, ToolPose
from tablesetting.planner.path import Path, Unreachable, home_pose
from tablesetting.planner.trajectory import Step
from tablesetting.scene.jaw import TIP_REACH
from tablesetting.scene.props import PROPS
from tablesetting.scene.robot import HOME
from tablesetting.scene.scene import Scene

_DROP: Final = 0.0015  # Height from which the item is let go, in [m].
_CLEARANCE: Final = 0.03  # Between what passes over and what stands below, in [m].
_CLOSING_TIME: Final = 0.35  # [s]
_HOLDING_TIME: Final = 0.06  # [s]
_RELEASING_TIME: Final = 0.25  # [s]
_SETTLING_TIME: Final = 0.4  # [s]
_CHECK_EVERY: Final = 2  # Commands from one collision check to the next.
_HOLDING_PHASES: Final = frozenset({"lift", "transfer", "hold", "lower"})


class Reason(StrEnum):
    """Why a placement is refused."""

    UNREACHABLE = "unreachable"
    BLOCKED = "blocked"


@dataclass(frozen=True)
class Refusal:
    """A placement that cannot be carried out, found out before any motion."""

    reason: Reason
    detail: str


@dataclass(frozen=True)
class Plan:
    """A whole placement, from home to home.

    Attributes:
        target: Where the item's centre shall stand, shape (2,), in [m].
        grasp: How the item is held.
        hover: Pose of the tool above the target, where the item is measured.
        picking: Steps that bring the item above the target.
        placing: Steps that put it down, if it sits in the jaw as it should.
        returning: Steps from above the target back home.
    """

    target: Array
    grasp: Grasp
    hover: ToolPose
    picking: tuple[Step, ...]
    placing: tuple[Step, ...]
    returning: tuple[Step, ...]

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps in their order."""
        return self.picking + self.placing + self.returning


def plan(scene: Scene, target: Sequence[float] | Array) -> Plan | Refusal:
    """Plan to place the scene's item.

    Args:
        scene: As it stands after a reset; it is read, not moved.
        target: Where the centre of the item shall stand, shape (2,), in [m].

    Returns:
        The plan, or why there is none.

    Raises:
        ValueError: If `target` is not a pair of finite numbers, or nobody has said how
            the item is held.
    """
    goal = np.array(target, dtype=np.float64)
    if goal.shape != (2,) or not np.isfinite(goal).all():
        raise ValueError(f"`target` must be two finite numbers, in [m]; got {target}")
    if scene.item not in GRASPS:
        raise ValueError(
            f"there is no grasp for {scene.item!r}; choose one of {', '.join(GRASPS)}"
        )
    if not _is_on_table(scene, goal):
        detail = f"({goal[0]:.3f}, {goal[1]:.3f}) m is off the table"
        return Refusal(Reason.BLOCKED, detail)
    outcomes = (_plan_with(scene, grasp, goal) for grasp in GRASPS[scene.item])
    return _first_plan(outcomes)


def replan_placing(scene: Scene, plan: Plan, hold: Hold) -> tuple[Step, ...] | Refusal:
    """Plan the placing anew for an item that sits otherwise in the jaw.

    Args:
        scene: As it stands now.
        plan: Carried out up to the end of its picking.
        hold: Where the item really is.

    Returns:
        Steps in place of `plan.placing`, or why there are none.
    """
    path = Path(plan.picking[-1].positions[-1], plan.hover, opening=0.0)
    try:
        _place(path, plan.grasp, plan.target, hold)
    except Unreachable as error:
        return Refusal(Reason.UNREACHABLE, str(error))
    steps = tuple(path.steps)
    contact = _first_contact(scene, steps, plan.grasp, plan.target, hold)
    return steps if contact is None else Refusal(Reason.BLOCKED, contact)


def _first_plan(outcomes: Iterator[Plan | Refusal]) -> Plan | Refusal:
    """The first plan; if there is none, the first refusal."""
    first = next(outcomes)
    if isinstance(first, Plan):
        return first
    return next((other for other in outcomes if isinstance(other, Plan)), first)


def _plan_with(scene: Scene, grasp: Grasp, target: Array) -> Plan | Refusal:
    try:
        found = _plan_path(scene, grasp, target)
    except Unreachable as error:
        return Refusal(Reason.UNREACHABLE, str(error))
    contact = _first_contact(scene, found.steps, grasp, target, grasp.hold)
    return found if contact is None else Refusal(Reason.BLOCKED, contact)


def _plan_path(scene: Scene, grasp: Grasp, target: Array) -> Plan:
    empty_height, held_height = _transfer_heights(scene, grasp)
    pick = grasp.tool_pose(scene.position(scene.item)[:2])
    hover = grasp.tool_pose(target).raised_to(max(empty_height, held_height))

    path = Path(np.array(HOME), home_pose(), grasp.approach_opening)
    path.move("reach", pick.raised_to(empty_height))
    path.move("descend", pick)
    path.grip("close", 0.0, _CLOSING_TIME)
    path.move("lift", pick.raised_to(held_height))
    path.move("transfer", hover)
    path.wait("hold", _HOLDING_TIME)
    num_picking = len(path.steps)
    _place(path, grasp, target, grasp.hold)
    num_placed = len(path.steps)
    path.move("home", home_pose())
    path.wait("settle", _SETTLING_TIME)
    return Plan(
        target=target,
        grasp=grasp,
        hover=hover,
        picking=tuple(path.steps[:num_picking]),
        placing=tuple(path.steps[num_picking:num_placed]),
        returning=tuple(path.steps[num_placed:]),
    )


def _place(path: Path, grasp: Grasp, target: Array, hold: Hold) -> None:
    """Lower the held item, let it go and come back up."""
    hover = path.pose
    yaw = hover.yaw if grasp.is_symmetric else -hold.yaw
    path.move("lower", hold.tool_pose(np.array([*target, _DROP]), yaw))
    path.grip("release", grasp.release_opening, _RELEASING_TIME)
    path.move("retreat", hover)


def _transfer_heights(scene: Scene, grasp: Grasp) -> tuple[float, float]:
    """Heights of the tool that clear everything, empty-handed and with the item."""
    bystanders = max((PROPS[name].height for name in scene.objects), default=0.0)
    tallest = max(bystanders, PROPS[scene.item].height)
    return tallest + _CLEARANCE + TIP_REACH, bystanders + _CLEARANCE + grasp.height


def _first_contact(
    scene: Scene, steps: Sequence[Step], grasp: Grasp, target: Array, hold: Hold
) -> str | None:
    """Name what the steps would touch that they should not."""
    checker = CollisionChecker(scene)
    for step in steps:
        if step.phase == "release":
            checker.rest_item(np.array([*target, 0.0]))
        contact = checker.first_contact(
            step.positions[::-_CHECK_EVERY][::-1],
            max(step.opening, grasp.half_width),  # Where the item stops them.
            hold if step.phase in _HOLDING_PHASES else None,
        )
        if contact is not None:
            return f"{step.phase}: {contact}"
    return None


def _is_on_table(scene: Scene, target: Array) -> bool:
    top = scene.model.geom("top")
    return bool((np.abs(target - top.pos[:2]) <= top.size[:2]).all())
