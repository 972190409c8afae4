"""Executed episodes on the disk, exact enough to be repeated bit for bit."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tablesetting.errors import InvalidFile
from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution
from tablesetting.planner.goal import Refusal
from tablesetting.results import RunFolder, read_arrays
from tablesetting.scene.scene import Scene, Snapshot

FOLDER = "episodes"
FRAME_RATE = 30.0
"""Snapshots per second of simulated time."""

_Watched = Generator[Snapshot, None, Execution | Refusal]


@dataclass(frozen=True)
class Episode:
    """One placement, as T snapshots.

    Attributes:
        layout: Object centers, shape (K, 2), in table units.
        commanded: Where the item was to be put, shape (2,), in table units.
        times: Simulated time, shape (T,), in [s].
        qpos: Positions of all joints of the model, shape (T, nq).
        ctrl: What the servos were told, shape (T, nu).
        phases: What the arm was doing, shape (T,).
    """

    layout: Array
    commanded: Array
    times: Array
    qpos: Array
    ctrl: Array
    phases: npt.NDArray[Any]

    @classmethod
    def of_snapshots(
        cls, layout: Array, commanded: Array, snapshots: Sequence[Snapshot]
    ) -> "Episode":
        """Gather the snapshots of an episode, at least one."""
        return cls(
            layout=np.asarray(layout),
            commanded=np.asarray(commanded),
            times=np.array([each.time for each in snapshots]),
            qpos=np.stack([each.qpos for each in snapshots]),
            ctrl=np.stack([each.ctrl for each in snapshots]),
            phases=np.array([each.phase for each in snapshots]),
        )

    def save(self, folder: RunFolder, num_demos: int) -> None:
        """Write the episode into a run folder."""
        arrays = {each.name: getattr(self, each.name) for each in fields(self)}
        folder.write(
            f"{FOLDER}/{_name(num_demos)}",
            lambda path: np.savez_compressed(path, **arrays),
        )

    def check_scene(self, scene: Scene) -> None:
        """Refuse an episode that is of another model.

        Raises:
            InvalidFile: If it has other joints or servos.
        """
        found = (self.qpos.shape[1], self.ctrl.shape[1])
        expected = (scene.model.nq, scene.model.nu)
        if found != expected:
            raise InvalidFile(
                "the episode has {} joint positions and {} servos, the scene {} and "
                "{}; do the run again".format(*found, *expected)
            )


def keep(
    watch: Callable[[_Watched], _Watched], kept: list[Snapshot]
) -> Callable[[_Watched], _Watched]:
    """Keep the snapshots that a watcher passes through."""

    def watch_and_keep(snapshots: _Watched) -> _Watched:
        def passing() -> _Watched:
            while True:
                try:
                    snapshot = next(snapshots)
                except StopIteration as stop:
                    outcome: Execution | Refusal = stop.value
                    return outcome
                kept.append(snapshot)
                yield snapshot

        return watch(passing())

    return watch_and_keep


def list_episodes(run: Path) -> list[int]:
    """List the numbers of demonstrations after which there is an episode.

    Raises:
        InvalidFile: If there is none.
    """
    found = [
        int(path.stem.removeprefix("episode_"))
        for path in sorted((run / FOLDER).glob("episode_*.npz"))
        if path.stem.removeprefix("episode_").isdecimal()
    ]
    if not found:
        raise InvalidFile(
            f"'{run}' holds no episodes; name the folder of a run in which the arm acted"
        )
    return sorted(found)


def read_episode(run: Path, num_demos: int) -> Episode:
    """Read an episode of a run.

    Raises:
        InvalidFile: If there is none, or it is damaged.
    """
    known = list_episodes(run)
    if num_demos not in known:
        raise InvalidFile(
            f"'{run}' has no episode after {num_demos} demonstrations; it has those "
            f"after {', '.join(map(str, known))}"
        )
    path = run / FOLDER / _name(num_demos)
    arrays = read_arrays(path)
    try:
        episode = Episode(**{each.name: arrays[each.name] for each in fields(Episode)})
        _check(episode)
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise InvalidFile(
            f"'{path}' is no episode, or a damaged one ({error}); do the run again"
        ) from error
    return episode


def _check(episode: Episode) -> None:
    num = len(episode.times)
    shapes = {
        "layout": (len(episode.layout), 2),
        "commanded": (2,),
        "times": (num,),
        "qpos": (num, episode.qpos.shape[1]),
        "ctrl": (num, episode.ctrl.shape[1]),
        "phases": (num,),
    }
    for name, shape in shapes.items():
        array = getattr(episode, name)
        if array.shape != shape or num == 0:
            raise ValueError(f"`{name}` has the shape {array.shape}")
        if name != "phases" and not np.isfinite(array).all():
            raise ValueError(f"`{name}` holds what is not finite")


def _name(num_demos: int) -> str:
    return f"episode_{num_demos:02d}.npz"
