"""Curves over the number of demonstrations: means over trials, and published ones."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tablesetting.results import Row, numbers, read_rows

Array = npt.NDArray[np.float64]


class CurveKey(NamedTuple):
    """What a curve is of: a column of the rows of one task and strategy."""

    task: str
    strategy: str
    quantity: str


@dataclass(frozen=True)
class Curve:
    """The mean of a quantity over trials.

    Attributes:
        num_demos: Numbers of demonstrations, increasing, shape (S,).
        means: Mean over the trials after as many, shape (S,).
        stds: Standard deviation over the trials, shape (S,).
        num_trials: How many trials there were.
    """

    num_demos: Array
    means: Array
    stds: Array
    num_trials: int

    @property
    def half_stds(self) -> Array:
        """The error bars that the paper draws, shape (S,)."""
        return 0.5 * self.stds

    @property
    def standard_errors(self) -> Array:
        """How exact the means are, shape (S,)."""
        return self.stds / np.sqrt(self.num_trials)


Curves = Mapping[CurveKey, Curve]

_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Share:
    """How many of independent cases something happened in.

    Attributes:
        count: In how many it did.
        total: How many cases there were.
    """

    count: int
    total: int

    @classmethod
    def of(cls, outcomes: Sequence[bool]) -> "Share":
        """Count outcomes."""
        return cls(sum(outcomes), len(outcomes))

    @property
    def value(self) -> float:
        """The share; NaN of no cases."""
        return self.count / self.total if self.total else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Where the chance of it is with 95 % confidence (Wilson 1927)."""
        if not self.total:
            return 0.0, 1.0
        spread = _NORMAL_95**2 / self.total
        center = (self.value + 0.5 * spread) / (1.0 + spread)
        variance = self.value * (1.0 - self.value) / self.total
        half = _NORMAL_95 * np.sqrt(variance + 0.25 * spread / self.total)
        half /= 1.0 + spread
        return max(float(center - half), 0.0), min(float(center + half), 1.0)

    def __str__(self) -> str:
        """Write it in percent, with the interval."""
        if not self.total:
            return "none"
        low, high = self.interval
        return f"{100 * self.value:.1f} ({100 * low:.0f}-{100 * high:.0f})"


def average(rows: Iterable[Row], quantities: Iterable[str]) -> dict[CurveKey, Curve]:
    """Average columns of a table over its trials.

    Args:
        rows: Rows with task, strategy, trial and num_demos, every trial complete.
        quantities: Columns to average.

    Returns:
        A curve for each task, strategy and quantity, in the order of the rows.
    """
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["task"], row["strategy"]), []).append(row)
    quantities = tuple(quantities)
    return {
        CurveKey(task, strategy, quantity): mean_curve(*_by_step(group, quantity))
        for (task, strategy), group in groups.items()
        for quantity in quantities
    }


def paired_difference(
    rows: Iterable[Row],
    task: str,
    strategy: str,
    other: str,
    quantity: str = "mean_placement_error",
) -> Curve:
    """Average over the trials how much larger a quantity is than under another strategy.

    Both strategies have to be in the same trials, which makes the mean more exact than
    the difference of two means.
    """
    own = [row for row in rows if row["task"] == task]
    num_demos, values = _by_step(_of_strategy(own, strategy), quantity)
    _, others = _by_step(_of_strategy(own, other), quantity)
    return mean_curve(num_demos, values - others)


@dataclass(frozen=True)
class Reach:
    """How many demonstrations it takes to get a quantity down to a level.

    Attributes:
        strategy: Who asks.
        level: The level.
        mean: Mean number of demonstrations over the trials; those that never get there
            count one more than they had, so that the mean is too small.
        standard_error: How exact the mean is.
        num_missed: Trials that never get there.
        num_trials: How many trials there were.
        ratio: Mean over the baseline's, both in the same trials; None without one.
        ratio_error: Standard error of that, by the delta method.
    """

    strategy: str
    level: float
    mean: float
    standard_error: float
    num_missed: int
    num_trials: int
    ratio: float | None
    ratio_error: float | None


def reaches(
    rows: Iterable[Row],
    task: str,
    level: float,
    baseline: str = "random",
    quantity: str = "mean_placement_error",
) -> list[Reach]:
    """Count for each strategy the demonstrations until a quantity is at a level."""
    own = [row for row in rows if row["task"] == task]
    needed = {
        strategy: _first_at(*_by_step(_of_strategy(own, strategy), quantity), level)
        for strategy in dict.fromkeys(row["strategy"] for row in own)
    }
    most = max(numbers(own, "num_demos"))
    return [
        _reach(strategy, level, counts, needed.get(baseline), most)
        for strategy, counts in needed.items()
    ]


def _first_at(num_demos: Array, values: Array, level: float) -> Array:
    """Return the first number of demonstrations at the level, shape (T,)."""
    is_there = values <= level
    first = np.where(is_there.any(axis=0), is_there.argmax(axis=0), len(num_demos))
    return np.append(num_demos, num_demos[-1] + 1.0)[first]


def _reach(
    strategy: str, level: float, counts: Array, others: Array | None, most: float
) -> Reach:
    num_trials = len(counts)
    spread = float(counts.std(ddof=min(1, num_trials - 1)))
    ratio = ratio_error = None
    if others is not None:
        ratio = float(counts.mean() / others.mean())
        left = counts - ratio * others
        ratio_error = float(
            left.std(ddof=min(1, num_trials - 1))
            / (np.sqrt(num_trials) * others.mean())
        )
    return Reach(
        strategy=strategy,
        level=level,
        mean=float(counts.mean()),
        standard_error=spread / float(np.sqrt(num_trials)),
        num_missed=int(np.count_nonzero(counts > most)),
        num_trials=num_trials,
        ratio=ratio,
        ratio_error=ratio_error,
    )


def _of_strategy(rows: Iterable[Row], strategy: str) -> list[Row]:
    return [row for row in rows if row["strategy"] == strategy]


def _by_step(rows: Sequence[Row], quantity: str) -> tuple[Array, Array]:
    """Return numbers of demonstrations (S,) and values, trials in order, (S, T)."""
    num_demos, steps = np.unique(numbers(rows, "num_demos"), return_inverse=True)
    values = np.array(numbers(rows, quantity))
    order = np.lexsort((np.array(numbers(rows, "trial")), steps))
    return num_demos, values[order].reshape(len(num_demos), -1)


def mean_curve(num_demos: Array, values: Array) -> Curve:
    """Average values, shape (S, T), over the trials; one trial has no spread."""
    num_trials = values.shape[1]
    stds = values.std(axis=1, ddof=min(1, num_trials - 1))
    return Curve(num_demos, values.mean(axis=1), stds, num_trials)


def read_published(path: Path, num_trials: int) -> dict[CurveKey, Curve]:
    """Read published curves: task, strategy, quantity, num_demos, mean, half_std.

    Args:
        path: A table of the package.
        num_trials: Trials that the means are over.
    """
    groups: dict[CurveKey, list[Row]] = {}
    for row in read_rows(path):
        key = CurveKey(row["task"], row["strategy"], row["quantity"])
        groups.setdefault(key, []).append(row)
    return {
        key: Curve(
            np.array(numbers(rows, "num_demos")),
            np.array(numbers(rows, "mean")),
            2.0 * np.array(numbers(rows, "half_std")),
            num_trials,
        )
        for key, rows in groups.items()
    }
