"""The run folder: settings first, rows as they come, a summary last.

A file under its final name is complete: all but the growing table of rows are written
to a temporary name and then renamed.
"""

import contextlib
import csv
import fcntl
import fnmatch
import io
import json
import math
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting import __version__
from tablesetting.errors import InvalidFile, OutputError

CONFIG = "config.json"
ROUNDS = "rounds.csv"
SUMMARY = "summary.json"
CERTIFICATE = "certificate.json"
RECORDING = "recording.rrd"

CONFIG_FORMAT = "tablesetting-config/1"

Row = Mapping[str, str]
"""A row of a table as it is read: every value as text."""

_RUN_FILES = (
    *(CONFIG, ROUNDS, SUMMARY, RECORDING),
    *("weights.json", "demonstrations.json", "posterior.npz", "posterior.nc"),
    *(CERTIFICATE, "audit.csv"),
    *("figures", "figures/learning.png", "figures/query_*.png"),
    *("comparison.md", "figures/placement.png", "figures/placement.svg"),
    *("figures/comparison.png", "figures/riskiest.png"),
    *("calibration.md", "figures/calibration.png"),
    *("execution.md", "figures/execution.png"),
    *("episodes", "episodes/episode_*.npz"),
    *("next_layout.json", "bounds.csv"),
    *("layouts.csv", "figures/validation.png"),
    *("demos.json", "riskiest.json"),
)

_PACKAGES = ("mujoco", "dm-control", "mink", "rerun-sdk", "numpy", "scipy", "numba")


def package_versions() -> dict[str, str]:
    """Return the version of every package that results depend on."""
    installed = {name: version(name) for name in _PACKAGES}
    return installed | {"tablesetting": __version__}


