"""The method of the paper as plain loops: what the package is measured against.

Best placements by gradient ascent from random restarts, the posterior by a chain that
evaluates every RBF anew at each step, one number at a time. Among objects of true size
an ascent ends at the first one in its way, so that there it does less than the package
does, and misses more.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from tablesetting.irl.arrays import Array, normalize_l1
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import all_centers

_NUM_RESTARTS = 10
_NUM_STEPS = 50
_STEP_SIZE = 0.05

Rbf = tuple[float, float, float, float]
"""Weight, center x, center y and width of one RBF."""
Node = tuple[float, float, float]
"""Point x, point y and area of one term of a normaliser."""


def make_rbfs(weights: Array, layout: Array, widths: Array) -> list[Rbf]:
    """List the RBFs of a reward (D,) in a layout (K, 2)."""
    columns = np.column_stack([weights, all_centers(layout), widths])
    return [tuple(row) for row in columns.tolist()]


def reward(x: float, y: float, rbfs: Sequence[Rbf]) -> float:
    """Evaluate the reward of a placement."""
    total = 0.0
    for weight, center_x, center_y, width in rbfs:
        squared = (x - center_x) ** 2 + (y - center_y) ** 2
        total += weight * math.exp(-squared / width)
    return total


def gradient(x: float, y: float, rbfs: Sequence[Rbf]) -> tuple[float, float]:
    """Evaluate the gradient of the reward."""
    slope_x = slope_y = 0.0
    for weight, center_x, center_y, width in rbfs:
        dx, dy = x - center_x, y - center_y
        scale = -2.0 / width * weight * math.exp(-(dx**2 + dy**2) / width)
        slope_x += scale * dx
        slope_y += scale * dy
    return slope_x, slope_y


def best_placement(
    rbfs: Sequence[Rbf], space: FreeSpace, *, rng: np.random.Generator
) -> tuple[float, float]:
    """Climb from random free points, and keep the best end."""
    best, best_reward = (math.nan, math.nan), -math.inf
    for _ in range(_NUM_RESTARTS):
        x, y = _climb(_random_free_point(space, rng), rbfs, space)
        value = reward(x, y, rbfs)
        if value > best_reward:
            best, best_reward = (x, y), value
    return best


def log_likelihood(
    weights: Array,
    demos: Sequence[Demonstration],
    nodes: Sequence[Sequence[Node]],
    widths: Array,
    beta: float,
) -> float:
    """Evaluate the Boltzmann likelihood of weights (D,), demonstration by demonstration."""
    total = 0.0
    for demo, terms in zip(demos, nodes, strict=True):
        rbfs = make_rbfs(weights, demo.layout, widths)
        exponents = [beta * reward(x, y, rbfs) + math.log(area) for x, y, area in terms]
        peak = max(exponents)
        normaliser = sum(math.exp(exponent - peak) for exponent in exponents)
        x, y = demo.placement.tolist()
        total += beta * reward(x, y, rbfs) - peak - math.log(normaliser)
    return total


def run_chain(
    log_post: Callable[[Array], float],
    start: Array,
    num_steps: int,
    step_std: float,
    *,
    rng: np.random.Generator,
) -> list[Array]:
    """Sample weights from one Metropolis chain of fixed step, start of shape (D,)."""
    weights, current = start, log_post(start)
    states = []
    for _ in range(num_steps):
        proposal = normalize_l1(weights + step_std * rng.standard_normal(len(weights)))
        proposed = log_post(proposal)
        if math.log(rng.random()) < proposed - current:
            weights, current = proposal, proposed
        states.append(weights)
    return states


def _climb(
    start: tuple[float, float], rbfs: Sequence[Rbf], space: FreeSpace
) -> tuple[float, float]:
    x, y = start
    for _ in range(_NUM_STEPS):
        slope_x, slope_y = gradient(x, y, rbfs)
        next_x = min(max(x + _STEP_SIZE * slope_x, 0.0), 1.0)
        next_y = min(max(y + _STEP_SIZE * slope_y, 0.0), 1.0)
        if not _is_free(next_x, next_y, space):
            break
        x, y = next_x, next_y
    return x, y


def _random_free_point(
    space: FreeSpace, rng: np.random.Generator
) -> tuple[float, float]:
    while True:
        x, y = rng.random(2).tolist()
        if _is_free(x, y, space):
            return x, y


def _is_free(x: float, y: float, space: FreeSpace) -> bool:
    for (center_x, center_y), size in zip(space.centers, space.obstacles, strict=True):
        along = max(abs(y - center_y) - size.half_length, 0.0)
        if math.hypot(x - center_x, along) < size.radius:
            return False
    return True
