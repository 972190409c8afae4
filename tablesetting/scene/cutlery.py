"""Fork, knife and spoon: forged flat, lying along y with the handle towards the robot.

The spoon's handle is arched like a real one: it stands clear of the table, so that the
pads of a gripper hold it by its full thickness.
"""

from typing import Final

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.scene.meshes import bar, smooth
from tablesetting.scene.prop_spec import Finish, Part, PropSpec
from tablesetting.scene.solids import Solid, box

_STEEL: Final = Finish((0.74, 0.76, 0.79, 1.0), specular=0.9, shininess=0.8)
_EBONY: Final = Finish((0.17, 0.13, 0.11, 1.0), specular=0.3, shininess=0.5)

_TINE_HALF_WIDTH: Final = 0.00155  # [m]


def _tine(x: float, tip: float) -> Part:
    """Return one tine of the fork, from the palm of the head to its tip, in [m]."""
    half_width = _TINE_HALF_WIDTH
    stations = [
        (0.048, x, half_width, 0.0032, 0.0010, 0.0),
        (0.064, x, half_width, 0.0028, 0.0010, 0.0),
        (0.078, x, half_width, 0.0056, 0.0008, 0.0),
        (tip, 0.98 * x, 0.0006, 0.0090, 0.0004, 0.0),
    ]
    return Part(bar(smooth(stations), num_points=12), _STEEL)


FORK: Final = PropSpec(
    name="fork",
    radius=0.012,
    half_length=0.078,
    height=0.010,
    mass=0.05,
    solids=(
        box(x=(-0.006, 0.006), y=(-0.088, 0.030), z=(0.0, 0.008)),
        box(x=(-0.0118, 0.0118), y=(0.030, 0.078), z=(0.0, 0.010)),
        box(x=(-0.006, 0.006), y=(0.078, 0.088), z=(0.0, 0.010)),
    ),
    parts=(
        Part(
            bar(
                smooth(
                    [
                        (-0.0885, 0.0, 0.0008, 0.0020, 0.0006, 0.0),
                        (-0.0880, 0.0, 0.0050, 0.0020, 0.0011, 0.0),
                        (-0.0700, 0.0, 0.0058, 0.0026, 0.0013, 0.0),
                        (-0.0200, 0.0, 0.0034, 0.0062, 0.0013, 0.0),
                        (0.0180, 0.0, 0.0026, 0.0068, 0.0014, 0.0),
                        (0.0300, 0.0, 0.0048, 0.0050, 0.0013, 0.0),
                        (0.0380, 0.0, 0.0108, 0.0036, 0.0010, 0.0006),
                        (0.0460, 0.0, 0.0114, 0.0031, 0.0010, 0.0006),
                        (0.0520, 0.0, 0.0114, 0.0030, 0.0010, 0.0004),
                    ]
                )
            ),
            _STEEL,
        ),
        _tine(-0.0098, tip=0.0835),
        _tine(-0.00327, tip=0.0885),
        _tine(0.00327, tip=0.0885),
        _tine(0.0098, tip=0.0835),
    ),
)

KNIFE: Final = PropSpec(
    name="knife",
    radius=0.010,
    half_length=0.090,
    height=0.010,
    mass=0.07,
    solids=(
        box(x=(-0.0075, 0.0075), y=(-0.097, -0.005), z=(0.0, 0.010)),
        box(x=(-0.0095, 0.0095), y=(-0.005, 0.090), z=(0.0, 0.006)),
        box(x=(-0.006, 0.006), y=(0.090, 0.098), z=(0.0, 0.006)),
    ),
    parts=(
        Part(
            bar(
                smooth(
                    [
                        (-0.0985, 0.0, 0.0020, 0.0050, 0.0018, 0.0),
                        (-0.0970, 0.0, 0.0070, 0.0050, 0.0046, 0.0),
                        (-0.0800, 0.0, 0.0078, 0.0050, 0.0050, 0.0),
                        (-0.0350, 0.0, 0.0062, 0.0050, 0.0044, 0.0),
                        (-0.0060, 0.0, 0.0070, 0.0050, 0.0042, 0.0),
                        (-0.0050, 0.0, 0.0040, 0.0050, 0.0030, 0.0),
                    ]
                )
            ),
            _EBONY,
        ),
        Part(
            bar(
                smooth(
                    [
                        (-0.0080, 0.0, 0.0040, 0.0044, 0.0018, 0.0),
                        (0.0040, 0.0, 0.0060, 0.0036, 0.0014, 0.0),
                        (0.0120, -0.0005, 0.0088, 0.0032, 0.0009, 0.0),
                        (0.0500, 0.0, 0.0090, 0.0032, 0.0008, 0.0),
                        (0.0800, 0.0, 0.0090, 0.0032, 0.0008, 0.0),
                        (0.0920, 0.0020, 0.0060, 0.0032, 0.0007, 0.0),
                        (0.0990, 0.0030, 0.0010, 0.0032, 0.0004, 0.0),
                    ]
                )
            ),
            _STEEL,
        ),
    ),
)


def _spoon_stations() -> Array:
    """Return the stations of the spoon: an arched handle, then an oval, dished head."""
    handle = smooth(
        [
            (-0.0745, 0.0, 0.0010, 0.0022, 0.0008, 0.0),
            (-0.0735, 0.0, 0.0048, 0.0022, 0.0014, 0.0),
            (-0.0600, 0.0, 0.0050, 0.0036, 0.0017, 0.0),
            (-0.0300, 0.0, 0.0040, 0.0058, 0.0019, 0.0),
            (0.0100, 0.0, 0.0030, 0.0062, 0.0020, 0.0),
            (0.0280, 0.0, 0.0032, 0.0056, 0.0018, 0.0),
        ]
    )
    angles = np.linspace(-1.25, 1.5, 16)
    oval, zero = np.cos(angles), np.zeros_like(angles)
    head = np.stack(
        [
            0.051 + 0.0238 * np.sin(angles),
            zero,
            0.0158 * oval,
            0.0070 - 0.0058 * oval,
            0.0010 + zero,
            0.0066 * oval,
        ],
        axis=1,
    )
    return np.concatenate([handle, head])


SPOON: Final = PropSpec(
    name="spoon",
    radius=0.016,
    half_length=0.059,
    height=0.011,
    mass=0.04,
    solids=(
        box(x=(-0.005, 0.005), y=(-0.0742, 0.035), z=(0.003, 0.008)),
        box(x=(-0.005, 0.005), y=(-0.0742, -0.066), z=(0.0, 0.003)),
        Solid("ellipsoid", (0.016, 0.024, 0.0055), (0.0, 0.051, 0.0055)),
    ),
    parts=(Part(bar(_spoon_stations()), _STEEL),),
    condim=4,
)