class RunFolder:
    """A folder that one run writes into.

    Attributes:
        path: Where it is.
    """

    def __init__(self, path: Path):
        self.path = path

    @classmethod
    def make(cls, path: Path) -> "RunFolder":
        """Make a folder, or take the one that is there as it is.

        Raises:
            OutputError: If it cannot be made, or a file is there.
        """
        try:
            path.mkdir(parents=True, exist_ok=True)
        except FileExistsError as error:
            raise OutputError(
                f"'{path}' exists already and is no folder; choose another --out"
            ) from error
        except OSError as error:
            raise OutputError(
                f"cannot write to '{path}': {_reason(error)}; choose another --out"
            ) from error
        return cls(path)

    def clear(
        self, *, overwrite: bool, command: str | None = None, remedy: str = ""
    ) -> None:
        """Empty the folder; what is lost by that has to be an earlier run.

        Args:
            overwrite: Whether an earlier run may be removed.
            command: The command that it has to be of; any if None.
            remedy: What else to advise where it may not.

        Raises:
            OutputError: If there is one and it may not, or there is something else.
        """
        try:
            _clear(self.path, overwrite=overwrite, command=command, remedy=remedy)
        except OSError as error:
            raise OutputError(
                f"cannot write to '{self.path}': {_reason(error)}; choose another --out"
            ) from error

    @contextlib.contextmanager
    def locked(self, *, is_shared: bool = False) -> Iterator[None]:
        """Keep other processes from writing here meanwhile; a kill ends that, too.

        Args:
            is_shared: Whether others may lock it so as well, as they only read.

        Raises:
            OutputError: If another process has it locked.
        """
        directory = os.open(self.path, os.O_RDONLY)
        kind = fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX
        try:
            fcntl.flock(directory, kind | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(directory)
            remedy = "" if is_shared else " or choose another --out"
            raise OutputError(
                f"another process is using '{self.path}'; wait for it{remedy}"
            ) from error
        except OSError:
            pass  # This file system knows no locks.
        try:
            yield
        finally:
            os.close(directory)

    def remove_results(self) -> None:
        """Remove what a run has written, but for its settings, to do it again."""
        for name in _RUN_FILES:
            for found in self.path.glob(name):
                if found.is_file() and found.name != CONFIG:
                    found.unlink()

    def remove(self, *names: str) -> None:
        """Remove files, if they are there.

        Raises:
            OutputError: If one cannot be removed.
        """
        for name in names:
            try:
                (self.path / name).unlink(missing_ok=True)
            except OSError as error:
                raise OutputError(
                    f"cannot remove '{self.path / name}': {_reason(error)}; remove it "
                    "yourself"
                ) from error

    def remove_leftovers(self) -> None:
        """Remove what a kill left half written; nobody else may be writing."""
        for found in self.path.rglob("*"):
            if _is_leftover(found):
                with contextlib.suppress(OSError):
                    found.unlink()

    def write_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a JSON file, atomically."""
        text = json.dumps(content, indent=1, allow_nan=False) + "\n"
        self.write(name, lambda path: path.write_text(text, encoding="utf-8"))

    def write(self, name: str, save: Callable[[Path], object]) -> None:
        """Let `save` write a temporary file, then give it its name.

        Raises:
            OutputError: If it cannot be written; no half of it remains.
        """
        final = self.path / name
        # The suffix stays last: savers go by it.
        temporary = final.with_name(f".{os.getpid()}-{final.name}")
        try:
            final.parent.mkdir(exist_ok=True)
            save(temporary)
            temporary.replace(final)
        except OSError as error:
            raise OutputError(
                f"cannot write '{final}': {_reason(error)}; free some space or "
                "choose another --out"
            ) from error
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink()

    def append_rows(
        self, rows: Sequence[Mapping[str, Any]], name: str = ROUNDS
    ) -> None:
        """Append rows to a table, which takes its header from the first."""
        path = self.path / name
        try:
            with path.open("a+", newline="", encoding="utf-8") as file:
                file.seek(0)
                header = next(csv.reader(file), None)
                if header not in (None, list(rows[0])):
                    raise ValueError(
                        f"'{path}' has the columns {header}; got {list(rows[0])}"
                    )
                # One write: a kill should not come in between.
                file.write(_to_csv(rows, with_header=header is None))
        except OSError as error:
            raise OutputError(
                f"cannot write '{path}': {_reason(error)}; free some space"
            ) from error

    def write_rows(self, rows: Sequence[Mapping[str, Any]], name: str = ROUNDS) -> None:
        """Write a table anew, atomically; that of rounds unless told."""
        text = _to_csv(rows, with_header=True) if rows else ""
        self.write(name, lambda path: path.write_text(text, encoding="utf-8"))


def _to_csv(rows: Sequence[Mapping[str, Any]], *, with_header: bool) -> str:
    """Write rows as lines."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    if with_header:
        writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read_rows(path: Path) -> list[Row]:
    """Read a table back, one dict per row, every value as text.

    Raises:
        InvalidFile: If there is none or it is not a table.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidFile(
            f"cannot read '{path}': {error}; mend it or remove it"
        ) from error


def read_table(path: Path) -> list[Row]:
    """Read a table that is all there.

    Raises:
        InvalidFile: If there is none, or a row has too few cells or too many.
    """
    rows = read_rows(path)
    for number, row in enumerate(rows, start=1):
        if None in row or None in row.values():
            raise InvalidFile(
                f"'{path}': row {number} has other cells than the header; mend it or "
                "remove it"
            )
    return rows


def read_json(path: Path, expected_format: str) -> dict[str, Any]:
    """Read a JSON file of the project.

    Args:
        path: The file.
        expected_format: The value that its field "format" must have.

    Raises:
        InvalidFile: If it cannot be read, is not JSON, or is of another format.
    """
    content = load_json(path)
    found = content.get("format") if isinstance(content, dict) else None
    if found != expected_format:
        raise InvalidFile(
            f"'{path}' has the format {found!r:.60}; expected '{expected_format}'"
        )
    return dict(content)


def read_arrays(path: Path) -> dict[str, "np.ndarray[Any, Any]"]:
    """Read an archive of arrays; nothing in it is unpickled.

    Raises:
        InvalidFile: If it cannot be read, or is none.
    """
    try:
        # Opened here: numpy would leave a damaged one open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except Exception as error:  # A damaged archive raises whatever it likes.
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InvalidFile(
            f"cannot read '{path}': {reason}; do the run again"
        ) from error


def format_of(path: Path) -> object:
    """Return the field "format" of a JSON file; None if it has none.

    Raises:
        InvalidFile: If it cannot be read or is not JSON.
    """
    content = load_json(path)
    return content.get("format") if isinstance(content, dict) else None


def load_json(path: Path) -> Any:
    """Read any JSON file.

    Raises:
        InvalidFile: If it cannot be read or is not JSON.
    """
    try:
        text = path.read_text(encoding="utf-8")
        return json.loads(text, object_pairs_hook=_without_duplicates)
    except OSError as error:
        raise InvalidFile(
            f"cannot read '{path}': {_reason(error)}; check the path"
        ) from error
    except (ValueError, RecursionError) as error:
        raise InvalidFile(f"'{path}' is not valid JSON: {error}; mend it") from error


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object of its members; json would keep the last of two of a name."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"'{twice}' occurs twice in one object")
    return content


def numbers(rows: Sequence[Row], column: str) -> list[float]:
    """Return a column as numbers; an empty cell becomes NaN."""
    return [float(row[column]) if row[column] else float("nan") for row in rows]


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON has it: none for what is not finite."""
    return value if math.isfinite(value) else None


def _reason(error: OSError) -> str:
    """Say what went wrong; an error without a number has no `strerror`."""
    return error.strerror or str(error)


def _clear(path: Path, *, overwrite: bool, command: str | None, remedy: str) -> None:
    """Remove an earlier run, and nothing but a run."""
    if not all(_is_leftover(found) for found in path.iterdir()):
        if not overwrite:
            raise OutputError(
                f"'{path}' exists already; {remedy}choose another --out or pass "
                "--overwrite"
            )
        foreign = _first_foreign(path, command)
        if foreign is not None:
            raise OutputError(
                f"'{path}' is not overwritten, because {foreign}; choose another --out"
            )
    # The folder itself stays: it may be where a disk is mounted.
    for found in path.iterdir():
        if found.is_dir():
            shutil.rmtree(found)
        else:
            found.unlink()


def _is_leftover(path: Path) -> bool:
    """Tell whether a file of a run has its temporary name still, cut short by a kill."""
    final = re.fullmatch(r"\.[0-9]+-(.+)", path.name)
    return final is not None and any(
        fnmatch.fnmatchcase(final[1], Path(known).name) for known in _RUN_FILES
    )


def _first_foreign(path: Path, command: str | None) -> str | None:
    """Say why a folder is more than a run of a command, or none; None for a mere run."""
    if path.is_symlink():
        return "it is a link"
    try:
        found = read_json(path / CONFIG, CONFIG_FORMAT).get("command")
    except InvalidFile:
        return "it holds no run"
    if command is not None and found != command:
        return f"it holds what {found!r:.60} wrote, not {command!r}"
    for found in path.rglob("*"):
        name = found.relative_to(path).as_posix()
        is_known = any(fnmatch.fnmatchcase(name, known) for known in _RUN_FILES)
        if not is_known and not _is_leftover(found):
            return f"it holds '{name}', which is not of a run"
    return None
