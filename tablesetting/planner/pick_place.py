"""Plan to pick the item up and put it down elsewhere, before anything moves.

The arm goes up before it goes sideways: every transfer, of the empty hand too, passes
over the tallest thing on the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.collision import CollisionChecker, Contact
from tablesetting.planner.goal import Goal, Reason, Refusal, find_goals
from tablesetting.planner.grasp import GRASPS, Grasp, Hold, ToolPose
from tablesetting.planner.grip import Grip, best_grips
from tablesetting.planner.load import Load, Overload
from tablesetting.planner.path import Path, Unreachable, home_pose
from tablesetting.planner.trajectory import Step
from tablesetting.scene.jaw import PALM_HEIGHT, TIP_REACH
from tablesetting.scene.perception import Camera, Percept
from tablesetting.scene.props import PROPS
from tablesetting.scene.robot import HOME
from tablesetting.scene.scene import Scene

PICKING: Final = frozenset({"reach", "descend", "close", "lift"})
"""Phases that end with the item in the air over where it was."""
HOLDING: Final = frozenset({"lift", "transfer", "hold", "lower"})
"""Phases in which the jaw holds the item."""
_TRANSITS: Final = frozenset({"reach", "lift", "transfer"})

_CLEARANCE: Final = 0.03  # Between what passes over and what stands below, in [m].
_CLOSING_TIME: Final = 0.35  # [s]
_HOLDING_TIME: Final = 0.064  # [s]
_RELEASING_TIME: Final = 0.25  # [s]
_SETTLING_TIME: Final = 0.4  # [s]
_SETTLING_IN_TIME: Final = 1.2  # In a receptacle, where things rock, in [s].
_MAX_TILT: Final = 0.15  # Of an item that can be picked up, in [rad].
_MAX_GRIPS: Final = 6  # Tried before a placement is refused.


@dataclass(frozen=True)
class Plan:
    """A whole placement, from home to home.

    Attributes:
        goal: Where the item shall end.
        grasp: How the item is held.
        hover: Pose of the tool above the target, where the item is measured.
        picking: Steps that bring the item above the target.
        placing: Steps that put it down, if it sits in the jaw as it should.
        returning: Steps from above the target back home.
        seen: Where everything was thought to be.
    """

    goal: Goal
    grasp: Grasp
    hover: ToolPose
    picking: tuple[Step, ...]
    placing: tuple[Step, ...]
    returning: tuple[Step, ...]
    seen: Percept

    @property
    def steps(self) -> tuple[Step, ...]:
        """All steps in their order."""
        return self.picking + self.placing + self.returning


def plan(
    scene: Scene,
    target: Sequence[float] | Array,
    yaw: float | None = None,
    seen: Percept | None = None,
) -> Plan | Refusal:
    """Plan to place the scene's item.

    Args:
        scene: As it stands, with the arm at home; it is read, not moved.
        target: Where the item shall be, shape (2,), in [m]: the centre of its footprint
            or, over a receptacle, its centre of mass.
        yaw: Heading that it shall have, in [rad]; None for 0 on the table and for any in a
            receptacle. Of no effect on an item that looks the same from all sides.
        seen: Where everything is thought to be; where it is if None.

    Returns:
        The plan, or why there is none.

    Raises:
        ValueError: If `target` is not a pair of finite numbers or `yaw` is not finite.
    """
    point = np.array(target, dtype=np.float64)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ValueError(f"`target` must be two finite numbers, in [m]; got {target}")
    if yaw is not None and not np.isfinite(yaw):
        raise ValueError(f"`yaw` must be finite, in [rad]; got {yaw}")
    seen = Camera(scene).look() if seen is None else seen
    goals = find_goals(scene, seen, point, yaw)
    if isinstance(goals, Refusal):
        return goals
    return _cannot_hold(scene, seen) or _first_plan(scene, seen, goals)


def replan_placing(scene: Scene, plan: Plan, hold: Hold) -> tuple[Step, ...] | Refusal:
    """Plan the placing anew for an item that sits otherwise in the jaw.

    Args:
        scene: The scene of the plan.
        plan: Carried out up to the end of its picking.
        hold: Where the item really is.

    Returns:
        Steps in place of `plan.placing`, or why there are none.
    """
    load = Load(scene.servos, PROPS[scene.item].mass)
    path = Path(plan.picking[-1].positions[-1], plan.hover, opening=0.0, load=load)
    try:
        _place(path, plan.grasp, plan.goal, hold)
    except Unreachable as error:
        return Refusal(Reason.UNREACHABLE, str(error))
    except Overload as error:
        return Refusal(Reason.TOO_HEAVY, str(error))
    steps = tuple(path.steps)
    checker = CollisionChecker(scene, plan.seen, may_touch_item=True)
    found = _first_contact(checker, steps, plan.grasp, plan.goal, hold)
    return steps if found is None else Refusal(Reason.BLOCKED, _say(*found))


def transfer_heights(scene: Scene, grasp: Grasp) -> tuple[float, float]:
    """Heights of the tool that clear everything, empty-handed and with the item, [m]."""
    bystanders = max((PROPS[name].height for name in scene.objects), default=0.0)
    tallest = max(bystanders, PROPS[scene.item].height)
    return tallest + _CLEARANCE + TIP_REACH, bystanders + _CLEARANCE + grasp.height


def _cannot_hold(scene: Scene, seen: Percept) -> Refusal | None:
    item = scene.item
    if item not in GRASPS:
        known = ", ".join(GRASPS)
        detail = f"nobody has said how a {item} is held, only: {known}"
        return Refusal(Reason.NO_GRASP, detail)
    tilt = seen.tilt(item)
    if tilt > _MAX_TILT:
        detail = f"the {item} is tilted by {np.degrees(tilt):.0f} degrees"
        return Refusal(Reason.NO_GRASP, detail)
    return None


def _first_plan(scene: Scene, seen: Percept, goals: Sequence[Goal]) -> Plan | Refusal:
    """The first plan; if there is none, the first refusal."""
    grips = best_grips(
        scene, seen, goals, transfer_heights(scene, GRASPS[scene.item][0])
    )
    first: Refusal | None = None
    for grip in grips[:_MAX_GRIPS]:
        outcome = _plan_with(scene, seen, grip)
        if isinstance(outcome, Plan):
            return outcome
        first = first or outcome
    assert first is not None
    return first


def _plan_with(scene: Scene, seen: Percept, grip: Grip) -> Plan | Refusal:
    try:
        found = _plan_path(scene, seen, grip)
    except Unreachable as error:
        return Refusal(_why_unreachable(scene, grip, error), str(error))
    except Overload as error:
        return Refusal(Reason.TOO_HEAVY, str(error))
    checker = CollisionChecker(scene, seen)
    contact = _first_contact(
        checker, found.steps, grip.grasp, grip.goal, grip.grasp.hold
    )
    if contact is None:
        return found
    return Refusal(_why_blocked(scene, grip.grasp, *contact), _say(*contact))


def _plan_path(scene: Scene, seen: Percept, grip: Grip) -> Plan:
    grasp = grip.grasp
    empty_height, held_height = transfer_heights(scene, grasp)
    hover = grip.place.raised_to(max(empty_height, held_height))
    unladen = Load(scene.servos)

    path = Path(np.array(HOME), home_pose(), grasp.approach_opening, unladen)
    path.move("reach", grip.pick.raised_to(empty_height))
    path.move("descend", grip.pick)
    path.grip("close", 0.0, _CLOSING_TIME)
    path.load = Load(scene.servos, PROPS[scene.item].mass)
    path.move("lift", grip.pick.raised_to(held_height))
    path.move("transfer", hover)
    path.wait("hold", _HOLDING_TIME)
    num_picking = len(path.steps)
    _place(path, grasp, grip.goal, grasp.hold)
    num_placed = len(path.steps)
    path.load = unladen
    path.go_home()
    in_receptacle = grip.goal.receptacle is not None
    path.wait("settle", _SETTLING_IN_TIME if in_receptacle else _SETTLING_TIME)
    return Plan(
        goal=grip.goal,
        grasp=grasp,
        hover=hover,
        picking=tuple(path.steps[:num_picking]),
        placing=tuple(path.steps[num_picking:num_placed]),
        returning=tuple(path.steps[num_placed:]),
        seen=seen,
    )


def _place(path: Path, grasp: Grasp, goal: Goal, hold: Hold) -> None:
    """Lower the held item, let it go and come back up."""
    hover = path.pose
    yaw = hover.yaw if grasp.is_symmetric else goal.yaw - hold.yaw
    path.move("lower", hold.tool_pose(goal.release, yaw))
    path.grip("release", grasp.release_opening, _RELEASING_TIME)
    path.move("retreat", hover)


def _first_contact(
    checker: CollisionChecker,
    steps: Sequence[Step],
    grasp: Grasp,
    goal: Goal,
    hold: Hold,
) -> tuple[str, Contact] | None:
    """Find the phase in which something would be touched that should not, and what."""
    for step in steps:
        if step.phase == "release":
            checker.rest_item(goal.rest, goal.yaw)
        contact = checker.first_contact(
            step.positions,
            max(step.opening, grasp.half_width),  # Where the item stops them.
            hold if step.phase in HOLDING else None,
        )
        if contact is not None:
            return step.phase, contact
    return None


def _why_unreachable(scene: Scene, grip: Grip, error: Unreachable) -> Reason:
    """Tell whether neighbours are to blame, the item's place, or that of its goal."""
    if error.phase in _TRANSITS and _is_within_reach(scene, grip):
        return Reason.TOO_TALL
    return Reason.NO_GRASP if error.phase in PICKING else Reason.UNREACHABLE


def _is_within_reach(scene: Scene, grip: Grip) -> bool:
    """Tell whether the arm could get to the goal if no neighbour stood in the way."""
    path = Path(np.array(HOME), home_pose(), 0.0, Load(scene.servos))
    try:
        path.move("transfer", grip.place)
    except (Unreachable, Overload):
        return False
    return True


def _why_blocked(scene: Scene, grasp: Grasp, phase: str, contact: Contact) -> Reason:
    if phase in PICKING:
        return Reason.NO_GRASP
    is_neighbour = contact.other in scene.objects
    palm = grasp.height + PALM_HEIGHT
    if is_neighbour and PROPS[contact.other].height > palm:
        return Reason.TOO_TALL
    return Reason.BLOCKED


def _say(phase: str, contact: Contact) -> str:
    return f"{phase}: {contact}"
