"""Pictures of a simulation, for `render`."""

import os
from typing import Any, Final

import mujoco
import numpy as np
import numpy.typing as npt

from tablesetting.errors import TableSettingError

RENDER_MODE: Final = "rgb_array"
"""The one render mode."""

Pixels = npt.NDArray[np.uint8]
"""A picture, shape (height, width, 3)."""

_SIZE: Final = (480, 640)  # Height and width, in pixels.
_LOOKAT: Final = (0.05, -0.20, 0.20)  # [m]
_DISTANCE: Final = 1.5  # [m]
_AZIMUTH, _ELEVATION = 225.0, -28.0  # [deg]; from the far right, opposite the arm.


class Painter:
    """Draws one model from a fixed point of view."""

    def __init__(self, model: mujoco.MjModel, render_mode: str | None) -> None:
        """Get ready to draw, if asked to.

        Args:
            model: What is drawn.
            render_mode: `RENDER_MODE`, or None not to draw.

        Raises:
            ValueError: If the mode is another.
            TableSettingError: If MuJoCo cannot draw here.
        """
        if render_mode not in (None, RENDER_MODE):
            raise ValueError(
                f"`render_mode` must be {RENDER_MODE!r} or None; got {render_mode!r}"
            )
        self._renderer = None if render_mode is None else _renderer(model)

    def draw(self, data: mujoco.MjData) -> Pixels | None:
        """Draw a state; None if not asked to draw."""
        if self._renderer is None:
            return None
        self._renderer.update_scene(data, _camera())
        return self._renderer.render()

    def close(self) -> None:
        """Free the graphics card; nothing more can be drawn."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _renderer(model: mujoco.MjModel) -> Any:
    try:
        return mujoco.Renderer(model, *_SIZE)
    except Exception as error:  # Every backend fails in its own way.
        backend = os.environ.get("MUJOCO_GL", "unset")
        raise TableSettingError(
            f"MuJoCo cannot draw here, with MUJOCO_GL {backend}; set MUJOCO_GL=egl "
            "before Python starts (`tablesetting doctor` tells what works), or leave "
            "`render_mode` out"
        ) from error


def _camera() -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.lookat[:] = _LOOKAT
    camera.distance = _DISTANCE
    camera.azimuth, camera.elevation = _AZIMUTH, _ELEVATION
    return camera
