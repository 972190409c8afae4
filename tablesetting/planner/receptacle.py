"""Things that an item can be put into: the spoon into the bowl.

The spoon is longer than the bowl is wide. Let go just above the rim, its head slides to
the bottom and its handle comes to lean on the rim; thereby its centre of mass moves back
along the handle by nearly the same amount from wherever it was let go. So it is let go
that much ahead. Its head must be the end that goes down: the centre of mass is kept on
the handle's side of the bowl's centre.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.scene.props import PROPS

_RIM_CLEARANCE: Final = 0.008  # Of the item above the rim when it is let go, in [m].
_NUM_HEADINGS: Final = 24


@dataclass(frozen=True)
class Receptacle:
    """How an item is put into a receptacle; measured by letting it fall.

    Attributes:
        radius: How far from the receptacle's centre the item's centre of mass can be
            put, in [m].
        slide: How far the centre of mass moves back along the item as it comes to
            rest, in [m].
        max_ahead: How far the centre of mass may come to rest ahead of the receptacle's
            centre, seen along the item, in [m].
        max_aside: The same across the item, to either side.
        max_tilt: Of an item that lies in it, in [rad].
        depth: How far below the rim its centre of mass comes to lie at least, in [m].
    """

    radius: float
    slide: float
    max_ahead: float
    max_aside: float
    max_tilt: float
    depth: float

    def headings(self, offset: Array) -> Array:
        """Headings with which an item can be put at an offset from the centre.

        Args:
            offset: Of the item's centre of mass, shape (2,), in [m].

        Returns:
            Angles about the vertical, shape (H,), in [rad].
        """
        back = np.arctan2(offset[0], -offset[1])  # The head points to the centre.
        angles = back + np.linspace(0.0, 2.0 * np.pi, _NUM_HEADINGS, endpoint=False)
        return np.array([angle for angle in angles if self.takes(offset, angle)])

    def takes(self, offset: Array, yaw: float) -> bool:
        """Tell whether an item of a heading, in [rad], can be put at an offset (2,)."""
        ahead = np.array([-np.sin(yaw), np.cos(yaw)])
        aside = abs(offset[0] * ahead[1] - offset[1] * ahead[0])
        return bool(offset @ ahead <= self.max_ahead and aside <= self.max_aside)

    def release(self, name: str, item: str, target: Array, yaw: float) -> Array:
        """Origin of the item when it is let go, shape (3,), in [m].

        Args:
            name: The receptacle.
            item: The item.
            target: Where its centre of mass shall come to rest, shape (2,), in [m].
            yaw: Its heading, in [rad].
        """
        ahead = np.array([-np.sin(yaw), np.cos(yaw)])
        origin = target + (self.slide - PROPS[item].center_of_mass[1]) * ahead
        return np.array([*origin, PROPS[name].height + _RIM_CLEARANCE])


RECEPTACLES: Final[dict[tuple[str, str], Receptacle]] = {
    ("spoon", "bowl"): Receptacle(
        radius=0.02,
        slide=0.0055,
        max_ahead=0.001,
        max_aside=0.012,
        max_tilt=float(np.radians(60.0)),
        depth=0.010,
    )
}
"""How each item is put into each receptacle, by their names."""
