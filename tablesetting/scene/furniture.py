"""The looks of the arena: planks, legs, mat, floor and light. Nothing here collides."""

from typing import Any, Final

import numpy as np
from dm_control import mjcf

Rgba = tuple[float, float, float, float]

TABLE_CENTER: Final = (0.0, -0.07)
"""Centre of the table top, in [m]; there is room for the robot in front."""
TABLE_HALF_SIZE: Final = (0.65, 0.46)
"""Half extents of the table top, in [m]."""

_THICKNESS: Final = 0.03  # [m]
_HEIGHT: Final = 0.74  # Of the top above the floor, in [m].
_LEG_HALF_WIDTH: Final = 0.03  # [m]
_NUM_PLANKS: Final = 8
_PLANK_GAP: Final = 0.0008  # [m]
_MAT_THICKNESS: Final = 0.001  # [m]
_FLOOR_HALF_SIZE: Final = 6.0  # [m]

_OAK: Final[tuple[Rgba, ...]] = (
    (0.72, 0.54, 0.36, 1.0),
    (0.68, 0.50, 0.33, 1.0),
    (0.75, 0.57, 0.39, 1.0),
)
_DARK_OAK: Final[Rgba] = (0.50, 0.36, 0.24, 1.0)
_LINEN: Final[Rgba] = (0.62, 0.66, 0.66, 1.0)
_STONE: Final[Rgba] = (0.82, 0.80, 0.77, 1.0)


def furnish(root: mjcf.RootElement, mat_size: tuple[float, float]) -> None:
    """Add everything that is only there to be seen.

    Args:
        root: Model of the arena; the table top is its plane z = 0.
        mat_size: Extent of the mat around the origin, in [m].
    """
    _add_planks(root)
    _add_mat(root, mat_size)
    _add_legs(root)
    _add_floor(root)
    _add_light(root)


def _add_visual(root: mjcf.RootElement, name: str, **attributes: Any) -> None:
    root.worldbody.add(
        "geom", name=name, group=2, contype=0, conaffinity=0, **attributes
    )


def _add_planks(root: mjcf.RootElement) -> None:
    pitch = 2 * TABLE_HALF_SIZE[1] / _NUM_PLANKS
    half_height = (_THICKNESS - _MAT_THICKNESS) / 2
    for index in range(_NUM_PLANKS):
        y = TABLE_CENTER[1] - TABLE_HALF_SIZE[1] + pitch * (index + 0.5)
        _add_visual(
            root,
            f"plank_{index}",
            type="box",
            pos=(TABLE_CENTER[0], y, -_MAT_THICKNESS - half_height),
            size=(TABLE_HALF_SIZE[0], (pitch - _PLANK_GAP) / 2, half_height),
            rgba=_OAK[index % len(_OAK)],
        )


def _add_mat(root: mjcf.RootElement, size: tuple[float, float]) -> None:
    # Its upper side is the table top, which the planks stay below.
    _add_visual(
        root,
        "mat",
        type="box",
        pos=(0.0, 0.0, -_MAT_THICKNESS / 2),
        size=(size[0] / 2, size[1] / 2, _MAT_THICKNESS / 2),
        rgba=_LINEN,
    )


def _add_legs(root: mjcf.RootElement) -> None:
    half_height = (_HEIGHT - _THICKNESS) / 2
    inset = np.array(TABLE_HALF_SIZE) - 2 * _LEG_HALF_WIDTH
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    for index, corner in enumerate(corners):
        _add_visual(
            root,
            f"leg_{index}",
            type="box",
            pos=(*(TABLE_CENTER + inset * corner), -_THICKNESS - half_height),
            size=(_LEG_HALF_WIDTH, _LEG_HALF_WIDTH, half_height),
            rgba=_DARK_OAK,
        )


def _add_floor(root: mjcf.RootElement) -> None:
    _add_visual(
        root,
        "floor",
        type="plane",
        pos=(0.0, 0.0, -_HEIGHT),
        size=(_FLOOR_HALF_SIZE, _FLOOR_HALF_SIZE, 0.1),
        rgba=_STONE,
    )
    root.asset.add(
        "texture",
        name="sky",
        type="skybox",
        builtin="gradient",
        rgb1=(0.93, 0.95, 0.97),
        rgb2=(0.70, 0.74, 0.78),
        width=64,
        height=64,
    )


def _add_light(root: mjcf.RootElement) -> None:
    # The shadow map spans `extent`; the floor alone would stretch it to a blur.
    root.statistic.set_attributes(center=(0.0, 0.0, 0.0), extent=2.0)
    root.visual.quality.shadowsize = 4096
    root.visual.headlight.set_attributes(
        ambient=(0.35, 0.35, 0.35), diffuse=(0.2, 0.2, 0.2), specular=(0, 0, 0)
    )
    root.worldbody.add(
        "light",
        name="lamp",
        pos=(-0.5, -0.4, 2.0),
        dir=(0.5, 0.4, -2.0),
        directional=True,
        diffuse=(0.52, 0.50, 0.47),
        specular=(0.3, 0.3, 0.3),
        castshadow=True,
    )
