"""How much room the hand has among the neighbours of an item."""

from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.planner.grasp import ToolPose
from tablesetting.reward.footprint import stadium_distance
from tablesetting.scene.jaw import (
    FINGER_DEPTH,
    FINGER_HALF_WIDTH,
    PALM_HALF_WIDTH,
    PALM_HEIGHT,
    TIP_REACH,
    WRIST_OFFSET,
)
from tablesetting.scene.perception import Percept
from tablesetting.scene.props import PROPS

_PALM_HALF_DEPTH: Final = 0.02  # [m]
_PALM: Final = np.array(
    list(
        product(
            np.linspace(-WRIST_OFFSET - _PALM_HALF_DEPTH, _PALM_HALF_DEPTH, 6),
            (-PALM_HALF_WIDTH, 0.0, PALM_HALF_WIDTH),
        )
    )
)  # Points of the palm and its bracket around the tool centre point, (P, 2), in [m].


def clearances(
    tools: Sequence[ToolPose], opening: float, seen: Percept, names: Sequence[str]
) -> Array:
    """Return the room around the hand, for many poses at the same height.

    Args:
        tools: The poses, N of them.
        opening: Travel of each finger, in [m].
        seen: Where things are.
        names: The neighbours that count.

    Returns:
        Distance to the nearest neighbour that is as tall as the hand is low, shape (N,),
        in [m]; negative inside, infinite without such neighbours.
    """
    height = float(tools[0].position[2])
    gaps = np.full(len(tools), np.inf)
    for outline, underside in (
        (_fingers(opening), height - TIP_REACH),
        (_PALM, height + PALM_HEIGHT),
    ):
        tall = [name for name in names if PROPS[name].height > underside]
        if not tall:
            continue
        points = np.stack([_placed(outline, tool) for tool in tools])
        for name in tall:
            gaps = np.minimum(gaps, _gaps(points, name, seen))
    return gaps


def _fingers(opening: float) -> Array:
    """Points of both fingers around the tool centre point, shape (P, 2), in [m]."""
    across = opening + FINGER_DEPTH * np.array([0.0, 0.5, 1.0])
    along = FINGER_HALF_WIDTH * np.array([-1.0, 0.0, 1.0])
    return np.array(list(product(along, [*across, *-across])))


def _placed(outline: Array, tool: ToolPose) -> Array:
    return tool.position[:2] + outline @ tool.rotation[:2, :2].T


def _gaps(points: Array, name: str, seen: Percept) -> Array:
    """Least distance of points (N, P, 2) to a prop, shape (N,), in [m]."""
    spec, yaw = PROPS[name], seen.yaw(name)
    c, s = np.cos(yaw), np.sin(yaw)
    offsets = (points - seen.position(name)[:2]) @ np.array([[c, -s], [s, c]])
    return stadium_distance(offsets, spec.radius, spec.half_length).min(axis=1)
