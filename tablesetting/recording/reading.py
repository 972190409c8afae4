"""Reads a recording back, without a viewer."""

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import rerun as rr
from rerun.chunk import RrdReader

from tablesetting.errors import InvalidFile
from tablesetting.recording.entities import NUM_DEMOS, SIM_TIME


@dataclass(frozen=True)
class Row:
    """What was logged of one component at one moment.

    Attributes:
        sim_time: Moment on the clock of the run, in [s]; -inf where it always holds.
        num_demos: Demonstrations learned from by then; 0 where it always holds.
        values: What was logged, one entry per instance; empty where it was cleared.
    """

    sim_time: float
    num_demos: int
    values: list[Any]

    @property
    def value(self) -> Any:
        """The first instance; None where the component was cleared."""
        return self.values[0] if self.values else None


class Recording:
    """A recording that can be read from beginning to end.

    Attributes:
        is_complete: False if the process that wrote it was killed.
    """

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            InvalidFile: If it is missing, damaged, cut off or of another kind.
        """
        if not path.is_file():
            raise InvalidFile(
                f"no recording at {path}; name the folder of a run, or its recording.rrd"
            )
        try:
            self.is_complete, self._chunks = _read(path)
        except (RuntimeError, ValueError, OSError) as error:
            reason = str(error).splitlines()[0].rsplit(": ", maxsplit=1)[-1]
            raise InvalidFile(
                f"{path} is no recording, or a damaged one ({reason}); record the run "
                "again"
            ) from error

    def rows(self, entity: str, component: str) -> list[Row]:
        """List what was logged of one component of an entity, in the order of time."""
        rows = [
            row
            for path, batch in self._chunks
            if path == entity and component in batch.schema.names
            for row in _rows(batch, component)
        ]
        return sorted(rows, key=lambda row: row.sim_time)


def _read(path: Path) -> tuple[bool, list[tuple[str, pa.RecordBatch]]]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        chunks = RrdReader(path).stream().to_chunks()
    # A run that was killed left no footer, but all of its finished rounds.
    has_footer = not any(
        issubclass(w.category, rr.error_utils.RerunWarning) for w in caught
    )
    return has_footer, [(c.entity_path, c.to_record_batch()) for c in chunks]


def _rows(batch: pa.RecordBatch, component: str) -> list[Row]:
    nanoseconds = _index(batch, SIM_TIME)
    demos = _index(batch, NUM_DEMOS)
    values = batch.column(component).to_pylist()
    return [
        Row(-math.inf if t is None else 1e-9 * t, n or 0, v or [])
        for t, n, v in zip(nanoseconds, demos, values, strict=True)
    ]


def _index(batch: pa.RecordBatch, timeline: str) -> list[int | None]:
    if timeline not in batch.schema.names:
        return [None] * batch.num_rows
    indexes: list[int | None] = batch.column(timeline).cast(pa.int64()).to_pylist()
    return indexes
