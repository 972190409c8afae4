"""A folder for results: a new one, or one with the same settings to go on in."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from tablesetting.errors import InvalidFile
from tablesetting.results import CONFIG, CONFIG_FORMAT, RunFolder, read_json


@contextlib.contextmanager
def open_folder(
    path: Path,
    settings: Mapping[str, Any],
    *,
    resume: bool | None,
    overwrite: bool,
    check: Callable[[], None] = lambda: None,
) -> Iterator[RunFolder]:
    """Open a folder with its settings written; nobody else writes to it meanwhile.

    Args:
        path: Where it is, or is to be.
        settings: Content of its config.json, as it will be read back.
        resume: Whether to go on there, if it has the same settings; None if the command
            never can.
        overwrite: Whether an earlier run there, of the same command, may be replaced.
        check: Raises if it must not be replaced even so.

    Raises:
        OutputError: If something else is there, or it cannot be written.
        InvalidFile: If what is there has other settings, or cannot be read.
    """
    folder = RunFolder.make(path)
    command = str(settings["command"])
    with folder.locked():
        is_run = (path / CONFIG).exists()
        if resume and is_run:
            found = read_json(path / CONFIG, CONFIG_FORMAT)
            if difference := first_difference(found, settings):
                raise InvalidFile(
                    f"'{path}' holds a `{found.get('command')!s:.60}` with {difference}; "
                    "its rows are not mixed with others: choose another --out"
                )
            folder.remove_leftovers()  # What a kill cut short goes.
        else:
            if overwrite:
                check()
            can_go_on = resume is not None and is_run and _command_of(path) == command
            remedy = "go on with it by --resume, " if can_go_on else ""
            folder.clear(overwrite=overwrite, command=command, remedy=remedy)
            folder.write_json(CONFIG, settings)
        yield folder


def _command_of(path: Path) -> object:
    """Return the command that a folder is of; None if that cannot be read."""
    try:
        return read_json(path / CONFIG, CONFIG_FORMAT).get("command")
    except InvalidFile:
        return None


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file, so that a change of it does not go unseen."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InvalidFile(f"cannot read '{path}': {error}; check the path") from error


def first_difference(found: Mapping[str, Any], expected: Mapping[str, Any]) -> str:
    """Say in which setting two descriptions differ; empty if in none.

    Rows of different settings, or of different releases, are not mixed.
    """
    for part in ("command", "options", "resolved", "versions"):
        there, here = found.get(part), expected[part]
        if there == here:
            continue
        if not isinstance(there, dict) or not isinstance(here, dict):
            return f"{part} = {there!r:.80}, not {here!r:.80}"
        name = next(
            key
            for key in here | there
            if (key in here, here.get(key)) != (key in there, there.get(key))
        )
        return f"{name} = {there.get(name)!r:.80}, not {here.get(name)!r:.80}"
    return ""
