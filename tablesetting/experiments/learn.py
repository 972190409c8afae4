"""Learn from recorded demonstrations, in a folder that more can be added to."""

import contextlib
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile, OutputError
from tablesetting.experiments.config import LearnConfig
from tablesetting.experiments.learn_files import NEXT_LAYOUT, LearnFiles
from tablesetting.experiments.learn_setup import LearnSetup, given_files, parse_place
from tablesetting.experiments.learning import LearningRound
from tablesetting.irl.active import learn_from
from tablesetting.irl.arrays import Array
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.opening import first_difference, hash_file, open_folder
from tablesetting.options import from_options, to_options
from tablesetting.results import (
    CERTIFICATE,
    CONFIG,
    CONFIG_FORMAT,
    SUMMARY,
    RunFolder,
    load_json,
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

_PARTS = ("options", "resolved", "versions")
_OF_ONE_CALL = ("append", "out", "resume", "overwrite")


@dataclass(frozen=True)
class RecordedSession:
    """Demonstrations to learn from, and the folder that is for it.

    Attributes:
        config: The options.
        setup: What they resolve to.
        files: Write into the folder, which holds settings and demonstrations already.
    """

    config: LearnConfig
    setup: LearnSetup
    files: LearnFiles

    def learn(self) -> Generator[LearningRound, None, None]:
        """Learn from all demonstrations, and write the results.

        Before that from all but the last, to see whether that was foretold; with the
        option `curve`, and for the paper's chain, from one, from two and so on.

        Yields:
            One round per number of demonstrations.
        """
        setup, files, before = self.setup, self.files, None
        rounds = learn_from(
            setup.problem,
            setup.demos,
            STRATEGIES[self.config.strategy],
            setup.problem.config.risk,
            first=setup.first,
            rng=setup.rng,
        )
        for learning in rounds:
            look = len(learning.demos)
            known = () if before else files.known_p_values
            before = LearningRound(setup, learning, before, look, known)
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
    if config.demos.is_dir():
        raise InvalidFile(
            f"'{config.demos}' is a folder; name a file of demonstrations, or add one to "
            "the folder with --append next X,Y"
        )
    task, demos = read_demonstrations(config.demos)
    setup = LearnSetup.of_config(config, task, demos)
    opened = open_folder(
        out,
        _settings(config, task, len(demos)),
        resume=config.resume,
        overwrite=config.overwrite,
        check=lambda: _refuse_loss(config, out, demos),
    )
    with opened as folder:
        if config.resume and (out / DEMONSTRATIONS).exists():
            # More may have been appended; nothing of that is to be lost.
            there = read_demonstrations(out / DEMONSTRATIONS)[1]
            if len(there) > len(demos):
                setup = LearnSetup.of_config(config, task, there)
        files = LearnFiles(folder, config, setup)
        _keep(folder, task, setup.demos)
        yield RecordedSession(config, setup, files)


@contextlib.contextmanager
def append_to_session(config: LearnConfig) -> Iterator[RecordedSession]:
    """Add a demonstration to a folder, and go on there.

    Raises:
        InvalidFile: If the folder is of no such session or what it was made with has
            changed, or it is no demonstration.
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
        is_learned = _is_learned(path, len(demos))
        if not is_learned and len(demos) <= _num_recorded(path):
            raise InvalidFile(
                f"'{path}' is not finished; go on there with --resume first, as "
                f"`learn {settings.demos} --out {path} --resume`"
            )
        latest = Demonstration(_layout_of(path, where, task), placement)
        # An asked layout may have been followed by the next one already.
        is_there = np.array_equal(demos[-1].placement, placement) and (
            where == "next" or np.array_equal(demos[-1].layout, latest.layout)
        )
        _check_answer(config, demos[-1], is_there=is_there, is_learned=is_learned)
        if is_learned:
            demos.append(latest)
        setup = LearnSetup.of_config(settings, task, demos)
        files = LearnFiles(folder, settings, setup)
        _keep(folder, task, demos)
        yield RecordedSession(settings, setup, files)


def _layout_of(path: Path, where: str, task: PlacementTask) -> Array:
    """Return the layout of an answer, that was asked about or is in a file."""
    file = path / NEXT_LAYOUT if where == "next" else Path(where)
    layouts = read_layouts(file, task.objects)
    if len(layouts) != 1:
        raise InvalidFile(
            f"'{file}' holds {len(layouts)} layouts; give that of the demonstration "
            "alone"
        )
    return layouts[0]


def _check_answer(
    config: LearnConfig, last: Demonstration, *, is_there: bool, is_learned: bool
) -> None:
    """Refuse an answer if it is not clear whether it is a new one."""
    x, y = last.placement
    if is_learned and config.resume and is_there:
        raise InvalidFile(
            f"the last demonstration in '{config.demos}' is at {x},{y} as well, and is "
            "learned from; leave out --resume if this is another one"
        )
    if not is_learned and not (config.resume and is_there):
        raise InvalidFile(
            f"the last demonstration in '{config.demos}', at {x},{y}, is not learned "
            "from yet; give that one again, with --resume"
        )


def _is_learned(path: Path, num_demos: int) -> bool:
    """Tell whether the results in a folder are of all its demonstrations."""
    summary = path / SUMMARY
    content = load_json(summary) if summary.exists() else None
    return isinstance(content, dict) and content.get("num_demos") == num_demos


def read_settings(path: Path) -> LearnConfig:
    """Read the options that a folder was made with.

    Raises:
        InvalidFile: If it is not of this command.
    """
    content = read_json(path / CONFIG, CONFIG_FORMAT)
    try:
        if content.get("command") != "learn":
            raise ValueError(f"its command is {content.get('command')!r:.60}")
        if not all(isinstance(content.get(part), dict) for part in _PARTS):
            raise ValueError(f"it lacks one of {', '.join(_PARTS)}")
        config = from_options(LearnConfig, content["options"])
    except ValueError as error:
        raise InvalidFile(
            f"'{path / CONFIG}' is not of a session of `learn`: {error}; name the "
            "folder of one"
        ) from error
    # Where the demonstrations came from does not matter any more.
    now = content["resolved"] | _hashes(given_files(config))
    expected = content | {"resolved": now, "versions": package_versions()}
    if difference := first_difference(content, expected):
        raise InvalidFile(
            f"'{path}' was made with {difference}; rows of both are not mixed: learn "
            f"anew from '{path / DEMONSTRATIONS}', with another --out"
        )
    return config


def _num_recorded(path: Path) -> int:
    """Return how many demonstrations a folder began with; those after it are answers."""
    resolved = read_json(path / CONFIG, CONFIG_FORMAT).get("resolved")
    count = resolved.get("num_demos") if isinstance(resolved, dict) else None
    return count if isinstance(count, int) else 0


def _settings(
    config: LearnConfig, task: PlacementTask, num_demos: int
) -> dict[str, Any]:
    """Return the content of config.json; its paths hold from anywhere."""
    files = {"demos": config.demos, **given_files(config)}
    absolute = {option: str(path.resolve()) for option, path in files.items()}
    return {
        "format": CONFIG_FORMAT,
        "command": "learn",
        "options": to_options(config, _OF_ONE_CALL) | absolute,
        "resolved": {"task": task.name, "num_demos": num_demos, **_hashes(files)},
        "versions": package_versions(),
    }


def _hashes(files: Mapping[str, Path]) -> dict[str, str]:
    """Return what tells whether files that options name are the same."""
    return {f"{option}_sha256": hash_file(path) for option, path in files.items()}


def _refuse_loss(
    config: LearnConfig, out: Path, demos: Sequence[Demonstration]
) -> None:
    """Refuse to replace a folder with answers in it, or with what is learned from."""
    for file in (config.demos, *given_files(config).values()):
        if out.resolve() in file.resolve().parents:
            raise OutputError(
                f"'{out}' is not overwritten, because '{file}' is in it; choose another "
                "--out"
            )
    path = out / DEMONSTRATIONS
    if not path.exists() or not (out / CONFIG).exists():
        return
    answers = read_demonstrations(path)[1][_num_recorded(out) :]
    lost = [answer for answer in answers if not _is_among(answer, demos)]
    if lost:
        raise OutputError(
            f"'{out}' is not overwritten, because what was appended there would be lost, "
            f"{len(lost)} demonstrations; choose another --out"
        )


def _is_among(demo: Demonstration, demos: Sequence[Demonstration]) -> bool:
    return any(
        np.array_equal(demo.layout, other.layout)
        and np.array_equal(demo.placement, other.placement)
        for other in demos
    )


def _keep(
    folder: RunFolder, task: PlacementTask, demos: Sequence[Demonstration]
) -> None:
    """Write the demonstrations first: they are what cannot be computed again."""
    folder.write_json(DEMONSTRATIONS, demonstrations_to_json(demos, task))
    # Nothing there may claim to be of all of them before it is.
    folder.remove(SUMMARY, CERTIFICATE)
