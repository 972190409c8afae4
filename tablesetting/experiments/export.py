"""A run in formats that other programs read."""

import csv
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile, OutputError
from tablesetting.results import ROUNDS, read_arrays, read_rows
from tablesetting.reward.demonstration_table import columns_of
from tablesetting.reward.files import DEMONSTRATIONS, read_demonstrations


def export(run: Path, form: str, out: Path, *, overwrite: bool) -> None:
    """Write a run into a new folder, which gets its name once it is complete.

    Args:
        run: Folder of the run.
        form: One of `FORMS`.
        out: The new folder.
        overwrite: Whether an earlier export there may be replaced.

    Raises:
        InvalidFile: If the run lacks what is to be exported.
        OutputError: If the folder is taken or cannot be written.
    """
    if out.exists() and not (overwrite and _is_export(out)):
        remedy = " or pass --overwrite" if _is_export(out) else ""
        raise OutputError(f"'{out}' exists already; choose another --out{remedy}")
    temporary = out.with_name(f".{os.getpid()}-{out.name}")
    try:
        temporary.mkdir(parents=True)
        FORMS[form](run, temporary)
        if out.exists():
            shutil.rmtree(out)
        temporary.rename(out)
    except OSError as error:
        raise OutputError(
            f"cannot write '{out}': {error.strerror or error}; free some space or choose "
            "another --out"
        ) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _is_export(path: Path) -> bool:
    """Tell whether a folder holds nothing but what was exported."""
    known = {ROUNDS, "demonstrations.csv", "posterior.npz", "meta", "data"}
    return path.is_dir() and {found.name for found in path.iterdir()} <= known


def _export_csv(run: Path, out: Path) -> None:
    """Write rounds and demonstrations as tables."""
    rows = read_rows(run / ROUNDS)
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
