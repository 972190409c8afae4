"""Learn from recorded demonstrations, in a folder that more can be added to."""

import contextlib
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile
from tablesetting.experiments.config import LearnConfig
from tablesetting.experiments.learn_files import NEXT_LAYOUT, LearnFiles
from tablesetting.experiments.learn_setup import LearnSetup, given_files, parse_place
from tablesetting.experiments.learning import LearningRound
from tablesetting.experiments.opening import hash_file, open_folder
from tablesetting.experiments.options import from_options, to_options
from tablesetting.irl.active import learn_from
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.results import (
    CONFIG,
    CONFIG_FORMAT,
    RunFolder,
    package_versions,
    read_json,
)
from tablesetting.reward.files import (
    DEMONSTRATIONS,
    demonstrations_to_json,
    read_demonstrations,
    read_layouts,
)
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.tasks import PlacementTask

_OF_ONE_CALL = ("append", "out", "resume", "overwrite")


@dataclass(frozen=True)
class RecordedSession:
    """Demonstrations to learn from, and the folder that is for it.

    Attributes:
        config: The options.
        setup: What they resolve to.
        folder: Holds settings and demonstrations already.
    """

    config: LearnConfig
    setup: LearnSetup
    folder: RunFolder

    def learn(self) -> Generator[LearningRound, None, None]:
        """Learn from all demonstrations, and write the results.

        Before that from all but the last, to see whether that was foretold; with the
        option `curve`, and for the paper's chain, from one, from two and so on.

        Yields:
            One round per number of demonstrations.
        """
        setup, before = self.setup, None
        files = LearnFiles(self.folder, self.config, setup)
        problem = setup.problem
        is_whole = self.config.curve or problem.config.mcmc.starts_at_map
        rounds = learn_from(
            problem,
            setup.demos,
            STRATEGIES[self.config.strategy],
            problem.config.risk,
            first=1 if is_whole else max(len(setup.demos) - 1, 1),
            rng=setup.rng,
        )
        for learning in rounds:
            look = len(learning.demos)
            before = LearningRound(setup, learning, before, look)
            files.add(before)
            yield before
        files.finish()


@contextlib.contextmanager
def open_session(config: LearnConfig, out: Path) -> Iterator[RecordedSession]:
    """Start to learn in a folder, or go on there.

    Args:
        config: The options.
        out: The folder.

    Raises:
        InvalidFile: If a file cannot be used.
        OutputError: If the folder is taken, or cannot be written.
    """
    task, demos = read_demonstrations(config.demos)
    setup = LearnSetup.of_config(config, task, demos)
    settings = _settings(config, task)
    opened = open_folder(
        out, settings, resume=config.resume, overwrite=config.overwrite
    )
    with opened as folder:
        if config.resume and (out / DEMONSTRATIONS).exists():
            # More may have been appended; nothing of that is to be lost.
            there = read_demonstrations(out / DEMONSTRATIONS)[1]
            if len(there) > len(demos):
                setup = LearnSetup.of_config(config, task, there)
        _keep(folder, task, setup.demos)
        yield RecordedSession(config, setup, folder)


@contextlib.contextmanager
def append_to_session(config: LearnConfig) -> Iterator[RecordedSession]:
    """Add a demonstration to a folder, and go on there.

    Raises:
        InvalidFile: If the folder is of no such session, or it is no demonstration.
        OutputError: If the folder cannot be written.
    """
    assert config.append is not None
    path, (where, text) = config.demos, config.append
    placement = parse_place(text)
    settings = read_settings(path)
    folder = RunFolder(path)
    with folder.locked():
        folder.remove_leftovers()
        task, demos = read_demonstrations(path / DEMONSTRATIONS)
        layout_file = path / NEXT_LAYOUT if where == "next" else Path(where)
        layouts = read_layouts(layout_file, task.objects)
        if len(layouts) != 1:
            raise InvalidFile(
                f"'{layout_file}' holds {len(layouts)} layouts; give that of the "
                "demonstration alone"
            )
        latest = Demonstration(layouts[0], placement)
        is_there = np.array_equal(demos[-1].placement, placement) and (
            where == "next" or np.array_equal(demos[-1].layout, latest.layout)
        )
        if not (config.resume and is_there):
            demos.append(latest)
        setup = LearnSetup.of_config(settings, task, demos)
        _keep(folder, task, demos)
        yield RecordedSession(settings, setup, folder)


def read_settings(path: Path) -> LearnConfig:
    """Read the options that a folder was made with.

    Raises:
        InvalidFile: If it is not of this command.
    """
    content = read_json(path / CONFIG, CONFIG_FORMAT)
    try:
        if content.get("command") != "learn":
            raise ValueError(f"its command is {content.get('command')!r:.60}")
        if not isinstance(content.get("options"), dict):
            raise ValueError("it has no options")
        return from_options(LearnConfig, content["options"])
    except ValueError as error:
        raise InvalidFile(
            f"'{path / CONFIG}' is not of a session of `learn`: {error}; name the "
            "folder of one"
        ) from error


def _settings(config: LearnConfig, task: PlacementTask) -> dict[str, Any]:
    """Return the content of config.json; its paths hold from anywhere."""
    absolute = {
        name: str(Path(getattr(config, name)).resolve())
        for name in ("candidates", "layouts")
        if getattr(config, name) in map(str, given_files(config))
    }
    named = [config.demos, *given_files(config)]
    return {
        "format": CONFIG_FORMAT,
        "command": "learn",
        "options": to_options(config, _OF_ONE_CALL) | absolute,
        "resolved": {
            "task": task.name,
            "sha256": {str(path): hash_file(path) for path in named},
        },
        "versions": package_versions(),
    }


def _keep(
    folder: RunFolder, task: PlacementTask, demos: Sequence[Demonstration]
) -> None:
    """Write the demonstrations first: they are what cannot be computed again."""
    folder.write_json(DEMONSTRATIONS, demonstrations_to_json(demos, task))
