"""Layouts: where the objects may stand, and random ones."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tablesetting.errors import InvalidLayout
from tablesetting.irl.arrays import Array, Booleans
from tablesetting.reward.footprint import POINT, Footprint
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.tasks import FOOTPRINTS, RECEPTACLE_RADIUS, PlacementTask

_MIN_GAP = 0.03  # Between footprints of objects, in table units: 15 mm.
_BATCH = 256  # Layouts drawn at once.
_MAX_MISSES = 400  # Batches in a row without a possible layout.
_ROOM_TICKS = (np.arange(32) + 0.5) / 32
_ROOM_GRID = np.stack(np.meshgrid(_ROOM_TICKS, _ROOM_TICKS), axis=-1)


@dataclass(frozen=True)
class LayoutSpace:
    """The layouts of a task that are physically possible.

    Attributes:
        objects: Names of the objects, K of them.
        footprints: Their footprints, one each.
        item: Footprint of the item to place.
        clearance: Room around the item, in table units.
    """

    objects: tuple[str, ...]
    footprints: tuple[Footprint, ...]
    item: Footprint
    clearance: float

    @classmethod
    def of_task(cls, task: PlacementTask, *, are_points: bool) -> "LayoutSpace":
        """Return the layouts of a task, its objects of true size or mere points."""
        sizes = {name: POINT if are_points else FOOTPRINTS[name] for name in FOOTPRINTS}
        return cls(
            objects=task.objects,
            footprints=tuple(sizes[name] for name in task.objects),
            item=sizes[task.item],
            clearance=task.clearance,
        )

    def free_space(self, layout: Array, receptacles: Sequence[str] = ()) -> FreeSpace:
        """Return where the item fits among the objects, and in some of them.

        Args:
            layout: Object centers, shape (K, 2), in table units.
            receptacles: The objects that the item may be put into.
        """
        return FreeSpace.around(
            layout,
            self.footprints,
            self.item,
            self.clearance,
            receptacles=[self.objects.index(name) for name in receptacles],
            receptacle_radius=RECEPTACLE_RADIUS,
        )

    def are_apart(self, layouts: Array) -> Booleans:
        """Tell in which layouts, shape (L, K, 2), no two objects touch, shape (L,)."""
        apart = np.ones(len(layouts), dtype=bool)
        for first, second, grown in self._solid_pairs():
            apart &= grown.distance(layouts[:, first] - layouts[:, second]) >= 0.0
        return apart

    def has_room(self, layout: Array) -> bool:
        """Tell whether the item fits anywhere on the table, beside all objects."""
        return bool(self.free_space(layout).contains(_ROOM_GRID).any())

    def check(self, layout: Array) -> None:
        """Refuse a layout that cannot be set up.

        Args:
            layout: Object centers, shape (K, 2), in table units.

        Raises:
            InvalidLayout: If an object is off the table, two of them overlap, or the
                item fits nowhere.
        """
        if layout.shape != (len(self.objects), 2):
            raise InvalidLayout(
                f"layout has shape {layout.shape}; give one (x, y) for each of "
                f"{', '.join(self.objects)}"
            )
        for name, center in zip(self.objects, layout, strict=True):
            if not ((center >= 0.0) & (center <= 1.0)).all():
                raise InvalidLayout(
                    f"'{name}' is off the table at {_show(center)}; "
                    "both coordinates must be in [0, 1]"
                )
        for first, second, grown in self._solid_pairs():
            gap = float(grown.distance(layout[first] - layout[second]))
            if gap < 0.0:
                raise InvalidLayout(
                    f"'{self.objects[first]}' at {_show(layout[first])} and "
                    f"'{self.objects[second]}' at {_show(layout[second])} are too "
                    f"close; move them apart by {-gap:.3f} table units or more"
                )
        if not self.has_room(layout):
            raise InvalidLayout(
                "the item fits nowhere among the objects; move some of them together"
            )

    def sample(self, num_layouts: int, *, rng: np.random.Generator) -> Array:
        """Draw layouts uniformly from the possible ones, shape (L, K, 2)."""
        shape = (_BATCH, len(self.objects), 2)
        return self._collect(
            num_layouts,
            lambda: rng.random(shape),
            f"{', '.join(self.objects)} hardly fit on the table together; take fewer or "
            "smaller objects",
        )

    def sample_one_moved(
        self, layout: Array, num_layouts: int, *, rng: np.random.Generator
    ) -> Array:
        """Draw layouts that differ from one in the place of one object.

        Args:
            layout: The layout to start from, shape (K, 2), in table units.
            num_layouts: How many, L.
            rng: Source of the moves.

        Returns:
            Layouts, shape (L, K, 2).

        Raises:
            InvalidLayout: If no move that leads to a possible one is found.
        """

        def propose() -> Array:
            layouts = np.repeat(layout[None], _BATCH, axis=0)
            moved = rng.integers(len(self.objects), size=_BATCH)
            layouts[np.arange(_BATCH), moved] = rng.random((_BATCH, 2))
            return layouts

        return self._collect(
            num_layouts, propose, "no move of one object makes all stand apart"
        )

    def outlines(self, layout: Array) -> dict[str, Array]:
        """Return points around each object, for drawing.

        Args:
            layout: Object centers, shape (K, 2), in table units.

        Returns:
            By name, points of shape (S, 2); the center alone of a point.
        """
        named = zip(self.objects, self.footprints, layout, strict=True)
        return {name: center + _around(size) for name, size, center in named}

    def _solid_pairs(self) -> list[tuple[int, int, Footprint]]:
        """List pairs of objects that have a size, each with the sum of the two."""
        solid = [k for k, size in enumerate(self.footprints) if size != POINT]
        return [
            (i, j, self.footprints[i].grow(self.footprints[j], _MIN_GAP))
            for i in solid
            for j in solid
            if i < j
        ]

    def _collect(
        self, num_layouts: int, propose: Callable[[], Array], failure: str
    ) -> Array:
        """Draw batches until enough layouts are possible."""
        kept: list[Array] = []
        num_misses = 0
        while len(kept) < num_layouts:
            found = self._possible(propose())
            kept.extend(found)
            num_misses = 0 if len(found) else num_misses + 1
            if num_misses == _MAX_MISSES:
                raise InvalidLayout(failure)
        return np.stack(kept[:num_layouts])

    def _possible(self, layouts: Array) -> Array:
        """Keep the layouts, of shape (L, K, 2), that can be set up."""
        if all(size == POINT for size in self.footprints):
            return layouts
        apart = layouts[self.are_apart(layouts)]
        return apart[[self.has_room(layout) for layout in apart]]


def _show(center: Array) -> str:
    """Write a position for a message."""
    return f"({center[0]:.3f}, {center[1]:.3f})"


def _around(footprint: Footprint) -> Array:
    """Return offsets along a footprint's outline, shape (S, 2)."""
    if footprint == POINT:
        return np.zeros((1, 2))
    return footprint.outline(np.linspace(0.0, footprint.perimeter, 73))[0]
