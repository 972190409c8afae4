"""What is asked for: where the item shall end, and what speaks against it at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.receptacle import RECEPTACLES
from tablesetting.reward.footprint import stadium_distance
from tablesetting.scene.perception import Percept
from tablesetting.scene.prop_spec import PropSpec
from tablesetting.scene.props import PROPS
from tablesetting.scene.scene import Scene

_DROP: Final = 0.0015  # Height above the table from which an item is let go, in [m].
_SLACK: Final = (
    0.005  # For a receptacle that is not quite where it was thought, in [m].
)
_SWING: Final = 0.012  # Of what leans in a receptacle, sideways, in [m].
_NUM_SPINE_POINTS: Final = 33  # Along the middle of the item, to measure gaps from.


class Reason(StrEnum):
    """Why a placement is refused."""

    OUTSIDE = "outside"
    """The item would not lie on the table."""
    OCCUPIED = "occupied"
    """Something else stands there."""
    UNREACHABLE = "unreachable"
    """The arm is too short, or too long, to get there."""
    BLOCKED = "blocked"
    """Arm or item would touch something on the way."""
    TOO_TALL = "too tall"
    """The same, or out of reach, because of something tall that is in the way."""
    NO_GRASP = "no grasp"
    """The item cannot be picked up where it is."""
    TOO_HEAVY = "too heavy"
    """The joints are too weak."""


@dataclass(frozen=True)
class Refusal:
    """A placement that cannot be carried out, found out before any motion."""

    reason: Reason
    detail: str


@dataclass(frozen=True)
class Goal:
    """Where the item shall end.

    Attributes:
        target: Where it shall be, shape (2,), in [m]: the centre of its footprint or, in
            a receptacle, its centre of mass.
        yaw: Its heading, in [rad], 0 as laid.
        release: Its origin when it is let go, shape (3,), in [m].
        receptacle: What it is put into; None on the table.
    """

    target: Array
    yaw: float
    release: Array
    receptacle: str | None = None

    @property
    def rest(self) -> Array:
        """Its origin once it lies on the table, shape (3,); in a bowl, as let go."""
        if self.receptacle is not None:
            return self.release
        return np.array([*self.target, 0.0])


def find_goals(
    scene: Scene, seen: Percept, target: Array, yaw: float | None
) -> list[Goal] | Refusal:
    """Tell what a request comes to.

    Args:
        scene: Says which props there are.
        seen: Where they are.
        target: Where the item shall be, shape (2,), in [m].
        yaw: Its heading, in [rad]; None for 0, or any that will do in a receptacle.

    Returns:
        One goal on the table, or some for a receptacle; or why there is none.
    """
    if not _is_within(scene, target, PROPS[scene.item], yaw or 0.0):
        where = f"({target[0]:.3f}, {target[1]:.3f}) m"
        return Refusal(
            Reason.OUTSIDE, f"at {where} the {scene.item} would not lie on the table"
        )
    receptacle = _receptacle_at(scene, seen, target)
    if receptacle is not None:
        return _goals_in(receptacle, scene, seen, target, yaw)
    goal = Goal(target, yaw or 0.0, np.array([*target, _DROP]))
    for name in scene.objects:
        gap = gap_at(scene, seen, goal.target, goal.yaw, name)
        if gap < 0.0:
            detail = f"the {scene.item} would stand {-1e3 * gap:.1f} mm in the {name}"
            return Refusal(Reason.OCCUPIED, detail)
    return [goal]


def _receptacle_at(scene: Scene, seen: Percept, target: Array) -> str | None:
    """Name what an item is to be put into: a target on it, not only near it."""
    for name in scene.objects:
        offset = target - seen.position(name)[:2]
        is_over = np.linalg.norm(offset) <= PROPS[name].radius
        if (scene.item, name) in RECEPTACLES and is_over:
            return name
    return None


def _goals_in(
    name: str, scene: Scene, seen: Percept, target: Array, yaw: float | None
) -> list[Goal] | Refusal:
    item = scene.item
    receptacle = RECEPTACLES[item, name]
    offset = target - seen.position(name)[:2]
    distance = float(np.linalg.norm(offset))
    if distance > receptacle.radius + _SLACK:
        detail = (
            f"the {item} can be put into the {name} within {1e3 * receptacle.radius:.0f}"
            f" mm of its centre, not {1e3 * distance:.0f} mm from it"
        )
        return Refusal(Reason.OCCUPIED, detail)
    headings = receptacle.headings(offset) if yaw is None else np.array([yaw])
    goals = [
        Goal(target, heading, receptacle.release(name, item, target, heading), name)
        for heading in headings.tolist()
        if receptacle.takes(offset, heading)
    ]
    if not goals:
        detail = (
            f"with this heading the {item} would come to lie on the rim of the {name}"
        )
        return Refusal(Reason.OCCUPIED, detail)
    tall = [each for each in scene.objects if PROPS[each].height > PROPS[name].height]
    clear = [goal for goal in goals if _is_clear(scene, seen, goal, tall)]
    if clear:
        return clear
    detail = f"leaning in the {name}, the {item} might touch the {' or '.join(tall)}"
    return Refusal(Reason.TOO_TALL, detail)


def _is_clear(scene: Scene, seen: Percept, goal: Goal, tall: Sequence[str]) -> bool:
    """Tell whether what sticks out of a receptacle has room to come to rest."""
    origin = goal.target + _turn(-PROPS[scene.item].center_of_mass[:2], goal.yaw)
    gaps = [gap_at(scene, seen, origin, goal.yaw, each) for each in tall]
    return min(gaps, default=np.inf) >= _SWING


def gap_at(scene: Scene, seen: Percept, target: Array, yaw: float, name: str) -> float:
    """Return how far the item would be from a prop, footprint to footprint, in [m].

    Args:
        scene: Says what the item is.
        seen: Where the prop is.
        target: Where the item would be, shape (2,), in [m].
        yaw: Its heading, in [rad].
        name: The prop.
    """
    item, other = PROPS[scene.item], PROPS[name]
    spine = _spine(item, target, yaw)
    offsets = _turn(spine - seen.position(name)[:2], -seen.yaw(name))
    distances = stadium_distance(offsets, other.radius, other.half_length)
    return float(distances.min()) - item.radius


def _is_within(scene: Scene, target: Array, item: PropSpec, yaw: float) -> bool:
    top = scene.model.geom("top")
    spine = np.abs(_spine(item, target, yaw) - top.pos[:2])
    return bool((spine + item.radius <= top.size[:2]).all())


def _spine(spec: PropSpec, center: Array, yaw: float) -> Array:
    """Points along the segment in the middle of a footprint, shape (S, 2), in [m]."""
    num = _NUM_SPINE_POINTS if spec.half_length > 0.0 else 1
    along = np.linspace(-spec.half_length, spec.half_length, num)
    if num == 1:
        along = np.zeros(1)
    return center + _turn(np.stack([0.0 * along, along], axis=-1), yaw)


def _turn(points: Array, yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return points @ np.array([[c, s], [-s, c]])
