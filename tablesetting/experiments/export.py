"""A run in formats that other programs read."""

import csv
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile, OutputError
from tablesetting.results import (
    CONFIG,
    ROUNDS,
    SUMMARY,
    RunFolder,
    load_json,
    read_arrays,
    read_json,
    read_table,
)
from tablesetting.reward.demonstration_table import columns_of
from tablesetting.reward.files import DEMONSTRATIONS, read_demonstrations

EXPORT_FORMAT = "tablesetting-export/1"

_MARK = "export.json"


def export(run: Path, form: str, out: Path, *, overwrite: bool) -> None:
    """Write a run into a new folder, which gets its name once it is complete.

    Args:
        run: Folder of the run, which is finished.
        form: One of `FORMS`.
        out: The new folder.
        overwrite: Whether an earlier export there may be replaced.

    Raises:
        InvalidFile: If the run lacks what is to be exported.
        OutputError: If the folder is taken or cannot be written, or the run is being
            written.
    """
    out = out.resolve()
    if out.exists():
        is_export = _is_export(out)
        if not (overwrite and is_export):
            remedy = " or pass --overwrite" if is_export else ""
            raise OutputError(f"'{out}' exists already; choose another --out{remedy}")
    if not (run / CONFIG).exists():
        raise InvalidFile(f"'{run}' is no run; name the folder of one")
    temporary = out.with_name(f".{os.getpid()}-{out.name}")
    try:
        with RunFolder(run).locked(is_shared=True):
            _check_finished(run)
            temporary.mkdir(parents=True)
            FORMS[form](run, temporary)
        _mark(temporary, form)
        if overwrite and _is_export(out):
            shutil.rmtree(out)
        temporary.rename(out)  # Fails if anything has come there meanwhile.
    except OSError as error:
        raise OutputError(
            f"cannot write '{out}': {error.strerror or error}; free some space or choose "
            "another --out"
        ) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _check_finished(run: Path) -> None:
    """Refuse a run whose files may not be of the same demonstrations."""
    summary = load_json(run / SUMMARY) if (run / SUMMARY).exists() else None
    count = summary.get("num_demos") if isinstance(summary, dict) else None
    if count is None or len(read_demonstrations(run / DEMONSTRATIONS)[1]) != count:
        raise InvalidFile(
            f"'{run}' is not finished, or holds no demonstrations; go on with it by "
            "--resume, or name a run that has them"
        )


def _files(path: Path) -> list[str]:
    """List what a folder holds at any depth, but for folders."""
    found = (each for each in path.rglob("*") if each.is_symlink() or not each.is_dir())
    return sorted(each.relative_to(path).as_posix() for each in found)


def _mark(path: Path, form: str) -> None:
    """Write down what was exported, so that nothing else is ever replaced."""
    content = {"format": EXPORT_FORMAT, "form": form, "files": _files(path)}
    (path / _MARK).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _is_export(path: Path) -> bool:
    """Tell whether a folder holds nothing but what was exported."""
    try:
        exported = read_json(path / _MARK, EXPORT_FORMAT).get("files")
    except InvalidFile:
        return False
    return isinstance(exported, list) and set(_files(path)) <= {
        _MARK,
        *map(str, exported),
    }


def _export_csv(run: Path, out: Path) -> None:
    """Write rounds and demonstrations as tables."""
    rows = read_table(run / ROUNDS)
    if not rows:
        raise InvalidFile(f"'{run / ROUNDS}' has no rows; finish the run")
    _write_table(out / ROUNDS, list(rows[0]), [list(row.values()) for row in rows])
    task, demos = read_demonstrations(run / DEMONSTRATIONS)
    table = [[*demo.layout.ravel(), *demo.placement] for demo in demos]
    _write_table(out / "demonstrations.csv", columns_of(task), table)


def _write_table(path: Path, header: Sequence[str], rows: Sequence[Any]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def _export_npz(run: Path, out: Path) -> None:
    """Write the posterior with the demonstrations that it is of."""
    posterior: dict[str, Any] = read_arrays(run / "posterior.npz")
    task, demos = read_demonstrations(run / DEMONSTRATIONS)
    np.savez(
        out / "posterior.npz",
        **posterior,
        objects=np.array(task.objects),
        layouts=np.stack([demo.layout for demo in demos]),
        placements=np.stack([demo.placement for demo in demos]),
    )


def _export_lerobot(run: Path, out: Path) -> None:
    # pyarrow comes with Rerun, and takes a while to import.
    from tablesetting.experiments.lerobot import write_dataset

    write_dataset(run, out)


FORMS: Mapping[str, Callable[[Path, Path], None]] = {
    "lerobot": _export_lerobot,
    "csv": _export_csv,
    "npz": _export_npz,
}
"""What writes each format, by name."""
