"""Which way to hold the item: within comfortable reach, with room for the hand."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.goal import Goal
from tablesetting.planner.grasp import GRASPS, Grasp, ToolPose
from tablesetting.planner.hand import clearances
from tablesetting.scene.perception import Percept
from tablesetting.scene.robot import BASE_POSITION
from tablesetting.scene.scene import Scene

_ENOUGH_ROOM: Final = 0.015  # Around the hand; more is no better, in [m].
_ENOUGH_MARGIN: Final = 0.04  # Of the wrist to the limits of reach, in [m].
# Nearest and furthest that the wrist gets from the axis of the arm's foot with the tool
# pointing down, at heights of the tool centre point above the foot; [m].
_HEIGHTS: Final = (-0.10, 0.00, 0.04, 0.08, 0.14, 0.18, 0.22, 0.26, 0.30, 0.36)
_NEAREST: Final = (0.085, 0.175, 0.185, 0.190, 0.175, 0.155, 0.115, 0.065, 0.060, 0.050)
_FURTHEST: Final = (
    0.680,
    0.700,
    0.705,
    0.705,
    0.705,
    0.700,
    0.695,
    0.690,
    0.680,
    0.655,
)
_TURN_COST: Final = 0.002  # Of turning the hand on the way, in [m/rad].


@dataclass(frozen=True)
class Grip:
    """A way to carry the item to a goal.

    Attributes:
        grasp: How it is held.
        goal: Where it goes.
        pick: Pose of the tool when it takes the item.
        place: Pose of the tool when it lets go.
        score: How good it is, in [m] of room and reach.
    """

    grasp: Grasp
    goal: Goal
    pick: ToolPose
    place: ToolPose
    score: float


def best_grips(
    scene: Scene, seen: Percept, goals: Sequence[Goal], heights: tuple[float, float]
) -> list[Grip]:
    """Rank all ways to carry the item to one of some goals.

    Args:
        scene: Says which neighbours there are.
        seen: Where they and the item are.
        goals: Any of them will do.
        heights: Of the tool in transit, empty-handed and with the item, in [m].

    Returns:
        The ways, best first.
    """
    grips = []
    for grasp in GRASPS[scene.item]:
        stand = seen.position(scene.item) * [1, 1, 0]
        picks = grasp.tool_poses(stand, seen.yaw(scene.item))
        pick_scores = _scores(scene, seen, grasp, picks, heights)
        best = int(pick_scores.argmax())
        pick, pick_score = picks[best], float(pick_scores[best])
        ends = [
            (goal, place)
            for goal in goals
            for place in grasp.tool_poses(goal.release, goal.yaw)
        ]
        scores = _scores(scene, seen, grasp, [place for _, place in ends], heights)
        grips += [
            Grip(grasp, goal, pick, place, _total(pick_score, score, pick, place))
            for (goal, place), score in zip(ends, scores.tolist(), strict=True)
        ]
    return sorted(grips, key=lambda grip: -grip.score)


def _scores(
    scene: Scene,
    seen: Percept,
    grasp: Grasp,
    tools: Sequence[ToolPose],
    heights: tuple[float, float],
) -> Array:
    """Room and reach of tool poses at one height, shape (N,), in [m]."""
    room = clearances(tools, grasp.approach_opening, seen, scene.objects)
    scores = np.minimum(room, _ENOUGH_ROOM)
    radii = np.array([np.hypot(*tool.wrist) for tool in tools])
    for height in (tools[0].position[2], max(heights)):
        scores = scores + np.minimum(_margins(radii, height), _ENOUGH_MARGIN)
    return scores


def _margins(radii: Array, height: float) -> Array:
    """How far wrists at some radii (N,) are from the limits of reach, in [m]."""
    above_foot = height - BASE_POSITION[2]
    nearest = np.interp(above_foot, _HEIGHTS, _NEAREST)
    furthest = np.interp(above_foot, _HEIGHTS, _FURTHEST)
    return np.minimum(radii - nearest, furthest - radii)


def _total(
    pick_score: float, place_score: float, pick: ToolPose, place: ToolPose
) -> float:
    """The worse of both ends counts most; turning the hand between them costs a little."""
    turn = (_heading(place) - _heading(pick) + np.pi) % (2.0 * np.pi) - np.pi
    both = 0.1 * (pick_score + place_score)
    return min(pick_score, place_score) + both - _TURN_COST * abs(turn)


def _heading(tool: ToolPose) -> float:
    """Heading of the tool against the direction in which the arm points, in [rad]."""
    x, y = tool.wrist
    return float(tool.yaw - np.arctan2(y, x))
