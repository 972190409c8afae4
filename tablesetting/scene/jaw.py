"""A parallel jaw: two fingers that slide, and hold by friction alone."""

from typing import Any, Final

from dm_control import composer, mjcf

MAX_OPENING: Final = 0.05
"""Largest travel of each finger from the closed jaw, in [m]."""
TIP_REACH: Final = 0.016
"""How far the finger tips reach beyond the tool centre point, in [m]."""

WRIST_OFFSET: Final = 0.05
"""Tool centre point ahead of the wrist's axis, along the tool's x, in [m].

Turned outwards it adds to the reach of the arm, turned inwards it takes from it; so the
whole square is within reach, which it is not for a jaw under the wrist.
"""
PALM_HEIGHT: Final = 0.084
"""Underside of the palm above the tool centre point, in [m]."""
PALM_HALF_WIDTH: Final = 0.030
"""Half the width of the palm along the tool's y, in [m]."""
FINGER_DEPTH: Final = 0.0145
"""From the inner face of a pad to the back of its finger, in [m]."""
FINGER_HALF_WIDTH: Final = 0.011
"""Half the width of finger and pad along the tool's x, in [m]."""

_FINGER_LENGTH: Final = 0.10  # [m]
_FINGER_HALF_SIZE: Final = (0.009, 0.005, _FINGER_LENGTH / 2)  # [m]
_PALM_HALF_SIZE: Final = (0.020, PALM_HALF_WIDTH, 0.028)  # [m]
_BRACKET_HALF_SIZE: Final = (WRIST_OFFSET / 2 + 0.020, 0.024, 0.008)  # [m]
_PAD_HALF_SIZE: Final = (FINGER_HALF_WIDTH, 0.004, TIP_REACH)  # [m]
_PAD_PROUD: Final = 0.0045  # How far a pad stands out from its finger, in [m].
_GRIP_FORCE: Final = 40.0  # [N]


class ParallelJaw(composer.Entity):
    """Two coupled sliding fingers with friction pads.

    The origin is the mounting flange; z points out of the hand, the fingers move
    along y, and a bracket carries them ahead along x.
    """

    def _build(self, name: str = "jaw", timestep: float = 0.002) -> None:
        self._root = mjcf.RootElement(model=name)
        # While the arm moves, what it holds slips at a rate that this time constant
        # sets; twice the time step is the stiffest that MuJoCo allows.
        self._pad_solref = (2.0 * timestep, 1)
        self._add_bracket()
        palm = self._root.worldbody.add("body", name="palm", pos=(WRIST_OFFSET, 0, 0))
        palm.add(
            "geom",
            name="palm",
            type="box",
            size=_PALM_HALF_SIZE,
            pos=(0, 0, _PALM_HALF_SIZE[2]),
            mass=0.2,
            rgba=(0.25, 0.25, 0.27, 1),
        )
        tip = 2 * _PALM_HALF_SIZE[2] + _FINGER_LENGTH
        palm.add("site", name="tcp", pos=(0, 0, tip - TIP_REACH))
        fingers = [
            self._add_finger(palm, "left", 1),
            self._add_finger(palm, "right", -1),
        ]
        self._root.contact.add("exclude", body1=fingers[0], body2=fingers[1])
        self._couple()

    @property
    def mjcf_model(self) -> Any:
        """The root element of the jaw's own model."""
        return self._root

    def _add_bracket(self) -> None:
        # In a body of its own, which gravity compensation can be said for.
        bracket = self._root.worldbody.add("body", name="bracket")
        bracket.add(
            "geom",
            name="bracket",
            type="box",
            size=_BRACKET_HALF_SIZE,
            pos=(WRIST_OFFSET / 2, 0, 0.004 + _BRACKET_HALF_SIZE[2]),
            mass=0.05,
            rgba=(0.25, 0.25, 0.27, 1),
        )

    def _add_finger(self, palm: Any, name: str, side: int) -> Any:
        """Add the finger that opens towards `side` (+1 or -1) of the y axis."""
        finger = palm.add("body", name=name, pos=(0, 0, 2 * _PALM_HALF_SIZE[2]))
        finger.add(
            "joint",
            name=name,
            type="slide",
            axis=(0, side, 0),
            limited=True,
            range=(0, MAX_OPENING),
            armature=0.05,
            damping=2,
        )
        self._add_finger_geoms(finger, name, side)
        return finger

    def _add_finger_geoms(self, finger: Any, name: str, side: int) -> None:
        finger.add(
            "geom",
            name=f"{name}_finger",
            type="box",
            size=_FINGER_HALF_SIZE,
            pos=(0, side * (_PAD_PROUD + _FINGER_HALF_SIZE[1]), _FINGER_HALF_SIZE[2]),
            mass=0.04,
            rgba=(0.55, 0.55, 0.58, 1),
        )
        finger.add(
            "geom",
            name=f"{name}_pad",
            type="box",
            size=_PAD_HALF_SIZE,
            pos=(0, side * _PAD_HALF_SIZE[1], _FINGER_LENGTH - TIP_REACH),
            mass=0.01,
            friction=(1.5, 0.05, 0.0005),
            condim=4,
            priority=1,
            solref=self._pad_solref,
            rgba=(0.15, 0.15, 0.15, 1),
        )

    def _couple(self) -> None:
        """Drive both fingers by one actuator, as a gear between them would."""
        self._root.equality.add(
            "joint",
            joint1="left",
            joint2="right",
            solref=self._pad_solref,
            solimp=(0.95, 0.99, 0.001, 0.5, 2),
        )
        tendon = self._root.tendon.add("fixed", name="opening")
        for joint in ("left", "right"):
            tendon.add("joint", joint=joint, coef=0.5)
        self._root.actuator.add(
            "general",
            name="opening",
            tendon=tendon,
            ctrllimited=True,
            ctrlrange=(0, MAX_OPENING),
            forcelimited=True,
            forcerange=(-_GRIP_FORCE, _GRIP_FORCE),
            gainprm=[6000.0],
            biastype="affine",
            biasprm=[0.0, -6000.0, -60.0],
        )
