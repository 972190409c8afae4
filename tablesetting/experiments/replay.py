"""Repeat an executed episode of a run, and see whether it is the same."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tablesetting.errors import InvalidFile, InvalidLayout
from tablesetting.experiments.arm import Arm
from tablesetting.experiments.config import RunConfig
from tablesetting.experiments.episodes import (
    Episode,
    keep,
    list_episodes,
    read_episode,
)
from tablesetting.experiments.setup import arm_rng
from tablesetting.options import from_options
from tablesetting.results import CONFIG, CONFIG_FORMAT, package_versions, read_json
from tablesetting.reward.tasks import TASKS
from tablesetting.scene.scene import Snapshot

_COMPARED = ("times", "qpos", "ctrl", "phases")


@dataclass(frozen=True)
class Replay:
    """How an episode went when it was repeated.

    Attributes:
        num_demos: After how many demonstrations it was.
        original: As the run has it.
        repeated: As it went now; None if nothing moved.
        versions: Versions then and now of each package that is another one by now.
    """

    num_demos: int
    original: Episode
    repeated: Episode | None
    versions: Mapping[str, tuple[str, str]]

    @property
    def is_same(self) -> bool:
        """Whether it is the same, bit for bit."""
        again = self.repeated
        return again is not None and all(
            np.array_equal(getattr(self.original, name), getattr(again, name))
            for name in _COMPARED
        )

    def tell(self) -> str:
        """Say in words whether it is the same and, if not, why that may be."""
        name = f"the episode after {self.num_demos} demonstration"
        name += "s" * (self.num_demos != 1)
        if self.is_same:
            return (
                f"{name} is repeated bit for bit: {len(self.original.times)} snapshots "
                f"over {self.original.times[-1]:.2f} s"
            )
        if self.versions:
            changes = ", ".join(
                f"{package} {then}, now {now}"
                for package, (then, now) in self.versions.items()
            )
            return f"{name} goes another way; versions differ: {changes}"
        return (
            f"{name} goes another way from {self._parting():.2f} s on, though all "
            "versions are the same; is it another processor?"
        )

    def _parting(self) -> float:
        """Find the time of the first snapshot that differs, in [s]."""
        again = self.repeated
        if again is None:
            return 0.0
        num = min(len(again.times), len(self.original.times))
        is_other = np.zeros(num, dtype=bool)
        for name in _COMPARED:
            there, here = (getattr(each, name)[:num] for each in (self.original, again))
            is_other |= (there != here).reshape(num, -1).any(axis=1)
        first = int(is_other.argmax()) if is_other.any() else num - 1
        return float(self.original.times[first])


def replay(run: Path, num_demos: int | None = None) -> Replay:
    """Repeat an episode of a run.

    Args:
        run: Folder of the run.
        num_demos: After how many demonstrations; the last episode if None.

    Raises:
        InvalidFile: If the folder is of no run, or has no such episode.
    """
    config, versions = read_run(run)
    if num_demos is None:
        num_demos = list_episodes(run)[-1]
    original = read_episode(run, num_demos)
    task = TASKS[config.task]
    arm = Arm(task.objects, task.item, config.arm)
    original.check_scene(arm.scene)
    kept: list[Snapshot] = []
    seeds = np.random.SeedSequence(config.seed)
    try:
        arm.place(
            original.layout,
            original.commanded,
            keep(lambda snapshots: snapshots, kept),
            rng=arm_rng(seeds, num_demos),
        )
    except InvalidLayout as error:
        raise InvalidFile(
            f"the episode in '{run}' is damaged: {error}; do the run again"
        ) from error
    repeated = None
    if kept:
        repeated = Episode.of_snapshots(original.layout, original.commanded, kept)
    now = package_versions()
    changed = {
        name: (str(versions.get(name)), now[name])
        for name in now
        if versions.get(name) != now[name]
    }
    return Replay(num_demos, original, repeated, changed)


def read_run(run: Path) -> tuple[RunConfig, Mapping[str, object]]:
    """Read the options of a run, and the versions that it was made with.

    Raises:
        InvalidFile: If the folder is of no run.
    """
    content = read_json(run / CONFIG, CONFIG_FORMAT)
    try:
        if content.get("command") != "run":
            raise ValueError(f"its command is {content.get('command')!r:.60}")
        options, versions = content.get("options"), content.get("versions")
        if not isinstance(options, dict) or not isinstance(versions, dict):
            raise ValueError("it has no options or versions")
        return from_options(RunConfig, options), versions
    except ValueError as error:
        raise InvalidFile(
            f"'{run / CONFIG}' is not of a run: {error}; name the folder of one"
        ) from error
