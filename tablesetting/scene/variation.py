"""Props that are heavier, lighter, rougher or slicker than the model says."""

from dataclasses import dataclass

import mujoco
import numpy as np

from tablesetting.irl.arrays import Array, Indices

_SLIDING = 0  # Column of `geom_friction`.


@dataclass(frozen=True)
class Variation:
    """How far mass and friction of the props are spread, each prop by itself."""

    mass: float = 0.0
    """Largest relative change: 0.5 is from 1 / 1.5 to 1.5 times the mass."""
    friction: float = 0.0
    """The same of the friction of each prop on the table, and of the pads on any prop."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 <= value <= 10.0:
                raise ValueError(f"`{name}` must be in [0, 10]; got {value}")


class PropDynamics:
    """Mass and friction of the props of a model, to be changed and restored."""

    def __init__(
        self, model: mujoco.MjModel, bodies: Indices, pads: Indices, table: int
    ) -> None:
        """Remember what the model says.

        Args:
            model: Will be changed.
            bodies: Ids of the props' bodies, shape (P,).
            pads: Ids of the finger pads among the geoms; their friction counts where
                they touch a prop.
            table: Id of the geom that the props stand on.
        """
        self._model = model
        self._bodies = bodies
        self._pads = pads
        self._table = table
        self._mass = model.body_mass.copy()
        self._inertia = model.body_inertia.copy()
        self._friction = model.geom_friction.copy()
        self._is_nominal = True

    def draw(self, variation: Variation, rng: np.random.Generator) -> None:
        """Draw a mass and a friction for each prop, and a friction for the pads."""
        spread = np.log1p([variation.mass, variation.friction])
        num = len(self._bodies) + 1
        factors = np.exp(spread * rng.uniform(-1.0, 1.0, (num, 2)))
        self._apply(factors[:, 0], factors[:, 1])
        if variation.friction:
            self._leave_friction_to_props(factors[:-1, 1])
        self._is_nominal = False

    def restore(self) -> None:
        """Go back to what the model said."""
        if not self._is_nominal:
            ones = np.ones(len(self._bodies) + 1)
            self._apply(ones, ones)
            self._model.geom_friction[self._table] = self._friction[self._table]
            self._is_nominal = True

    def _apply(self, masses: Array, frictions: Array) -> None:
        model = self._model
        for body, mass, friction in zip(
            self._bodies, masses[:-1], frictions[:-1], strict=True
        ):
            model.body_mass[body] = self._mass[body] * mass
            model.body_inertia[body] = self._inertia[body] * mass
            geoms = np.flatnonzero(model.geom_bodyid == body)
            self._rub(geoms, friction)
        self._rub(self._pads, frictions[-1])
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def _leave_friction_to_props(self, factors: Array) -> None:
        """Take the table's friction away: of two, MuJoCo goes by the greater."""
        model, table = self._model, self._friction[self._table, _SLIDING]
        for body, factor in zip(self._bodies, factors, strict=True):
            geoms = np.flatnonzero(model.geom_bodyid == body)
            between = np.maximum(self._friction[geoms, _SLIDING], table)
            model.geom_friction[geoms, _SLIDING] = between * factor
        model.geom_friction[self._table, _SLIDING] = 0.0

    def _rub(self, geoms: Indices, factor: float) -> None:
        self._model.geom_friction[geoms, _SLIDING] = (
            self._friction[geoms, _SLIDING] * factor
        )
