"""The arm at work: from a layout and a placement on the table to how it went."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from tablesetting.experiments.config import ArmConfig
from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution, run_to_end
from tablesetting.planner.goal import Refusal
from tablesetting.planner.place import place
from tablesetting.scene.perception import Camera, SensorNoise
from tablesetting.scene.scene import Scene, Snapshot
from tablesetting.scene.servos import SERVOS
from tablesetting.scene.table import FAST_TIMESTEP, TIMESTEP
from tablesetting.scene.variation import Variation

Watcher = Callable[
    [Generator[Snapshot, None, Execution | Refusal]],
    Generator[Snapshot, None, Execution | Refusal],
]
"""Passes the snapshots of an episode through, as a recorder does."""


@dataclass(frozen=True)
class Attempt:
    """One placement that the arm was told to make.

    Attributes:
        commanded: Where the item was to be put, shape (2,), in table units.
        settled: Where it came to rest, shape (2,), in table units; None if the
            placement was refused before any motion, as are the next three.
        error_mm: Distance of the two.
        tilt_deg: Tilt of the item at rest; None in a receptacle, too, where it leans.
        max_bystander_shift_mm: Furthest that any object was moved.
        failure: Why it was refused or is no success; None for a success.
        seconds: Time that planning and simulation took.
        receptacle: What the item was put into; None on the table.
    """

    commanded: Array
    settled: Array | None
    error_mm: float | None
    tilt_deg: float | None
    max_bystander_shift_mm: float | None
    failure: str | None
    seconds: float
    receptacle: str | None = None

    @property
    def is_refused(self) -> bool:
        """Whether nothing was moved."""
        return self.settled is None


class Arm:
    """An arm at a table, as the options have it.

    Attributes:
        scene: The table.
    """

    def __init__(
        self, objects: Sequence[str], item: str, config: ArmConfig | None = None
    ) -> None:
        """Compile the scene.

        Args:
            objects: Names of the props that stand on the table.
            item: Name of the prop to be placed.
            config: How good servos and senses are; perfect if None.
        """
        config = config or ArmConfig()
        self.scene = Scene(
            objects,
            item,
            servos=SERVOS[config.servos],
            timestep=FAST_TIMESTEP if config.fast else TIMESTEP,
        )
        noise = SensorNoise(
            item_std=1e-3 * config.item_noise_mm,
            item_yaw_std=float(np.radians(config.item_noise_deg)),
            layout_std=1e-3 * config.layout_noise_mm,
        )
        self._noise = noise if noise != SensorNoise() else None
        variation = Variation(config.mass_spread, config.friction_spread)
        self._variation = variation if variation != Variation() else None

    def lay(self, layout: Array, *, rng: np.random.Generator) -> None:
        """Lay the table, shape (K, 2) in table units, with props as they may be."""
        self.scene.dynamics.restore()
        if self._variation is not None:
            self.scene.dynamics.draw(self._variation, rng=rng)
        self.scene.reset(layout)

    def camera(self, *, rng: np.random.Generator) -> Camera:
        """What the arm sees by."""
        return Camera(self.scene, self._noise, rng=rng)

    def place(
        self,
        layout: Array,
        placement: Array,
        watch: Watcher,
        *,
        rng: np.random.Generator,
    ) -> Attempt:
        """Lay the table and put the item at a placement.

        Args:
            layout: Object centers, shape (K, 2), in table units.
            placement: Where to put the item, shape (2,), in table units.
            watch: Sees every motion.
            rng: Source of errors of the senses and of variations of the props.

        Returns:
            How it went; a placement that cannot be carried out is refused, not raised.
        """
        started = perf_counter()
        self.lay(layout, rng=rng)
        target = self.scene.frame.to_world(placement)
        outcome = run_to_end(
            watch(place(self.scene, target, camera=self.camera(rng=rng)))
        )
        seconds = perf_counter() - started
        if isinstance(outcome, Refusal):
            reason = f"refused, {outcome.reason}: {outcome.detail}"
            return Attempt(placement, None, None, None, None, reason, seconds)
        return Attempt(
            commanded=placement,
            settled=self.scene.frame.from_world(outcome.settled),
            error_mm=outcome.error_mm,
            tilt_deg=outcome.tilt_deg if outcome.receptacle is None else None,
            max_bystander_shift_mm=outcome.max_bystander_shift_mm,
            failure=str(outcome.failure) if outcome.failure else None,
            seconds=seconds,
            receptacle=outcome.receptacle,
        )
