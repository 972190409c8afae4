"""What was learned from recorded demonstrations, in words."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tablesetting.experiments.learn_files import NEXT_LAYOUT
from tablesetting.experiments.learning import LearningRound


def tell_learned(last: LearningRound, out: Path) -> Iterator[str]:
    """Tell line by line what was learned, how sure that is, and what to ask next."""
    setup, learning = last.setup, last.learning
    task, bound = setup.problem.task, last.bound
    yield (
        f"learned from {last.num_demos} demonstration{'s' * (last.num_demos > 1)} of "
        f"{task.name}: the bound on the loss is {bound.value:.3f} over "
        f"{bound.num_situations} layouts ({setup.distribution}), to be below "
        f"{setup.epsilon:g}"
    )
    if last.doubts:
        yield "not certified:"
        yield from (f"  {doubt}" for doubt in last.doubts)
    else:
        yield "certified: see certificate.json"
    risk = learning.var[learning.query_index]
    rank = int((learning.var > risk).sum()) + 1
    places = ", ".join(
        f"{name} ({x:.3f}, {y:.3f})"
        for name, (x, y) in zip(task.objects, np.asarray(learning.query), strict=True)
    )
    yield f"ask next about: {places}"
    yield (
        f"  its value at risk is {risk:.3f}, rank {rank} of {len(learning.var)} "
        f"candidates; the layout is in {out / NEXT_LAYOUT}"
    )
    yield f"weights: {out / 'weights.json'}"
