"""What the robot believes of where things are."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tablesetting.irl.arrays import Array
from tablesetting.scene.scene import Scene


@dataclass(frozen=True)
class SensorNoise:
    """How wrong a look may be: independent Gaussian errors, anew in every look."""

    item_std: float = 0.0
    """Of the item's position, along x and y each, in [m]."""
    item_yaw_std: float = 0.0
    """Of the item's heading, in [rad]."""
    layout_std: float = 0.0
    """Of the position of every other object, along x and y each, in [m]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 <= value < np.inf:
                raise ValueError(f"`{name}` must be 0 or more; got {value}")


@dataclass(frozen=True)
class Percept:
    """Poses of the props as seen in one look.

    Attributes:
        poses: Position in [m] and quaternion (wxyz) of every prop, shape (7,), by name.
    """

    poses: Mapping[str, Array]

    def position(self, name: str) -> Array:
        """Centre of a prop's footprint in the world, shape (3,), in [m]."""
        return self.poses[name][:3]

    def yaw(self, name: str) -> float:
        """Heading of a prop about the vertical in (-pi, pi], 0 as laid, in [rad]."""
        w, x, y, z = self.poses[name][3:]
        return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    def tilt(self, name: str) -> float:
        """Angle between a prop's axis and the vertical, in [rad]."""
        _, x, y, _ = self.poses[name][3:]
        return float(2.0 * np.arcsin(min(1.0, np.hypot(x, y))))


class Camera:
    """Looks at a scene, with errors."""

    def __init__(
        self,
        scene: Scene,
        noise: SensorNoise | None = None,
        *,
        rng: np.random.Generator | None = None,
    ) -> None:
        """Aim the camera.

        Args:
            scene: What it looks at.
            noise: How wrong it is; None if not at all.
            rng: Source of the errors; may be None without noise.

        Raises:
            ValueError: If there is noise but no source of it.
        """
        if noise is not None and rng is None:
            raise ValueError("`rng` must be given with `noise`; got None")
        self._scene = scene
        self._noise = noise
        self._rng = rng

    def look(self) -> Percept:
        """See all props where they are now."""
        poses = {
            name: self._scene.data.qpos[self._scene.pose_slice(name)].copy()
            for name in self._scene.body_ids
        }
        if self._noise is not None and self._rng is not None:
            for name, pose in poses.items():
                self._blur(name, pose, self._noise, self._rng)
        return Percept(poses)

    def _blur(
        self, name: str, pose: Array, noise: SensorNoise, rng: np.random.Generator
    ) -> None:
        is_item = name == self._scene.item
        errors = rng.normal(size=3)
        pose[:2] += errors[:2] * (noise.item_std if is_item else noise.layout_std)
        if is_item:
            pose[3:] = _turned(pose[3:], noise.item_yaw_std * float(errors[2]))


def _turned(quaternion: Array, yaw: float) -> Array:
    """Turn an orientation (wxyz) further about the vertical, in [rad]."""
    c, s = np.cos(yaw / 2.0), np.sin(yaw / 2.0)
    w, x, y, z = quaternion
    return np.array([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])
