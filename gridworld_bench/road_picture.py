"""A picture of the road, for eyes and for `rgb_array`."""

import numpy as np
import numpy.typing as npt

from gridworld_bench.highway import POSITIONS, Situation

Picture = npt.NDArray[np.uint8]

_CELL = 28  # Pixels on each side.
_GRASS, _ASPHALT, _LINE = (86, 140, 70), (58, 58, 62), (235, 235, 225)
_AGENT, _OTHER, _CRASHED = (222, 74, 62), (88, 142, 220), (255, 190, 40)
_GLASS = (25, 30, 40)
_DASHES = 3  # Cells from one dash to the next; the driver passes two cells at a step.


def draw_road(situation: Situation, length: int, num_steps: int = 0) -> Picture:
    """Draw a situation, seen from above: the driver, red, drives upwards.

    Args:
        situation: Where everyone is.
        length: How many steps ahead the road is seen.
        num_steps: Steps since the start, by which the lines between the lanes move.

    Returns:
        An image, shape (H, W, 3); a driver who collides is yellow.
    """
    height, width = length * _CELL, len(POSITIONS) * _CELL
    image = np.empty((height, width, 3), dtype=np.uint8)
    image[:] = _GRASS
    image[:, _CELL : 4 * _CELL] = _ASPHALT
    for lane in (1, 4):
        image[:, lane * _CELL - 1 : lane * _CELL + 1] = _LINE
    rows = np.arange(height) - 2 * num_steps * _CELL
    is_dashed = rows % (_DASHES * _CELL) < _CELL
    for lane in (2, 3):
        image[is_dashed, lane * _CELL - 1 : lane * _CELL + 1] = _LINE
    for lane, distance in situation.cars:
        _draw_car(image, lane, length - 1 - distance, _OTHER)
    color = _CRASHED if situation.is_collision else _AGENT
    _draw_car(image, situation.agent, length - 1, color)
    return image


def _draw_car(
    image: Picture, column: int, row: int, color: tuple[int, int, int]
) -> None:
    """Fill a cell with a car: a body, and a windscreen in front."""
    top, left = row * _CELL, column * _CELL
    image[top + 2 : top + _CELL - 2, left + 7 : left + _CELL - 7] = color
    image[top + 7 : top + 12, left + 9 : left + _CELL - 9] = _GLASS
