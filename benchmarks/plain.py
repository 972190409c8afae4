"""The method of the paper as plain loops: what the package is measured against.

Best placements by gradient ascent from random restarts, the posterior by a chain that
evaluates every RBF anew at each step, one number at a time. The paper's item may stand
anywhere; where it must fit, an ascent would end at the first object in its way, so that
scans take its place.
"""

import math
from collections.abc import Callable, Sequence
from statistics import fmean

import numpy as np

from tablesetting.irl.arrays import Array, normalize_l1
from tablesetting.reward.free_space import FreeSpace
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.rbf import all_centers

_NUM_RESTARTS = 10
_NUM_STEPS = 50
_STEP_SIZE = 0.05
_SCANS = ((0.5, 25), (0.02, 5))  # Half width, and steps each way, of each scan.

Rbf = tuple[float, float, float, float]
"""Weight, center x, center y and width of one RBF."""
Node = tuple[float, float]
"""Point x and point y of one term of a normaliser."""


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
    rbfs: Sequence[Rbf], *, rng: np.random.Generator
) -> tuple[float, float]:
    """Climb from random points, and keep the best end."""
    best, best_reward = (math.nan, math.nan), -math.inf
    for _ in range(_NUM_RESTARTS):
        x, y = _climb(rng.random(), rng.random(), rbfs)
        value = reward(x, y, rbfs)
        if value > best_reward:
            best, best_reward = (x, y), value
    return best


def best_free_placement(rbfs: Sequence[Rbf], space: FreeSpace) -> tuple[float, float]:
    """Scan the square for the best point where the item fits, then closer around it."""
    best = (0.5, 0.5)
    for half_width, num_steps in _SCANS:
        points = _lattice(best, half_width, num_steps)
        free = [(x, y) for x, y in points if _is_free(x, y, space)]
        best = max(free, key=lambda point: reward(point[0], point[1], rbfs))
    return best


def log_likelihood(
    weights: Array,
    demos: Sequence[Demonstration],
    nodes: Sequence[Node],
    widths: Array,
    beta: float,
) -> float:
    """Evaluate the Boltzmann likelihood of weights (D,), demonstration by demonstration."""
    total = 0.0
    for demo in demos:
        rbfs = make_rbfs(weights, demo.layout, widths)
        exponents = [beta * reward(x, y, rbfs) for x, y in nodes]
        peak = max(exponents)
        normaliser = fmean(math.exp(exponent - peak) for exponent in exponents)
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


def _climb(x: float, y: float, rbfs: Sequence[Rbf]) -> tuple[float, float]:
    for _ in range(_NUM_STEPS):
        slope_x, slope_y = gradient(x, y, rbfs)
        x = min(max(x + _STEP_SIZE * slope_x, 0.0), 1.0)
        y = min(max(y + _STEP_SIZE * slope_y, 0.0), 1.0)
    return x, y


def _lattice(
    center: tuple[float, float], half_width: float, num_steps: int
) -> list[tuple[float, float]]:
    """List the points of a lattice that are on the square."""
    offsets = [
        half_width * step / num_steps for step in range(-num_steps, num_steps + 1)
    ]
    points = [(center[0] + dx, center[1] + dy) for dx in offsets for dy in offsets]
    return [(x, y) for x, y in points if 0.0 <= x <= 1.0 and 0.0 <= y <= 1.0]


def _is_free(x: float, y: float, space: FreeSpace) -> bool:
    for (center_x, center_y), size in zip(space.centers, space.obstacles, strict=True):
        along = max(abs(y - center_y) - size.half_length, 0.0)
        if math.hypot(x - center_x, along) < size.radius:
            return False
    return True
