"""How each item is held, and where that puts the tool."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.scene.robot import BASE_POSITION

_APPROACH_GAP: Final = 0.015  # [m]
_RELEASE_GAP: Final = 0.008  # [m]


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
    """How to hold one kind of item that stands or lies with yaw 0."""

    height: float
    """Tool centre point above the item's origin, in [m]."""
    half_width: float
    """Half the width of what is between the fingers, in [m]."""
    along: float = 0.0
    """Tool centre point ahead of the item's origin, along the item's y, in [m]."""
    is_symmetric: bool = False
    """Whether the item looks the same from all sides, so that its yaw is free."""

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
        """Where the item is in the tool if nothing slips."""
        return Hold(np.array([-self.along, 0.0, self.height]), -np.pi / 2)

    def tool_pose(self, item_position: Array) -> ToolPose:
        """Pose of the tool that holds an item standing at a position (2,), in [m].

        A symmetric item is held with the tool in line with the arm, any other with the
        fingers on both sides of its length.
        """
        x, y = item_position - BASE_POSITION[:2]
        yaw = float(np.arctan2(y, x)) if self.is_symmetric else np.pi / 2
        return self.hold.tool_pose(np.array([*item_position, 0.0]), yaw)


_HANDLE: Final = Grasp(height=0.017, half_width=0.005)

GRASPS: Final[dict[str, tuple[Grasp, ...]]] = {
    # At the neck, where the fingers stay above everything else on the table.
    "vase": (Grasp(height=0.135, half_width=0.018, is_symmetric=True),),
    # Anywhere on the handle: further out for places close to the arm, further in for
    # those at the far end of its reach. The finger tips clear the table by 1 mm.
    "spoon": (_HANDLE, replace(_HANDLE, along=0.012), replace(_HANDLE, along=-0.03)),
}
"""The ways to hold each item that can be placed, by name, best first."""
