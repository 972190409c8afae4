"""Compiled inner loops of the likelihood and of the best placement.

The machine code is cached beside this file: only the first use of an installation
compiles. All kernels share this one module, as a cached kernel does not notice a change
to one that it calls in another. The tests hold each against plain code.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit

from tablesetting.irl.arrays import Array

# Sums and maxima in any order, which lets them run in SIMD lanes; the compiler fixes it.
_ANY_ORDER = ("reassoc", "contract", "nsz", "nnan")

_LOG2_E = 1.4426950408889634
_LN2_HIGH, _LN2_LOW = 0.693145751953125, 1.4286068203094172e-6  # 12 bits, and the rest.
_SHIFTER = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to a whole number.
_EXPONENT_OF_ONE = 1023 << 52
_LEAST = -708.0  # The exponential of less is denormal.

_MAX_ITERATIONS = 60
_STEP_TOL = 1e-11  # [table units]
_LAST_STEP = 1e-6  # [table units]; the next would be of about its square, unless
_LEAST_TRUSTED = 1e-6  # the Hessian is shifted by more.
_ROUNDING = 1e-15  # Of a reward.
_MAX_STEP = 0.1  # [table units]
_NUM_TABLE_CENTERS = 9

FunctionT = TypeVar("FunctionT", bound=Callable[..., Any])


def _compiled(*fastmath: str) -> Callable[[FunctionT], FunctionT]:
    """Let numba compile a function, and keep the machine code where that can be."""

    def compile_function(function: FunctionT) -> Any:
        try:
            return njit(cache=True, fastmath=set(fastmath))(function)
        except RuntimeError:  # Neither this folder nor the user's own can be written.
            return njit(fastmath=set(fastmath))(function)

    return compile_function


@_compiled("contract")  # In any order, the rounding would cancel.
def exp_of_negative(x: float) -> float:
    """Evaluate exp(x) for x <= 0 to 1e-14; in loops, unlike math.exp, in SIMD lanes.

    Range reduction after Cody and Waite, *Software Manual for the Elementary Functions*
    (1980), then the Taylor series.
    """
    x = max(x, _LEAST)
    shifted = x * _LOG2_E + _SHIFTER
    whole = shifted - _SHIFTER
    rest = (x - whole * _LN2_HIGH) - whole * _LN2_LOW
    series = 1.0 / 39916800.0
    series = series * rest + 1.0 / 3628800.0
    series = series * rest + 1.0 / 362880.0
    series = series * rest + 1.0 / 40320.0
    series = series * rest + 1.0 / 5040.0
    series = series * rest + 1.0 / 720.0
    series = series * rest + 1.0 / 120.0
    series = series * rest + 1.0 / 24.0
    series = series * rest + 1.0 / 6.0
    series = series * rest + 0.5
    series = series * rest + 1.0
    series = series * rest + 1.0
    exponent = (np.float64(shifted).view(np.int64) << 52) + np.int64(_EXPONENT_OF_ONE)
    return series * np.int64(exponent).view(np.float64)


class ChoiceFeatures(NamedTuple):
    """What the Boltzmann likelihood knows of the demonstrations.

    Attributes:
        beta: Rationality of the demonstrator.
        shown: Features of all placements that were shown, added up, shape (F,).
        table: Features of the nodes that the table's RBFs give, shape (9, G).
        objects: Those that the objects' give in each demonstration, shape (D, K, G).
    """

    beta: float
    shown: Array
    table: Array
    objects: Array


@_compiled(*_ANY_ORDER)
def _log_likelihood(
    weights: Array, features: ChoiceFeatures, on_table: Array, exponents: Array
) -> float:
    """Evaluate one log likelihood; the last two arguments are scratch, shape (G,)."""
    beta, objects = features.beta, features.objects
    num_demos, num_objects, num_nodes = objects.shape
    shown = 0.0
    for i in range(len(weights)):
        shown += weights[i] * features.shown[i]
    total = beta * shown
    on_table[:] = 0.0  # The same in every demonstration.
    for i in range(len(features.table)):
        weight = beta * weights[num_objects + i]
        for g in range(num_nodes):
            on_table[g] += weight * features.table[i, g]
    for d in range(num_demos):
        exponents[:] = on_table
        for k in range(num_objects):
            weight = beta * weights[k]
            for g in range(num_nodes):
                exponents[g] += weight * objects[d, k, g]
        peak = exponents[0]
        for g in range(num_nodes):
            peak = max(peak, exponents[g])
        mass = 0.0
        for g in range(num_nodes):
            mass += exp_of_negative(exponents[g] - peak)
        total -= peak + np.log(mass / num_nodes)
    return total


@_compiled()
def log_likelihoods(weights: Array, features: ChoiceFeatures) -> Array:
    """Evaluate the log likelihoods of weights, shape (C, F), as shape (C,)."""
    num_nodes = features.table.shape[1]
    on_table, exponents = np.empty(num_nodes), np.empty(num_nodes)
    values = np.empty(len(weights))
    for c in range(len(weights)):
        values[c] = _log_likelihood(weights[c], features, on_table, exponents)
    return values


@_compiled()
def walk(
    start: Array,
    start_log_posts: Array,
    steps: Array,
    squared_noise: Array,
    log_uniforms: Array,
    is_prior_uniform: bool,
    features: ChoiceFeatures,
) -> tuple[Array, Array, Array]:
    """Take Metropolis-Hastings steps as `irl.sampler.walk` does, and return the same."""
    num_steps, num_chains, dim = steps.shape
    num_nodes = features.table.shape[1]
    on_table, exponents = np.empty(num_nodes), np.empty(num_nodes)
    states = np.empty(steps.shape)
    log_posts, log_ratios = np.empty((2, num_steps, num_chains))
    weights, proposal = np.empty(dim), np.empty(dim)
    for c in range(num_chains):
        weights[:] = start[c]
        log_post = start_log_posts[c]
        for s in range(num_steps):
            norm = 0.0
            for i in range(dim):
                proposal[i] = weights[i] + steps[s, c, i]
                norm += abs(proposal[i])
            for i in range(dim):
                proposal[i] /= norm
            proposed = _log_likelihood(proposal, features, on_table, exponents)
            log_ratio = proposed - log_post
            if is_prior_uniform:
                log_ratio -= 2 * dim * np.log(norm)
                log_ratio -= 0.5 * squared_noise[s, c] * (norm**-2 - 1.0)
            if log_uniforms[s, c] < log_ratio:
                weights[:] = proposal
                log_post = proposed
            states[s, c] = weights
            log_posts[s, c] = log_post
            log_ratios[s, c] = log_ratio
    return states, log_posts, log_ratios


@_compiled(*_ANY_ORDER)
def _derivatives(
    x: float, y: float, weights: Array, centers: Array, sharpness: Array
) -> tuple[float, float, float, float, float, float]:
    """Return R, dR/dx, dR/dy, d2R/dx2, d2R/dy2 and d2R/dxdy at one point."""
    reward = slope_x = slope_y = isotropic = bend_x = bend_y = cross = 0.0
    for i in range(len(weights)):
        dx, dy = x - centers[0, i], y - centers[1, i]
        term = weights[i] * exp_of_negative(-(dx * dx + dy * dy) * sharpness[i])
        scaled = -2.0 * sharpness[i] * term
        curved = -2.0 * sharpness[i] * scaled
        reward += term
        slope_x += scaled * dx
        slope_y += scaled * dy
        isotropic += scaled
        bend_x += curved * dx * dx
        bend_y += curved * dy * dy
        cross += curved * dx * dy
    return reward, slope_x, slope_y, isotropic + bend_x, isotropic + bend_y, cross


@_compiled()
def _newton_step(
    x: float,
    y: float,
    slope_x: float,
    slope_y: float,
    bend_x: float,
    bend_y: float,
    cross: float,
    damping: float,
) -> tuple[float, float]:
    """Solve for the step with a Hessian that is shifted until it is negative definite."""
    is_x_held = (x <= 0.0 and slope_x < 0.0) or (x >= 1.0 and slope_x > 0.0)
    is_y_held = (y <= 0.0 and slope_y < 0.0) or (y >= 1.0 and slope_y > 0.0)
    if is_x_held or is_y_held:
        cross = 0.0
    if is_x_held:
        slope_x, bend_x = 0.0, -1.0
    if is_y_held:
        slope_y, bend_y = 0.0, -1.0
    spread = 0.5 * (bend_x - bend_y)
    largest = 0.5 * (bend_x + bend_y) + np.sqrt(spread * spread + cross * cross)
    shift = max(largest, 0.0) + damping
    first, second = shift - bend_x, shift - bend_y
    determinant = max(first * second - cross * cross, 1e-300)
    step_x = (second * slope_x + cross * slope_y) / determinant
    step_y = (cross * slope_x + first * slope_y) / determinant
    return step_x, step_y


@_compiled()
def _climb(
    x: float,
    y: float,
    weights: Array,
    centers: Array,
    sharpness: Array,
    max_step: float,
) -> tuple[float, float, float]:
    """Climb to a local maximum on the unit square; return it and its reward.

    The shift follows how well the quadratic model foretold the last step.
    """
    here = _derivatives(x, y, weights, centers, sharpness)
    damping = 1e-6
    for _ in range(_MAX_ITERATIONS):
        reward, slope_x, slope_y, bend_x, bend_y, cross = here
        step_x, step_y = _newton_step(
            x, y, slope_x, slope_y, bend_x, bend_y, cross, damping
        )
        length = max(abs(step_x), abs(step_y), _STEP_TOL)
        scale = min(1.0, max_step / length)
        next_x = min(max(x + scale * step_x, 0.0), 1.0)
        next_y = min(max(y + scale * step_y, 0.0), 1.0)
        is_whole = next_x == x + step_x and next_y == y + step_y
        step_x, step_y = next_x - x, next_y - y
        expected = step_x * (slope_x + 0.5 * bend_x * step_x + cross * step_y)
        expected += step_y * (slope_y + 0.5 * bend_y * step_y)
        if is_whole and length <= _LAST_STEP and damping <= _LEAST_TRUSTED:
            return next_x, next_y, reward + expected
        if max(abs(step_x), abs(step_y)) <= _STEP_TOL:
            break
        there = _derivatives(next_x, next_y, weights, centers, sharpness)
        gain = there[0] - reward
        # Cut off at an edge, a step may lead down, and the model foretell it.
        if gain < 0.25 * expected - _ROUNDING or expected < -_ROUNDING:
            damping = max(10.0 * damping, 1e-3)
        elif gain > 0.75 * expected - _ROUNDING:
            damping = max(damping / 10.0, 1e-9)
        if gain >= -_ROUNDING:
            x, y, here = next_x, next_y, there
    return x, y, here[0]


@_compiled()
def climb(
    starts: Array, weights: Array, centers: Array, sharpness: Array, max_step: float
) -> tuple[Array, Array]:
    """Climb from each start, shape (S, 2); centers are of shape (S, 2, D)."""
    points, rewards = np.empty(starts.shape), np.empty(len(starts))
    for s in range(len(starts)):
        x, y = starts[s]
        x, y, reward = _climb(x, y, weights[s], centers[s], sharpness, max_step)
        points[s, 0], points[s, 1], rewards[s] = x, y, reward
    return points, rewards


@_compiled()
def _climb_seeing_inland(
    x: float,
    y: float,
    weights: Array,
    centers: Array,
    sharpness: Array,
    pitch: float,
) -> tuple[float, float, float]:
    """Climb from a point of the grid; from an edge, look for a higher optimum inland.

    Where the reward falls from the edge inwards but bends up, it may have an optimum
    between the edge and the next lines of the grid, on which it is lower than at the edge.
    """
    best = _climb(x, y, weights, centers, sharpness, _MAX_STEP)
    x, y, _ = best
    if 0.0 < x < 1.0 and 0.0 < y < 1.0:
        return best
    _, slope_x, slope_y, bend_x, bend_y, _ = _derivatives(
        x, y, weights, centers, sharpness
    )
    for is_along_x in (True, False):
        at, slope, bend = (x, slope_x, bend_x) if is_along_x else (y, slope_y, bend_y)
        if 0.0 < at < 1.0 or bend <= 0.0:
            continue
        inwards = 1.0 if at == 0.0 else -1.0
        # By the quadratic model, it is as high again at this distance.
        distance = -2.0 * inwards * slope / bend
        if not 0.0 <= distance < 2.0 * pitch:
            continue
        shift = inwards * max(distance, 0.5 * pitch)
        start_x = x + shift if is_along_x else x
        start_y = y if is_along_x else y + shift
        inland = _climb(start_x, start_y, weights, centers, sharpness, _MAX_STEP)
        if inland[2] > best[2]:
            best = inland
    return best


@_compiled(*_ANY_ORDER)
def _fill_grid(
    values: Array, on_table: Array, weights: Array, objects: Array, peaks: Array
) -> float:
    """Add up the rewards on the grid, shape (G,), and note the highest of each row.

    Returns:
        The highest of all.
    """
    values[:] = on_table
    for k in range(len(objects)):
        weight = weights[k]
        for g in range(len(values)):
            values[g] += weight * objects[k, g]
    size = len(peaks)
    highest = -np.inf
    for row in range(size):
        peak = values[row * size]
        for g in range(row * size, (row + 1) * size):
            peak = max(peak, values[g])
        peaks[row] = peak
        highest = max(highest, peak)
    return highest


@_compiled()
def _grid_features(
    features: Array, centers: Array, sharpness: Array, ticks: Array
) -> None:
    """Write what the objects' RBFs are on the grid, shape (K, G), from their factors."""
    size = len(ticks)
    along = np.empty(size)
    for k in range(len(features)):
        for column in range(size):
            dx = ticks[column] - centers[0, k]
            along[column] = exp_of_negative(-dx * dx * sharpness[k])
        for row in range(size):
            dy = ticks[row] - centers[1, k]
            across = exp_of_negative(-dy * dy * sharpness[k])
            for column in range(size):
                features[k, row * size + column] = across * along[column]


