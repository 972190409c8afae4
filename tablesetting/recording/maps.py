"""The rewards of guess and rival as pictures, side by side on one scale of colours."""

import numpy as np
import rerun as rr
from matplotlib import colormaps

from tablesetting.irl.arrays import Array
from tablesetting.recording import entities, markers
from tablesetting.recording.views import RoundView

_WHITE = (255, 255, 255)


def log_maps(
    stream: rr.RecordingStream, view: RoundView, objects: tuple[str, ...]
) -> None:
    """Log both maps, each with the objects, the best placement of its reward, and the wish.

    The first row of a picture is y = 1: it lies as the person sees the table.
    """
    for path, reward_map, marker, place in (
        (entities.GUESS_MAP, view.reward_map, markers.GUESS, view.robot_placement),
        (entities.RIVAL_MAP, view.rival_map, markers.RIVAL, view.rival_placement),
    ):
        stream.log(f"{path}/reward", rr.Image(_colored(reward_map)))
        marked = [
            (name, center, _WHITE)
            for name, center in zip(objects, view.centers, strict=True)
        ]
        marked.append((marker.label, place, marker.color))
        if view.wish is not None:
            marked.append((markers.WISH.label, view.wish, markers.WISH.color))
        names, places, colors = zip(*marked, strict=True)
        points = rr.Points2D(
            _to_pixels(np.array(places), len(reward_map)),
            labels=names,
            colors=colors,
            radii=rr.Radius.ui_points(3.0),
        )
        stream.log(f"{path}/places", points)


def _colored(reward_map: Array) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint8]]":
    low, high = reward_map.min(), reward_map.max()
    shades = (reward_map[::-1] - low) / max(high - low, np.finfo(float).tiny)
    colored: np.ndarray[tuple[int, ...], np.dtype[np.uint8]] = colormaps["viridis"](
        shades, bytes=True
    )[..., :3]
    return colored


def _to_pixels(places: Array, size: int) -> Array:
    """Map places on the unit square, shape (S, 2), to a picture that spans it."""
    pixels = places * [1.0, -1.0] + [0.0, 1.0]
    return 0.5 + pixels * (size - 1)
