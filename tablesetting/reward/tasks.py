"""The tasks: which item, among which objects, and what the person wants."""

from dataclasses import dataclass, replace

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.reward.footprint import Footprint
from tablesetting.reward.rbf import TABLE_CENTERS

FOOTPRINTS: dict[str, Footprint] = {
    "plate": Footprint(0.180),
    "bowl": Footprint(0.140),
    "cup": Footprint(0.094),
    "glass": Footprint(0.068),
    "fork": Footprint(0.024, half_length=0.156),
    "knife": Footprint(0.020, half_length=0.180),
    "vase": Footprint(0.066),
    "spoon": Footprint(0.032, half_length=0.118),
}
"""What every object covers, in table units; the square is 0.50 m wide."""

RECEPTACLE_RADIUS: float = 0.04
"""How far from a receptacle's center an item can be made to rest, in table units."""


@dataclass(frozen=True)
class PlacementTask:
    """An item to place among objects, and the preference of a simulated person.

    Attributes:
        name: Name on the command line.
        item: What is placed.
        objects: What stands on the table; the order of rows in every layout.
        object_weights: The true weights of the RBFs on the objects.
        table_weights: The true weights of the nine RBFs fixed on the table.
        clearance: Room that the item, and the fingers around it, need between
            footprints, in table units.
        first_layout: The paper's first layout, or None where it was random.
        receptacles: The objects that the item may be put into.
    """

    name: str
    item: str
    objects: tuple[str, ...]
    object_weights: tuple[float, ...]
    table_weights: tuple[float, ...]
    clearance: float
    first_layout: tuple[tuple[float, float], ...] | None = None
    receptacles: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in (*self.objects, self.item):
            if name not in FOOTPRINTS:
                raise ValueError(
                    f"task '{self.name}' names '{name}', which has no footprint; "
                    f"add it to FOOTPRINTS or take one of {', '.join(FOOTPRINTS)}"
                )
        if len(self.object_weights) != len(self.objects):
            raise ValueError(
                f"task '{self.name}' has {len(self.objects)} objects but "
                f"{len(self.object_weights)} object weights; give one for each"
            )
        if len(self.table_weights) != len(TABLE_CENTERS):
            raise ValueError(
                f"task '{self.name}' has {len(self.table_weights)} table weights; "
                f"give {len(TABLE_CENTERS)}"
            )
        for name in self.receptacles:
            if name not in self.objects:
                raise ValueError(
                    f"task '{self.name}' has the receptacle '{name}', which is not "
                    f"among its objects; take from {', '.join(self.objects)}"
                )

    def wanting(self, weights: Array) -> "PlacementTask":
        """Return the task with other true weights, shape (K + 9,)."""
        num_objects = len(self.objects)
        return replace(
            self,
            object_weights=tuple(weights[:num_objects].tolist()),
            table_weights=tuple(weights[num_objects:].tolist()),
        )

    @property
    def true_weights(self) -> Array:
        """The preference to be learned, shape (K + 9,)."""
        return np.array(self.object_weights + self.table_weights)


VASE = PlacementTask(
    name="vase",
    item="vase",
    objects=("plate", "bowl", "glass", "cup"),
    object_weights=(-0.1, -0.1, -0.1, -0.1),
    table_weights=(0.0, 0.0, 0.0, 0.0, 0.6, 0.0, 0.0, 0.0, 0.0),
    clearance=0.024,
    first_layout=((0.25, 0.75), (0.75, 0.75), (0.25, 0.25), (0.75, 0.25)),
)
"""The vase in the centre of the table, away from the objects."""

SPOON = PlacementTask(
    name="spoon",
    item="spoon",
    objects=("bowl", "plate", "cup", "glass", "fork", "knife"),
    object_weights=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    table_weights=(0.0,) * 9,
    clearance=0.04,
    receptacles=("bowl",),
)
"""The spoon in the bowl."""

TASKS: dict[str, PlacementTask] = {task.name: task for task in (VASE, SPOON)}