@_compiled()
def _is_grid_maximum(values: Array, row: int, column: int, size: int) -> bool:
    """Tell whether no neighbour of a point of the grid is higher."""
    index = row * size + column
    value = values[index]
    if column > 0 and values[index - 1] > value:
        return False
    if column < size - 1 and values[index + 1] > value:
        return False
    if row > 0 and values[index - size] > value:
        return False
    return row == size - 1 or values[index + size] <= value


@_compiled()
def best_on_square(
    weights: Array,
    centers: Array,
    sharpness: Array,
    ticks: Array,
    on_table: Array,
    margins: Array,
) -> Array:
    """Find the global maximum of every reward in every layout.

    Args:
        weights: Reward weights, shape (N, D).
        centers: RBF centers in each layout, the objects' first, shape (L, 2, D).
        sharpness: Inverse width of each RBF, shape (D,).
        ticks: The grid's coordinates along either side, increasing.
        on_table: What the table's RBFs add to each reward on the grid, shape (N, G).
        margins: How far below the best point of the grid a climb may begin, shape (N,).

    Returns:
        Points, shape (L, N, 2), in table units.
    """
    num_layouts, num_samples, size = len(centers), len(weights), len(ticks)
    best = np.full((num_layouts, num_samples, 2), np.nan)
    objects = np.empty((centers.shape[2] - _NUM_TABLE_CENTERS, size * size))
    values, peaks = np.empty(size * size), np.empty(size)
    for layout in range(num_layouts):
        _grid_features(objects, centers[layout], sharpness, ticks)
        for n in range(num_samples):
            peak = _fill_grid(values, on_table[n], weights[n], objects, peaks)
            floor = peak - margins[n]
            highest = -np.inf
            for row in range(size):
                if peaks[row] < floor:
                    continue
                for column in range(size):
                    if values[row * size + column] < floor:
                        continue
                    if not _is_grid_maximum(values, row, column, size):
                        continue
                    x, y = ticks[column], ticks[row]
                    x, y, reward = _climb_seeing_inland(
                        x, y, weights[n], centers[layout], sharpness, ticks[1]
                    )
                    if reward > highest:
                        highest = reward
                        best[layout, n, 0], best[layout, n, 1] = x, y
    return best
