"""The table: where its unit square lies in the world, and the arena around it."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from dm_control import composer, mjcf

from tablesetting.irl.arrays import Array
from tablesetting.scene.furniture import TABLE_CENTER, TABLE_HALF_SIZE, furnish

TIMESTEP: Final = 0.002
"""Time step of the simulation unless told otherwise, in [s]."""
FAST_TIMESTEP: Final = 0.004
"""Time step that is faster and half as accurate, in [s]."""


@dataclass(frozen=True)
class TableFrame:
    """Maps table units to the world of the simulator.

    The unit square is centred on the origin of the world; in both frames x points to
    the right and y away from the robot.
    """

    size: tuple[float, float] = (0.5, 0.5)
    """Extent of the unit square along x and y, in [m]."""

    def __post_init__(self) -> None:
        if not all(0.0 < extent < np.inf for extent in self.size):
            raise ValueError(f"`size` must be positive and finite; got {self.size}")

    def to_world(self, points: Array) -> Array:
        """Convert positions from table units to metres.

        Args:
            points: Positions, shape (..., 2), in table units.

        Returns:
            Positions in the world, shape (..., 2), in [m].
        """
        return (np.asarray(points) - 0.5) * self.size

    def from_world(self, points: Array) -> Array:
        """Convert positions from metres to table units.

        Args:
            points: Positions in the world, shape (..., 2), in [m].

        Returns:
            Positions, shape (..., 2), in table units.
        """
        return np.asarray(points) / self.size + 0.5


class Table(composer.Arena):
    """A wooden table whose top is the plane z = 0; a mat covers the unit square."""

    def _build(
        self, frame: TableFrame | None = None, timestep: float = TIMESTEP
    ) -> None:
        self._frame = frame or TableFrame()
        self._timestep = timestep
        self._mjcf_root = mjcf.RootElement(model="table")
        self._set_options()
        self._add_top()
        furnish(self._mjcf_root, self._frame.size)

    @property
    def frame(self) -> TableFrame:
        """Where the unit square lies in the world."""
        return self._frame

    def _set_options(self) -> None:
        # Radians, because an attached robot's angles are merged without conversion.
        self._mjcf_root.compiler.angle = "radian"
        option = self._mjcf_root.option
        option.timestep = self._timestep
        option.integrator = "implicitfast"
        option.cone = "elliptic"
        option.impratio = 10.0
        # Said out loud, so that a model which disables it cannot be attached unnoticed.
        option.flag.nativeccd = "enable"
        option.flag.sleep = "enable"  # Things at rest cost nothing.

    def _add_top(self) -> None:
        """Add the plane that everything stands on; it collides faster than a box."""
        self._mjcf_root.worldbody.add(
            "geom",
            name="top",
            type="plane",
            pos=(*TABLE_CENTER, 0.0),
            size=(*TABLE_HALF_SIZE, 0.1),
            group=3,
        )
