"""What a benchmark measures, and how: processor time, so that a busy machine matters little."""

import statistics
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import process_time

Work = Callable[[], object]

MIN_REPEATS = 3
_MAX_REPEATS = 10
_ENOUGH_SECONDS = 0.5


@dataclass(frozen=True)
class Plain:
    """The same work in plain numpy, done whole or in part.

    Attributes:
        work: Does the part.
        share: The part, as a fraction of the whole.
    """

    work: Work
    share: float

    def seconds(self) -> float:
        """Measure the part and scale it to the whole."""
        return min(_repeat(self.work)) / self.share


@dataclass(frozen=True)
class Timing:
    """How long something takes.

    Attributes:
        name: What.
        seconds_min: Least processor time of all repeats.
        seconds_median: Their median.
        num_repeats: How many there were.
        peak_mib: Most memory that it held at once; None if not looked at.
        plain_seconds: What plain numpy needs for the whole; None if not compared.
        plain_share: The fraction of the whole that plain numpy was measured on.
    """

    name: str
    seconds_min: float
    seconds_median: float
    num_repeats: int
    peak_mib: float | None = None
    plain_seconds: float | None = None
    plain_share: float | None = None

    @property
    def ratio(self) -> float | None:
        """How many times longer plain numpy takes."""
        return self.plain_seconds and self.plain_seconds / self.seconds_min


@dataclass(frozen=True)
class Quantity:
    """A figure that is not a time.

    Attributes:
        name: Of what.
        value: How much.
        unit: Of the value.
    """

    name: str
    value: float
    unit: str


Figure = Timing | Quantity


def cpu_seconds(work: Work) -> float:
    """Measure the processor time of one run."""
    started = process_time()
    work()
    return process_time() - started


def measure(
    name: str, work: Work, *, plain: Plain | None = None, traces_memory: bool = False
) -> Timing:
    """Time a piece of work, and plain numpy beside it.

    Args:
        name: What is measured.
        work: Does the same each time.
        plain: The same in plain numpy, if compared.
        traces_memory: Whether one more run, not timed, looks at the memory.
    """
    return summarize(
        name,
        _repeat(work),
        peak_mib=_peak_mib(work) if traces_memory else None,
        plain=plain,
    )


def summarize(
    name: str,
    seconds: Sequence[float],
    *,
    peak_mib: float | None = None,
    plain: Plain | None = None,
) -> Timing:
    """Put the times of all repeats together, and take that of plain numpy."""
    return Timing(
        name,
        seconds_min=min(seconds),
        seconds_median=statistics.median(seconds),
        num_repeats=len(seconds),
        peak_mib=peak_mib,
        plain_seconds=plain.seconds() if plain else None,
        plain_share=plain.share if plain else None,
    )


def _repeat(work: Work) -> list[float]:
    """Measure the processor time of run after run."""
    work()  # Not timed: it loads what is compiled, or compiles it.
    seconds: list[float] = []
    while len(seconds) < MIN_REPEATS or (
        len(seconds) < _MAX_REPEATS and sum(seconds) < _ENOUGH_SECONDS
    ):
        seconds.append(cpu_seconds(work))
    return seconds


def _peak_mib(work: Work) -> float:
    tracemalloc.start()
    work()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak / 2**20
