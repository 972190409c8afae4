"""What a prop is: its footprint, its mass, its collision shapes and its looks."""

from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.scene.meshes import Mesh
from tablesetting.scene.solids import Solid


@dataclass(frozen=True)
class Finish:
    """Colour and gloss of a surface."""

    rgba: tuple[float, float, float, float]
    """Red, green, blue and opacity, each in [0, 1]."""
    specular: float = 0.4
    """Strength of the highlights, in [0, 1]."""
    shininess: float = 0.6
    """Sharpness of the highlights, in [0, 1]."""


@dataclass(frozen=True)
class Part:
    """A visible part of a prop, which takes no part in the physics."""

    mesh: Mesh
    finish: Finish


@dataclass(frozen=True)
class PropSpec:
    """A rigid thing that stands or lies on the table.

    Its frame is at the centre of its footprint and z = 0 is its underside. The footprint
    is a stadium: a segment along y, widened by a radius.
    """

    name: str
    """Name in the scene, in layouts and in files."""
    radius: float
    """Radius of the footprint, in [m]."""
    height: float
    """Height above the table, in [m]."""
    mass: float
    """Mass, in [kg], spread evenly over the solids."""
    solids: tuple[Solid, ...]
    """What collides."""
    parts: tuple[Part, ...]
    """What is seen."""
    half_length: float = 0.0
    """Half length of the footprint's segment, in [m]; 0 for a round footprint."""
    condim: int = 3
    """Contact dimension; 4 adds friction against spinning on a small patch."""

    @property
    def center_of_mass(self) -> Array:
        """Centre of mass in the frame of the prop, shape (3,), in [m]."""
        volumes = np.array([solid.volume for solid in self.solids])
        positions = np.array([solid.position for solid in self.solids])
        return volumes @ positions / volumes.sum()
