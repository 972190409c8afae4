"""What every strategy would have asked, on the same posterior and candidates."""

import numpy as np

from tablesetting.experiments.learning import LearningRound
from tablesetting.irl.strategies import STRATEGIES
from tablesetting.reward.files import layout_to_json

_STREAM = 1  # Of random numbers; the check of the fit has stream 0.


def audit_rows(latest: LearningRound, asked_by: str) -> list[dict[str, object]]:
    """Return one row for each strategy.

    Args:
        latest: The round.
        asked_by: The strategy whose query was asked.
    """
    learning, risk = latest.learning, latest.setup.problem.config.risk
    rows: list[dict[str, object]] = []
    for index, (name, strategy) in enumerate(STRATEGIES.items()):
        rng = latest.rng_for(_STREAM, index)
        scores = learning.scores
        if name != asked_by:
            scores = strategy(learning.outlook, risk, rng)
        best = int(np.argmax(scores))
        rows.append(
            {
                "num_demos": latest.num_demos,
                "strategy": name,
                "candidate": best,
                "score": float(scores[best]),
                "var": float(learning.var[best]),
                "var_rank": int((learning.var > learning.var[best]).sum()) + 1,
                "is_chosen": int(best == learning.query_index),
                **_layout_cells(latest, best),
            }
        )
    return rows


def _layout_cells(latest: LearningRound, candidate: int) -> dict[str, float]:
    """Say where the objects of a candidate layout stand."""
    objects = latest.setup.problem.task.objects
    layout = layout_to_json(latest.learning.candidates[candidate], objects)
    return {
        f"{name}_{axis}": value
        for name, place in layout.items()
        for axis, value in zip("xy", place, strict=True)
    }
