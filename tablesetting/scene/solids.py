"""Collision shapes of the props: a few primitives, and rings of boxes for hollows."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from tablesetting.irl.arrays import Array

Shape = Literal["box", "cylinder", "ellipsoid"]


@dataclass(frozen=True)
class Solid:
    """One primitive, with MuJoCo's meaning of `size`.

    Attributes:
        shape: Name of a MuJoCo geom type.
        size: Half extents, or (radius, half height) of a cylinder, in [m].
        position: Centre in the frame of the prop, in [m].
        quaternion: Orientation (w, x, y, z) in the frame of the prop.
    """

    shape: Shape
    size: tuple[float, ...]
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    @property
    def volume(self) -> float:
        """Volume of the primitive, in [m^3]."""
        if self.shape == "cylinder":
            radius, half_height = self.size
            return 2.0 * math.pi * radius**2 * half_height
        return {"box": 8.0, "ellipsoid": 4.0 * math.pi / 3.0}[self.shape] * math.prod(
            self.size
        )


def box(
    x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]
) -> Solid:
    """Return the box between two bounds on each axis, in [m]."""
    bounds = np.array([x, y, z])
    half_extents, center = np.ptp(bounds, axis=1) / 2, bounds.mean(axis=1)
    return Solid("box", tuple(half_extents.tolist()), tuple(center.tolist()))


def disc(
    radius: float, bottom: float, top: float, center: tuple[float, float] = (0.0, 0.0)
) -> Solid:
    """Return the upright cylinder between two heights, in [m]."""
    size = (radius, (top - bottom) / 2)
    return Solid("cylinder", size, (*center, (top + bottom) / 2))


def shell(
    profile: Sequence[tuple[float, float]],
    thickness: float,
    num_sides: int,
    center: tuple[float, float] = (0.0, 0.0),
) -> tuple[Solid, ...]:
    """Approximate a turned wall by rings of boxes, so that the hollow stays open.

    The outer corners of the polygon lie on the wall, its outer faces just inside.

    Args:
        profile: Outer line of the wall, (radius, height) from the bottom up, in [m].
        thickness: Thickness of the wall, inwards, in [m].
        num_sides: Boxes in each ring; one ring per segment of the profile.
        center: Where the axis stands in the frame of the prop, in [m].

    Returns:
        The boxes, ring by ring.
    """
    return tuple(
        _wall_box(np.array(low), np.array(high), thickness, num_sides, k, center)
        for low, high in pairwise(profile)
        for k in range(num_sides)
    )


def _wall_box(
    low: Array,
    high: Array,
    thickness: float,
    num_sides: int,
    index: int,
    center: tuple[float, float],
) -> Solid:
    """Return one stave of a ring, leaning along the segment from `low` to `high`."""
    half_angle = math.pi / num_sides
    flat = np.array([math.cos(half_angle), 1.0])  # From the corners to the face.
    along = (high - low) * flat
    length = math.hypot(*along)
    inwards = np.array([-along[1], along[0]]) / length
    radius, height = (low + high) / 2 * flat + inwards * thickness / 2
    half_width = max(low[0], high[0]) * math.sin(half_angle)
    yaw, lean = 2.0 * half_angle * index, math.atan2(along[0], along[1])
    x, y = center[0] + radius * math.cos(yaw), center[1] + radius * math.sin(yaw)
    return Solid(
        shape="box",
        size=(thickness / 2, float(half_width), length / 2),
        position=(float(x), float(y), float(height)),
        quaternion=_yaw_then_lean(yaw, lean),
    )


def _yaw_then_lean(yaw: float, lean: float) -> tuple[float, float, float, float]:
    """Return the quaternion of a turn about z, then about the turned y axis."""
    cos_yaw, sin_yaw = math.cos(yaw / 2), math.sin(yaw / 2)
    cos_lean, sin_lean = math.cos(lean / 2), math.sin(lean / 2)
    return (
        cos_yaw * cos_lean,
        -sin_yaw * sin_lean,
        cos_yaw * sin_lean,
        sin_yaw * cos_lean,
    )
