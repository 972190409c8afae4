"""Plate, bowl, cup, glass and vase: turned things.

Every wall is given once as a solid, for contacts, and once as a finer profile, for the
eye, that stays inside the solid's outline.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from tablesetting.scene.meshes import lathe, smooth, strap
from tablesetting.scene.prop_spec import Finish, Part, PropSpec
from tablesetting.scene.solids import box, disc, shell

_PORCELAIN: Final = Finish((0.94, 0.93, 0.90, 1.0), specular=0.3, shininess=0.8)
_CELADON: Final = Finish((0.47, 0.66, 0.60, 1.0), specular=0.5, shininess=0.7)
_TERRACOTTA: Final = Finish((0.80, 0.42, 0.28, 1.0), specular=0.3, shininess=0.5)
_GLASS: Final = Finish((0.70, 0.86, 0.95, 0.40), specular=0.9, shininess=0.9)
_COBALT: Final = Finish((0.16, 0.27, 0.55, 1.0), specular=0.7, shininess=0.8)

# The rings of boxes start a little above the table, so that only the foot touches it.
_LIFT: Final = 0.002  # [m]
_CUP_AXIS: Final = (-0.012, 0.0)  # [m]; the circle around body and handle is centred.


def _turned(profile: npt.ArrayLike, finish: Finish) -> Part:
    """Return the part turned from a coarse profile, (radius, height) in [m]."""
    return Part(lathe(smooth(profile)), finish)


PLATE: Final = PropSpec(
    name="plate",
    radius=0.090,
    height=0.020,
    mass=0.35,
    solids=(
        disc(0.058, 0.0, 0.008),
        *shell([(0.058, _LIFT), (0.090, 0.0163)], thickness=0.004, num_sides=16),
    ),
    parts=(
        _turned(
            [
                (0.001, 0.002), (0.050, 0.002), (0.050, 0.002), (0.052, 0.000),
                (0.057, 0.000), (0.058, 0.003), (0.066, 0.007), (0.087, 0.017),
                (0.0895, 0.0185), (0.0890, 0.0198), (0.086, 0.0195), (0.066, 0.0115),
                (0.060, 0.0085), (0.055, 0.0075), (0.001, 0.0075),
            ],
            _PORCELAIN,
        ),
    ),
)  # fmt: skip

BOWL: Final = PropSpec(
    name="bowl",
    radius=0.070,
    height=0.055,
    mass=0.30,
    solids=(
        disc(0.042, 0.0, 0.007),
        *shell(
            [(0.042, _LIFT), (0.062, 0.025), (0.070, 0.0537)],
            thickness=0.005,
            num_sides=16,
        ),
    ),
    parts=(
        _turned(
            [
                (0.001, 0.003), (0.030, 0.003), (0.030, 0.003), (0.031, 0.000),
                (0.038, 0.000), (0.040, 0.003), (0.052, 0.012), (0.061, 0.025),
                (0.067, 0.042), (0.0690, 0.0535), (0.0690, 0.0553), (0.0665, 0.0552),
                (0.065, 0.050), (0.060, 0.034), (0.052, 0.019), (0.036, 0.008),
                (0.001, 0.007),
            ],
            _CELADON,
        ),
    ),
)  # fmt: skip

CUP: Final = PropSpec(
    name="cup",
    radius=0.047,
    height=0.085,
    mass=0.25,
    solids=(
        disc(0.033, 0.0, 0.006, center=_CUP_AXIS),
        *shell(
            [(0.035, _LIFT), (0.035, 0.085)],
            thickness=0.004,
            num_sides=12,
            center=_CUP_AXIS,
        ),
        box(x=(0.021, 0.0465), y=(-0.005, 0.005), z=(0.018, 0.070)),
    ),
    parts=(
        Part(
            lathe(
                smooth(
                    [
                        (0.001, 0.002), (0.026, 0.002), (0.027, 0.000), (0.030, 0.000),
                        (0.033, 0.004), (0.0335, 0.010), (0.0335, 0.078),
                        (0.0338, 0.0852), (0.0320, 0.0855), (0.0308, 0.080),
                        (0.0305, 0.012), (0.028, 0.006), (0.001, 0.005),
                    ]
                ),
                center=_CUP_AXIS,
            ),
            _TERRACOTTA,
        ),
        Part(
            strap(
                smooth(
                    [
                        (0.018, 0.064), (0.034, 0.068), (0.044, 0.064), (0.044, 0.044),
                        (0.041, 0.028), (0.030, 0.021), (0.018, 0.024),
                    ],
                    rounds=3,
                ),
                half_width=0.0045,
                half_thickness=0.0024,
            ),
            _TERRACOTTA,
        ),
    ),
)  # fmt: skip

GLASS: Final = PropSpec(
    name="glass",
    radius=0.034,
    height=0.110,
    mass=0.20,
    solids=(
        disc(0.031, 0.0, 0.010),
        *shell([(0.032, _LIFT), (0.034, 0.110)], thickness=0.003, num_sides=12),
    ),
    parts=(
        _turned(
            [
                (0.001, 0.001), (0.024, 0.001), (0.026, 0.000), (0.0285, 0.001),
                (0.0295, 0.006), (0.0300, 0.020), (0.0325, 0.107), (0.0327, 0.1105),
                (0.0310, 0.1105), (0.0303, 0.106), (0.0280, 0.020), (0.0265, 0.012),
                (0.001, 0.011),
            ],
            _GLASS,
        ),
    ),
)  # fmt: skip

_VASE_PROFILE: Final = np.array(
    [
        (0.001, 0.001), (0.021, 0.001), (0.022, 0.000), (0.0245, 0.000),
        (0.026, 0.004), (0.030, 0.022), (0.0332, 0.050), (0.0320, 0.078),
        (0.0230, 0.100), (0.0178, 0.114), (0.0175, 0.124), (0.0175, 0.158),
        (0.0185, 0.170), (0.0203, 0.1785), (0.0198, 0.1802), (0.0180, 0.1795),
        (0.0160, 0.170), (0.0155, 0.155), (0.0155, 0.125), (0.001, 0.118),
    ]
)  # fmt: skip

VASE: Final = PropSpec(
    name="vase",
    radius=0.033,
    height=0.180,
    mass=0.30,
    solids=(
        disc(0.026, 0.0, 0.012),
        disc(0.033, 0.012, 0.088),
        disc(0.028, 0.088, 0.104),
        disc(0.018, 0.104, 0.172),  # The straight neck, where a jaw holds it.
        disc(0.0205, 0.172, 0.180),
    ),
    parts=(_turned(_VASE_PROFILE, _COBALT),),
)
