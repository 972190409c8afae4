"""The paper's curves of the table task, and how far ours are from them."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tablesetting.curves import Curve, CurveKey, Curves, read_published

_PATH = Path(__file__).with_name("published_placement.csv")
_NUM_TRIALS = 100


@cache
def published_curves() -> dict[CurveKey, Curve]:
    """Return the curves of the figure on vase and spoon in Brown, Cui and Niekum (2018).

    The points and error bars, of half a standard deviation, are the plot data in the
    LaTeX source of the paper.
    """
    return read_published(_PATH, _NUM_TRIALS)


class Difference(NamedTuple):
    """A published point and ours.

    Attributes:
        key: Task, strategy and quantity.
        num_demos: After how many demonstrations.
        published: Mean of the paper.
        ours: Our mean.
        bars: Their distance in error bars of the paper.
    """

    key: CurveKey
    num_demos: int
    published: float
    ours: float
    bars: float

    @property
    def is_within_bar(self) -> bool:
        """Whether ours is within the published error bar."""
        return self.bars <= 1.0


def differences(ours: Curves, published: Curves) -> Iterator[Difference]:
    """Compare every published point that there is one of ours for."""
    for key, curve in published.items():
        if key not in ours:
            continue
        found = dict(zip(ours[key].num_demos, ours[key].means, strict=True))
        points = zip(curve.num_demos, curve.means, curve.half_stds, strict=True)
        for num_demos, mean, bar in points:
            if num_demos in found:
                bars = abs(found[num_demos] - mean) / bar
                yield Difference(
                    key,
                    int(num_demos),
                    float(mean),
                    float(found[num_demos]),
                    float(bars),
                )
