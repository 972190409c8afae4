"""How each item is held, and where that puts the tool."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.scene.jaw import WRIST_OFFSET
from tablesetting.scene.robot import BASE_POSITION

_APPROACH_GAP: Final = 0.015  # [m]
_RELEASE_GAP: Final = 0.008  # [m]
_NUM_SYMMETRIC_YAWS: Final = 24


@dataclass(frozen=True)
class ToolPose:
    """Pose of a tool that points straight down.

    Attributes:
        position: Tool centre point in the world, shape (3,), in [m].
        yaw: Heading of the tool's x axis about the vertical, in [rad]; the fingers
            move at right angles to it.
    """

    position: Array
    yaw: float

    @property
    def rotation(self) -> Array:
        """Orientation of the tool in the world, shape (3, 3)."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([[c, s, 0.0], [s, -c, 0.0], [0.0, 0.0, -1.0]])

    @property
    def wrist(self) -> Array:
        """Where the axis of the wrist is, seen from the arm's foot, (2,), in [m]."""
        ahead = np.array([np.cos(self.yaw), np.sin(self.yaw)])
        return self.position[:2] - WRIST_OFFSET * ahead - BASE_POSITION[:2]

    def raised_to(self, height: float) -> "ToolPose":
        """The pose above or below this one whose height is `height`, in [m]."""
        return replace(self, position=np.array([*self.position[:2], height]))


@dataclass(frozen=True)
class Hold:
    """Where a held item is, seen from the tool.

    Attributes:
        offset: Origin of the item in the frame of the tool, shape (3,), in [m].
        yaw: Heading of the item minus that of the tool, in [rad].
    """

    offset: Array
    yaw: float

    @classmethod
    def measure(cls, tool: ToolPose, position: Array, yaw: float) -> "Hold":
        """The hold that puts an item of that pose, shape (3,) in [m], in the tool."""
        return cls(tool.rotation.T @ (position - tool.position), yaw - tool.yaw)

    def tool_pose(self, item_position: Array, tool_yaw: float) -> ToolPose:
        """Pose of the tool when the item's origin is at `item_position`, (3,)."""
        tool = ToolPose(np.asarray(item_position, dtype=np.float64), tool_yaw)
        return replace(tool, position=tool.position - tool.rotation @ self.offset)


@dataclass(frozen=True)
class Grasp:
    """How to hold one kind of item that stands or lies on its underside."""

    height: float
    """Tool centre point above the item's origin, in [m]."""
    half_width: float
    """Half the width of what is between the fingers, in [m]."""
    along: float = 0.0
    """Tool centre point ahead of the item's origin, along the item's y, in [m]."""
    is_symmetric: bool = False
    """Whether the item looks the same from all sides, so that its yaw is free."""
    is_reversed: bool = False
    """Whether the wrist is on the item's far side, towards its y, not on the near one."""

    @property
    def approach_opening(self) -> float:
        """Travel of each finger before the jaw closes, in [m]."""
        return self.half_width + _APPROACH_GAP

    @property
    def release_opening(self) -> float:
        """Travel of each finger that frees the item, in [m].

        Less than the jaw could open, to spare the neighbours.
        """
        return self.half_width + _RELEASE_GAP

    @property
    def hold(self) -> Hold:
        """Where the item is in the tool if nothing slips.

        The fingers close across the item's length. So the tool's x axis points along it,
        to one end or the other.
        """
        if self.is_reversed:
            return Hold(np.array([self.along, 0.0, self.height]), np.pi / 2)
        return Hold(np.array([-self.along, 0.0, self.height]), -np.pi / 2)

    def tool_poses(self, item_position: Array, item_yaw: float) -> list[ToolPose]:
        """Poses of the tool that hold an item standing somewhere, one or many.

        Args:
            item_position: Origin of the item, shape (3,), in [m].
            item_yaw: Its heading, in [rad]; of no effect if it is symmetric.
        """
        if not self.is_symmetric:
            return [self.hold.tool_pose(item_position, item_yaw - self.hold.yaw)]
        x, y = item_position[:2] - BASE_POSITION[:2]
        outwards = float(np.arctan2(y, x))
        turns = np.linspace(0.0, 2.0 * np.pi, _NUM_SYMMETRIC_YAWS, endpoint=False)
        return [
            self.hold.tool_pose(item_position, outwards + turn)
            for turn in turns.tolist()
        ]


# The finger tips clear the table by 2.5 mm.
_HANDLE: Final = Grasp(height=0.0185, half_width=0.005)

GRASPS: Final[dict[str, tuple[Grasp, ...]]] = {
    # At the neck, where the fingers stay above everything else on the table.
    "vase": (Grasp(height=0.135, half_width=0.018, is_symmetric=True),),
    # Anywhere on the handle, from either side: further out for places close to the arm,
    # further in for those at the far end of its reach.
    "spoon": tuple(
        replace(_HANDLE, along=along, is_reversed=is_reversed)
        for along in (0.0, 0.012, -0.015, -0.03, -0.045)
        for is_reversed in (False, True)
    ),
}
"""The ways to hold each item that can be placed, by name, most secure first."""
