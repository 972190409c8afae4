"""What the commands of both packages have in common, where they meet the terminal."""

import contextlib
import errno
import io
import itertools
import os
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path

import tyro

from tablesetting.errors import (
    InvalidFile,
    InvalidLayout,
    OutputError,
    TableSettingError,
    is_interruption,
)

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit codes; 0 is success."""


def run_command(command: Callable[[], int]) -> int:
    """Carry a command out; an error of the package is told in one line.

    Returns:
        The exit code: 0, 1 (the work failed), 2 (bad input) or 130 (interrupted).
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # A path may be any bytes.
    try:
        return command()
    except (InvalidFile, InvalidLayout, OutputError) as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    except TableSettingError as error:
        print(f"error: {error}", file=sys.stderr)
        return FAILED
    except Stopped as stop:
        return stop.code
    except BrokenPipeError:
        # Nobody reads on; what Python still holds back must not complain either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        print(f"error: '{error.filename!s:.60}...': {error.strerror}", file=sys.stderr)
        return BAD_INPUT


class Stopped(Exception):
    """Work was begun and broken off, which has been told already."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


@contextlib.contextmanager
def telling_why_it_stops(progress: Callable[[], str]) -> Iterator[None]:
    """Tell how far the work got if it is interrupted, or why it cannot go on.

    Args:
        progress: Says what is kept, and how to go on.
    """
    try:
        yield
    except (KeyboardInterrupt, SystemError) as error:
        if not is_interruption(error):
            raise
        print(f"interrupted; {progress()}", file=sys.stderr)
        raise Stopped(INTERRUPTED) from error
    except OutputError as error:  # The folder could be written at the start.
        print(f"error: {error}", file=sys.stderr)
        raise Stopped(FAILED) from error


def parse(
    arguments: Sequence[str],
    configs: Mapping[str, Callable[..., object]],
    *,
    prog: str,
    description: str,
) -> object:
    """Parse the arguments; a mistake in them is told in one line.

    Args:
        arguments: Those after the program's name.
        configs: The options of each command, by its name.
        prog: The program's name.
        description: What it is for.

    Raises:
        SystemExit: If there is a mistake, or help was asked for.
    """
    for argument in arguments:
        if _is_undecodable(argument):
            print(
                f"error: {os.fsencode(argument)!r} is not UTF-8; name it otherwise",
                file=sys.stderr,
            )
            raise SystemExit(BAD_INPUT)
    if arguments and not arguments[0].startswith("-") and arguments[0] not in configs:
        expected = ", ".join(configs)
        print(
            f"error: {prog} knows no {arguments[0]!r}; expected one of {expected}",
            file=sys.stderr,
        )
        raise SystemExit(BAD_INPUT)
    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.extras.subcommand_cli_from_dict(
                dict(configs),
                prog=prog,
                description=description,
                args=list(arguments),
                config=(tyro.conf.DisallowNone, tyro.conf.FlagCreatePairsOff),
            )
    except SystemExit as stop:
        sys.stdout.flush()  # Or nobody could tell here that nobody reads.
        if stop.code:
            print(f"error: {_unbox(complaint.getvalue())}", file=sys.stderr)
        raise


def _is_undecodable(text: str) -> bool:
    """Tell whether a text has bytes in it that are of no character."""
    return any("\ud800" <= letter <= "\udfff" for letter in text)


def _unbox(text: str) -> str:
    """Take the message out of the box that tyro draws around it."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", text)  # It has colours on a terminal.
    lines = [line.strip("│| ") for line in plain.splitlines()[1:]]
    body = itertools.dropwhile(_is_rule, lines)
    message = " ".join(itertools.takewhile(lambda line: not _is_rule(line), body))
    message = re.sub(r", 'None'|'None', ", "", message)  # Is listed, but refused.
    message = re.sub(
        r"no type matching \{(.*)\} could be instantiated from",
        lambda types: f"expected {len(types[1].split())} values, got",
        message,
    )
    return re.sub(r"^Error parsing (\w+Config|__\S+): ", "", message)


def _is_rule(line: str) -> bool:
    """Tell whether a line is empty or drawn; how to get help follows the last one."""
    return not line.strip("─╰╯-+ ")


def program(name: str) -> list[str]:
    """Return how a program of the package can be called."""
    if Path(sys.argv[0]).name == "__main__.py":
        return [sys.executable, "-m", name.replace("-", "_")]
    return [name if shutil.which(name) else sys.argv[0]]


def resume_advice(out: Path) -> str:
    """Say how to go on in a folder."""
    return f"go on with the same options and --resume {shlex.join(['--out', str(out)])}"


def follow_trials(
    trials: Generator[object, None, None], num_before: int, num_trials: int
) -> None:
    """Carry trials out, and show how far they are: a bar, or a line for each tenth.

    Args:
        trials: Does another one each time; closed in any case.
        num_before: How many are done already.
        num_trials: How many there are in all.
    """
    from tqdm import tqdm

    with (
        contextlib.closing(trials),
        tqdm(total=num_trials, initial=num_before, unit="trial", disable=None) as bar,
    ):
        for num_done, _ in enumerate(trials, start=num_before + 1):
            bar.update()
            if bar.disable and _is_tenth(num_done, num_trials):
                print(f"{num_done} of {num_trials} trials", flush=True)


def _is_tenth(count: int, total: int) -> bool:
    """Tell whether a count is the first of a tenth of the total."""
    return 10 * count // total > 10 * (count - 1) // total


def num_cores() -> int:
    """Count the cores that this process may use."""
    return len(os.sched_getaffinity(0))


def new_folder(parent: Path, name: str) -> Path:
    """Name a folder after the time; a second one in the same second gets a number."""
    stamped = parent / f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
    numbered = (stamped.with_name(f"{stamped.name}-{n}") for n in itertools.count(2))
    candidates = itertools.chain([stamped], numbered)
    return next(path for path in candidates if not path.exists())
