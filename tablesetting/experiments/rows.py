"""Cells of rounds.csv that a run and a study share."""

from typing import Any

from tablesetting.experiments.learning import LearningRound
from tablesetting.irl.active import Round

_DIGITS = 9  # Below any error that means something.


def learning_cells(latest: LearningRound) -> dict[str, object]:
    """Return what is known after a number of demonstrations."""
    return {
        "num_demos": latest.num_demos,
        "mean_placement_error": float(latest.errors.mean()),
        "max_placement_error": float(latest.errors.max()),
        **posterior_cells(latest),
    }


def posterior_cells(latest: LearningRound) -> dict[str, object]:
    """Return what is known without the person's true preference."""
    posterior = latest.learning.posterior
    return {
        "var_bound": latest.learning.var_bound,
        "ess": posterior.ess,
        "rhat": posterior.rhat,
        "acceptance_rate": posterior.acceptance_rate,
    }


def seconds_cells(learning: Round[Any, Any]) -> dict[str, object]:
    """Return how long the parts of a round took."""
    return {
        "inference_seconds": learning.inference_seconds,
        "query_seconds": learning.query_seconds,
    }


def rounded(row: dict[str, object]) -> dict[str, object]:
    """Round every number of a row; adding 0.0 makes -0.0 plain zero."""
    return {
        name: round(float(value), _DIGITS) + 0.0 if isinstance(value, float) else value
        for name, value in row.items()
    }
