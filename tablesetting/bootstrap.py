"""How exact figures of a sample are, by drawing it again and again."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_NUM_RESAMPLES = 2000
_NUM_AT_ONCE = 200_000  # Values drawn.
_CONFIDENCE = 0.95

STATISTICS: Mapping[str, Callable[[Array], Array]] = {
    "mean": lambda values: values.mean(axis=-1),
    "median": lambda values: np.median(values, axis=-1),
    "p90": lambda values: np.quantile(values, 0.90, axis=-1),
    "p95": lambda values: np.quantile(values, 0.95, axis=-1),
    "max": lambda values: values.max(axis=-1),
}
"""Figures of values over the last axis, by name."""


@dataclass(frozen=True)
class Estimate:
    """A figure of a sample, and between which it lies with 95 % confidence.

    Attributes:
        value: The figure.
        low: Lower end of the interval; None where the sample tells nothing of it.
        high: Upper end; of a maximum no more than itself, as nothing larger was seen.
    """

    value: float
    low: float | None
    high: float | None

    def __str__(self) -> str:
        """Write it with its interval."""
        if self.low is None or self.high is None:
            return f"{self.value:.4f}"
        joint = "-" if self.low >= 0.0 else " to "
        return f"{self.value:.4f} ({self.low:.4f}{joint}{self.high:.4f})"


def estimate(values: Array, *, rng: np.random.Generator) -> dict[str, Estimate]:
    """Estimate all figures of a sample by the percentile bootstrap.

    Source: Efron & Tibshirani, *An Introduction to the Bootstrap* (1993), chapter 13.

    Args:
        values: The sample, shape (L,).
        rng: Source of the resampling.

    Returns:
        Estimates by the names of `STATISTICS`.
    """
    if len(values) < 2:
        figures = {name: float(each(values)) for name, each in STATISTICS.items()}
        return {name: Estimate(value, None, None) for name, value in figures.items()}
    drawn: dict[str, list[Array]] = {name: [] for name in STATISTICS}
    num_at_once = max(_NUM_AT_ONCE // len(values), 1)
    for start in range(0, _NUM_RESAMPLES, num_at_once):
        num = min(num_at_once, _NUM_RESAMPLES - start)
        samples = values[rng.integers(len(values), size=(num, len(values)))]
        for name, statistic in STATISTICS.items():
            drawn[name].append(statistic(samples))
    tail = (1.0 - _CONFIDENCE) / 2.0
    return {
        name: Estimate(
            float(statistic(values)),
            *np.quantile(np.concatenate(drawn[name]), [tail, 1.0 - tail]).tolist(),
        )
        for name, statistic in STATISTICS.items()
    }


def estimate_ratio(
    values: Array, others: Array, *, rng: np.random.Generator
) -> Estimate:
    """Estimate the ratio of two means of a paired sample, by the same bootstrap.

    Args:
        values: The sample above, shape (L,).
        others: The one below, of the same cases, shape (L,), of positive mean.
        rng: Source of the resampling.
    """
    ratio = float(values.mean() / others.mean())
    if len(values) < 2:
        return Estimate(ratio, None, None)
    drawn = rng.integers(len(values), size=(_NUM_RESAMPLES, len(values)))
    below = others[drawn].sum(axis=1)
    ratios = np.full(len(drawn), np.inf)
    np.divide(values[drawn].sum(axis=1), below, out=ratios, where=below > 0.0)
    tail = (1.0 - _CONFIDENCE) / 2.0
    # No interpolation: between infinite ones it would be NaN.
    low, high = np.quantile(ratios, [tail, 1.0 - tail], method="nearest").tolist()
    return (
        Estimate(ratio, low, high)
        if math.isfinite(high)
        else Estimate(ratio, None, None)
    )
