"""The search for the most probable weights, from the best sample of the chains."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.optimize import minimize

from tablesetting.irl.arrays import Array, normalize_l1
from tablesetting.irl.sampler import LogDensity

Gradient = Callable[[Array], Array]
"""Maps weights, shape (D,), to the gradient of a log density by them, shape (D,)."""

_BATCH = 64  # Proposals tried at once in a climb.
_FIRST_STEP = 0.03
_GROWTH, _SHRINKAGE = 1.2, 0.7  # After a step that was better, or not.
_TOLERANCE = 1e-9  # At which steps towards a maximum end [nats],
_LEAST_GAP = 1e-3  # what it may fall short by [nats],
_ROUNDING = 1e-6  # and its norm.


@runtime_checkable
class ConcaveLikelihood(Protocol):
    """A log likelihood that is concave in the weights, on the L1 sphere and off it."""

    def concave_gradient(self, state: Array) -> Array:
        """Differentiate by the weights of a state, shape (D + E,), as shape (D,)."""
        ...


def find_map(
    log_post: LogDensity,
    start: Array,
    num_steps: int,
    *,
    gradient: Gradient | None = None,
    rng: np.random.Generator,
) -> Array:
    """Search for the most probable weights from a good sample.

    On the sphere even a concave log posterior has a mode on many faces. Over the ball,
    which is convex, its maximum is one, but for weights that make no difference; where
    that is on the sphere, it is the MAP, wherever the search began. Where it is inside,
    or was not reached, the search climbs on from it, to a mode nearby.

    Args:
        log_post: Log posterior of a batch of weights.
        start: Where to begin, shape (D,), of unit L1 norm.
        num_steps: Most steps to take.
        gradient: Its gradient, where it is concave in weights of any norm.
        rng: Source of what is tried in a climb.

    Returns:
        Weights of unit L1 norm at least as probable as the start, shape (D,).
    """
    if gradient is not None:
        found = maximize_on_ball(log_post, gradient, start, num_steps)
        norm = np.abs(found).sum()
        values = log_post(np.array([found / max(norm, _ROUNDING), start]))
        if values[0] >= values[1]:
            start = found / norm
            is_outermost = norm > 1.0 - _ROUNDING
            if is_outermost and _shortfall(gradient(start), start) < _LEAST_GAP:
                return start
    return climb_to_map(log_post, start, num_steps, rng=rng)


def _shortfall(gradient: Array, weights: Array) -> float:
    """Bound how far a concave function is below its maximum over the L1 ball.

    By the tangent plane, which is highest at a vertex (the duality gap of Frank and
    Wolfe, Jaggi 2013).
    """
    return float(np.abs(gradient).max() - gradient @ weights)


def maximize_on_ball(
    log_post: LogDensity, gradient: Gradient, start: Array, num_steps: int
) -> Array:
    """Maximise a concave function of weights whose L1 norm is 1 at most.

    Their positive and negative parts, which add up to 1 (both may be positive), make
    the ball a simplex (Tibshirani 1996, of the lasso); sequential quadratic programming
    keeps to it.

    Args:
        log_post: The function, of a batch of weights.
        gradient: Its gradient.
        start: Where to begin, shape (D,), of unit L1 norm.
        num_steps: Most steps to take.

    Returns:
        The weights, shape (D,).
    """
    dim = len(start)

    def value_and_gradient(parts: Array) -> tuple[float, Array]:
        weights = parts[:dim] - parts[dim:]
        slope = gradient(weights)
        return -float(log_post(weights[None])[0]), np.concatenate([-slope, slope])

    found = minimize(
        value_and_gradient,
        np.concatenate([np.maximum(start, 0.0), np.maximum(-start, 0.0)]),
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * (2 * dim),
        constraints={
            "type": "eq",
            "fun": lambda parts: parts.sum() - 1.0,
            "jac": np.ones_like,
        },
        options={"maxiter": num_steps, "ftol": _TOLERANCE},
    )
    parts: Array = found.x
    return parts[:dim] - parts[dim:]


def climb_to_map(
    log_post: LogDensity,
    start: Array,
    num_steps: int,
    *,
    rng: np.random.Generator,
) -> Array:
    """Climb from a good sample to a mode nearby by a random search.

    The best of many samples in a dozen dimensions is still well below the mode. Each
    step takes the best of a batch of proposals of mixed sizes; the sizes grow after a
    step that was better and shrink where none is. No derivatives are needed, nor does
    the search mind the edges of the L1 sphere, where sparse rewards lie.

    Args:
        log_post: Log posterior of a batch of weights.
        start: Where to begin, shape (D,), of unit L1 norm.
        num_steps: Batches to try.
        rng: Source of the proposals.

    Returns:
        Weights at least as probable as the start, shape (D,).
    """
    best, best_value, step = start, log_post(start[None])[0], _FIRST_STEP
    for _ in range(num_steps):
        sizes = step * rng.lognormal(-0.5, 1.0, size=(_BATCH, 1))
        noise = rng.standard_normal((_BATCH, len(start)))
        proposals = normalize_l1(best + sizes * noise)
        values = log_post(proposals)
        index = int(values.argmax())
        if values[index] > best_value:
            best, best_value = proposals[index], values[index]
            step *= _GROWTH
        else:
            step *= _SHRINKAGE
    return best
