"""Compiled inner loops of the likelihood and of the best placement.

The machine code is cached beside this file: only the first use of an installation
compiles. All kernels share this one module, as a cached kernel does not notice a change
to one that it calls in another. The tests hold each against plain code.
"""

from typing import NamedTuple

import numpy as np

from tablesetting.compiling import compiled
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


@compiled("contract")  # In any order, the rounding would cancel.
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
        beta: Rationality of the demonstrator, the prior's median where it is sampled.
        beta_spread: Prior standard deviation of its logarithm; 0 where it is fixed.
        log_shares: Logarithm of each node's share of the square, shape (G,).
        shown: Features of all placements that were shown, added up, shape (D,).
        table: Features of the nodes that the table's RBFs give, shape (9, G).
        objects: Those that the objects' give in each demonstration, shape (M, K, G).
    """

    beta: float
    beta_spread: float
    log_shares: Array
    shown: Array
    table: Array
    objects: Array


@compiled(*_ANY_ORDER)
def _log_likelihood(
    state: Array, features: ChoiceFeatures, on_table: Array, exponents: Array
) -> float:
    """Evaluate one log likelihood; the last two arguments are scratch, shape (G,).

    Where beta is sampled, its logarithm follows the weights in a state.
    """
    objects, dim = features.objects, len(features.shown)
    num_demos, num_objects, num_nodes = objects.shape
    beta = np.exp(state[dim]) if features.beta_spread > 0.0 else features.beta
    shown = 0.0
    for i in range(dim):
        shown += state[i] * features.shown[i]
    total = beta * shown
    on_table[:] = features.log_shares  # The same in every demonstration.
    for i in range(len(features.table)):
        weight = beta * state[num_objects + i]
        for g in range(num_nodes):
            on_table[g] += weight * features.table[i, g]
    for d in range(num_demos):
        exponents[:] = on_table
        for k in range(num_objects):
            weight = beta * state[k]
            for g in range(num_nodes):
                exponents[g] += weight * objects[d, k, g]
        peak = exponents[0]
        for g in range(num_nodes):
            peak = max(peak, exponents[g])
        mass = 0.0
        for g in range(num_nodes):
            mass += exp_of_negative(exponents[g] - peak)
        total -= peak + np.log(mass)
    return total


@compiled()
def log_likelihoods(states: Array, features: ChoiceFeatures) -> Array:
    """Evaluate the log likelihoods of states, shape (C, D + E), as shape (C,)."""
    num_nodes = features.table.shape[1]
    on_table, exponents = np.empty(num_nodes), np.empty(num_nodes)
    values = np.empty(len(states))
    for c in range(len(states)):
        values[c] = _log_likelihood(states[c], features, on_table, exponents)
    return values


@compiled()
def log_normal(logarithm: float, median: float, spread: float) -> float:
    """Evaluate what `irl.sampler.LogNormal.log_density` does."""
    surprise = (logarithm - np.log(median)) / spread
    return -0.5 * surprise**2 if abs(surprise) <= 2.0 else -np.inf


@compiled()
def walk(
    start: Array,
    start_log_likelihoods: Array,
    steps: Array,
    squared_noise: Array,
    log_uniforms: Array,
    is_prior_uniform: bool,
    power: float,
    features: ChoiceFeatures,
) -> tuple[Array, Array, Array]:
    """Take Metropolis-Hastings steps as `irl.random_walk.walk`, and return the same."""
    num_steps, num_chains, width = steps.shape
    dim, num_nodes = len(features.shown), features.table.shape[1]
    on_table, exponents = np.empty(num_nodes), np.empty(num_nodes)
    states = np.empty(steps.shape)
    log_likelihoods, log_ratios = np.empty((2, num_steps, num_chains))
    state, proposal = np.empty(width), np.empty(width)
    for c in range(num_chains):
        state[:] = start[c]
        here = start_log_likelihoods[c]
        for s in range(num_steps):
            norm = 0.0
            for i in range(width):
                proposal[i] = state[i] + steps[s, c, i]
                norm += abs(proposal[i]) if i < dim else 0.0
            for i in range(dim):
                proposal[i] /= norm
            there = _log_likelihood(proposal, features, on_table, exponents)
            log_ratio = power * (there - here)
            if width > dim:
                median, spread = features.beta, features.beta_spread
                log_ratio += log_normal(proposal[dim], median, spread)
                log_ratio -= log_normal(state[dim], median, spread)
            if is_prior_uniform:
                log_ratio -= 2 * dim * np.log(norm)
                log_ratio -= 0.5 * squared_noise[s, c] * (norm**-2 - 1.0)
            if log_uniforms[s, c] < log_ratio:
                state[:] = proposal
                here = there
            states[s, c] = state
            log_likelihoods[s, c] = here
            log_ratios[s, c] = log_ratio
    return states, log_likelihoods, log_ratios


@compiled(*_ANY_ORDER)
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


@compiled()
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


@compiled()
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


@compiled()
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


@compiled()
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


@compiled(*_ANY_ORDER)
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


@compiled()
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


@compiled()
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


@compiled()
def _best_in_layout(
    weights: Array,
    centers: Array,
    sharpness: Array,
    ticks: Array,
    on_table: Array,
    objects: Array,
    margin: float,
    values: Array,
    peaks: Array,
) -> tuple[float, float]:
    """Find the global maximum of one reward in one layout; the last two are scratch."""
    size = len(ticks)
    floor = _fill_grid(values, on_table, weights, objects, peaks) - margin
    best_x = best_y = np.nan
    highest = -np.inf
    for row in range(size):
        if peaks[row] < floor:
            continue
        for column in range(size):
            if values[row * size + column] < floor:
                continue
            if not _is_grid_maximum(values, row, column, size):
                continue
            x, y, reward = _climb_seeing_inland(
                ticks[column], ticks[row], weights, centers, sharpness, ticks[1]
            )
            if reward > highest:
                highest, best_x, best_y = reward, x, y
    return best_x, best_y


@compiled()
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
            x, y = _best_in_layout(
                weights[n],
                centers[layout],
                sharpness,
                ticks,
                on_table[n],
                objects,
                margins[n],
                values,
                peaks,
            )
            best[layout, n, 0], best[layout, n, 1] = x, y
    return best


class AnswerFeatures(NamedTuple):
    """What the placement likelihood knows of the demonstrations.

    Attributes:
        noise_std: Standard deviation of the placements, in table units; the prior's
            median where it is sampled.
        noise_spread: Prior standard deviation of its logarithm; 0 where it is fixed.
        log_constant: What the log likelihood has beside errors and noise.
        placements: What was shown, shape (M, 2).
        centers: RBF centers in each demonstration, the objects' first, shape (M, 2, D).
        sharpness: Inverse width of each RBF, shape (D,).
        ticks: The grid's coordinates along either side.
        table: What the table's RBFs are on the grid, shape (9, G).
        objects: What the objects' are in each demonstration, shape (M, K, G).
        margin: How far below the best point of the grid a climb may begin.
    """

    noise_std: float
    noise_spread: float
    log_constant: float
    placements: Array
    centers: Array
    sharpness: Array
    ticks: Array
    table: Array
    objects: Array
    margin: float


class LocalProposals(NamedTuple):
    """The random numbers of S steps of C chains on ridges.

    Attributes:
        noise: Standard normal numbers, shape (S, C, D).
        kinds: `LOCAL`, `ISOTROPIC` or the coordinate that alone moves, shape (S, C).
        scales: Size of each step, shape (S, C).
        log_uniforms: Logarithms of uniform numbers, shape (S, C).
        std_noise: Steps of the logarithm of the noise, shape (S, C).
        std_log_uniforms: Logarithms of uniform numbers for these, shape (S, C).
    """

    noise: Array
    kinds: Array
    scales: Array
    log_uniforms: Array
    std_noise: Array
    std_log_uniforms: Array


LOCAL, ISOTROPIC = -1, -2
_FLATTEST = 0.02  # Added to the curvature at an optimum, which may vanish.


@compiled(*_ANY_ORDER)
def _fill_table(on_table: Array, weights: Array, table: Array) -> None:
    """Add up what the table's RBFs give on the grid, shape (G,)."""
    num_objects = len(weights) - len(table)
    on_table[:] = 0.0
    for i in range(len(table)):
        weight = weights[num_objects + i]
        for g in range(len(on_table)):
            on_table[g] += weight * table[i, g]


@compiled()
def _squared_error(
    weights: Array,
    features: AnswerFeatures,
    optima: Array,
    on_table: Array,
    values: Array,
    peaks: Array,
) -> float:
    """Find the best placement in every demonstration; return the squared distances' sum.

    Args:
        weights: Reward weights, shape (D,).
        features: The demonstrations.
        optima: Where the placements go, shape (M, 2).
        on_table: Scratch, shape (G,).
        values: Scratch, shape (G,).
        peaks: Scratch, shape (T,).
    """
    _fill_table(on_table, weights, features.table)
    total = 0.0
    for d in range(len(optima)):
        x, y = _best_in_layout(
            weights,
            features.centers[d],
            features.sharpness,
            features.ticks,
            on_table,
            features.objects[d],
            features.margin,
            values,
            peaks,
        )
        optima[d, 0], optima[d, 1] = x, y
        total += (x - features.placements[d, 0]) ** 2
        total += (y - features.placements[d, 1]) ** 2
    return total


@compiled()
def answer_log_likelihoods(states: Array, features: AnswerFeatures) -> Array:
    """Evaluate the log likelihoods of states, shape (C, D + E), as shape (C,)."""
    dim = len(features.sharpness)
    optima, peaks = np.empty((len(features.centers), 2)), np.empty(len(features.ticks))
    on_table, values = np.empty((2, features.table.shape[1]))
    log_std = np.log(features.noise_std)
    found = np.empty(len(states))
    for c in range(len(states)):
        error = _squared_error(
            states[c, :dim], features, optima, on_table, values, peaks
        )
        if features.noise_spread > 0.0:
            log_std = states[c, dim]
        found[c] = _answer_log_likelihood(error, log_std, features)
    return found


@compiled(*_ANY_ORDER)
def _gradient_features(
    x: float, y: float, centers: Array, sharpness: Array, along: Array, across: Array
) -> None:
    """Write the slope of every RBF at a point, shape (D,) for x and for y."""
    for i in range(len(sharpness)):
        dx, dy = x - centers[0, i], y - centers[1, i]
        scaled = exp_of_negative(-(dx * dx + dy * dy) * sharpness[i])
        scaled *= -2.0 * sharpness[i]
        along[i] = scaled * dx
        across[i] = scaled * dy


@compiled()
def _metric(
    metric: Array,
    drift: Array,
    weights: Array,
    optima: Array,
    features: AnswerFeatures,
    precision: float,
    along: Array,
    across: Array,
) -> float:
    """Factorise how fast the likelihood falls around weights; return log |A|.

    The best placement moves by J dw with J = -H^-1 d(grad R)/dw; the prior adds D^2 / 2
    to the diagonal of A = precision * sum of J^T J. At an edge the placement stays until
    the slope across it, g, has changed its sign: there J is divided by 1 + |g| / (s |H|),
    so that a step is as long as the slope lets it. A becomes its own lower factor, and
    the drift half the Gauss-Newton step, A^-1 of the log likelihood's slope.
    """
    dim = len(weights)
    metric[:] = 0.0
    drift[:] = 0.0
    for i in range(dim):
        metric[i, i] = 0.5 * dim * dim
    for d in range(len(optima)):
        x, y = optima[d]
        centers = features.centers[d]
        here = _derivatives(x, y, weights, centers, features.sharpness)
        _gradient_features(x, y, centers, features.sharpness, along, across)
        is_x_free, is_y_free = 0.0 < x < 1.0, 0.0 < y < 1.0
        bend_x, bend_y, cross = _FLATTEST - here[3], _FLATTEST - here[4], -here[5]
        if is_x_free and is_y_free:
            determinant = max(bend_x * bend_y - cross * cross, _FLATTEST * _FLATTEST)
            for i in range(dim):
                slope_x, slope_y = along[i], across[i]
                along[i] = (bend_y * slope_x - cross * slope_y) / determinant
                across[i] = (bend_x * slope_y - cross * slope_x) / determinant
        else:
            bend_x, bend_y = max(bend_x, _FLATTEST), max(bend_y, _FLATTEST)
            if not is_x_free:
                bend_x += abs(here[1]) * np.sqrt(precision)
            if not is_y_free:
                bend_y += abs(here[2]) * np.sqrt(precision)
            for i in range(dim):
                along[i] /= bend_x
                across[i] /= bend_y
        error_x, error_y = features.placements[d, 0] - x, features.placements[d, 1] - y
        for i in range(dim):
            first, second = precision * along[i], precision * across[i]
            drift[i] += 0.5 * (first * error_x + second * error_y)
            for j in range(i + 1):
                metric[i, j] += first * along[j] + second * across[j]
    log_determinant = _factorize(metric)
    _solve(metric, drift)
    return log_determinant


@compiled()
def _factorize(matrix: Array) -> float:
    """Replace a positive definite matrix by its lower Cholesky factor; return log |A|."""
    log_determinant = 0.0
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = np.sqrt(total)
                log_determinant += np.log(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    return log_determinant


@compiled()
def _solve(factor: Array, vector: Array) -> None:
    """Solve L L^T x = vector in place."""
    for i in range(len(vector)):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]
    _solve_transposed(factor, vector, vector)


@compiled()
def _solve_transposed(factor: Array, noise: Array, steps: Array) -> None:
    """Solve L^T steps = noise."""
    dim = len(noise)
    for i in range(dim - 1, -1, -1):
        total = noise[i]
        for k in range(i + 1, dim):
            total -= factor[k, i] * steps[k]
        steps[i] = total / factor[i, i]


@compiled()
def _squared_length(factor: Array, steps: Array) -> float:
    """Return |L^T steps|^2."""
    total = 0.0
    for i in range(len(steps)):
        entry = 0.0
        for k in range(i, len(steps)):
            entry += factor[k, i] * steps[k]
        total += entry * entry
    return total


@compiled()
def _answer_log_likelihood(
    error: float, log_std: float, features: AnswerFeatures
) -> float:
    """Evaluate the log likelihood of placements of a sum of squared errors."""
    num_demos = len(features.placements)
    likelihood = -0.5 * error * np.exp(-2.0 * log_std) - 2.0 * num_demos * log_std
    return likelihood + features.log_constant


@compiled()
def walk_locally(
    start: Array,
    proposals: LocalProposals,
    features: AnswerFeatures,
    power: float,
) -> tuple[Array, Array, Array]:
    """Take the steps of `placement_likelihood.LocalWalk`.

    Where the noise is sampled, its logarithm follows the weights in a state.

    Returns:
        States, shape (S, C, D + E), their log likelihoods, shape (S, C), and the log
        acceptance ratio of each proposal, shape (S, C).
    """
    num_steps, num_chains, dim = proposals.noise.shape
    num_demos, num_nodes = len(features.centers), features.table.shape[1]
    is_std_sampled = features.noise_spread > 0.0
    states = np.empty((num_steps, num_chains, start.shape[1]))
    log_likelihoods, log_ratios = np.empty((2, num_steps, num_chains))
    optima, next_optima = np.empty((num_demos, 2)), np.empty((num_demos, 2))
    metric, next_metric = np.empty((dim, dim)), np.empty((dim, dim))
    weights, proposal, steps, along, across = np.empty((5, dim))
    drift, next_drift = np.empty(dim), np.empty(dim)
    on_table, values = np.empty((2, num_nodes))
    peaks = np.empty(len(features.ticks))
    for c in range(num_chains):
        weights[:] = start[c, :dim]
        log_std = start[c, dim] if is_std_sampled else np.log(features.noise_std)
        error = _squared_error(weights, features, optima, on_table, values, peaks)
        is_metric_current = False
        log_determinant = 0.0
        for s in range(num_steps):
            kind, scale = proposals.kinds[s, c], proposals.scales[s, c]
            noise = proposals.noise[s, c]
            precision = power * np.exp(-2.0 * log_std)
            length = 0.0
            if kind == LOCAL:
                if not is_metric_current:
                    log_determinant = _metric(
                        metric,
                        drift,
                        weights,
                        optima,
                        features,
                        precision,
                        along,
                        across,
                    )
                    is_metric_current = True
                _solve_transposed(metric, noise, steps)
                for i in range(dim):
                    length += noise[i] * noise[i]
                    steps[i] = scale * (steps[i] + scale * drift[i])
            else:
                for i in range(dim):
                    steps[i] = scale * noise[i] if kind in (ISOTROPIC, i) else 0.0
                    length += (steps[i] / scale) ** 2
            norm = 0.0
            for i in range(dim):
                proposal[i] = weights[i] + steps[i]
                norm += abs(proposal[i])
            for i in range(dim):
                proposal[i] /= norm
            next_error = _squared_error(
                proposal, features, next_optima, on_table, values, peaks
            )
            log_ratio = 0.5 * precision * (error - next_error)
            num_moved = 1 if kind >= 0 else dim
            next_log_determinant = 0.0
            if kind == LOCAL:
                next_log_determinant = _metric(
                    next_metric,
                    next_drift,
                    proposal,
                    next_optima,
                    features,
                    precision,
                    along,
                    across,
                )
                for i in range(dim):
                    steps[i] = -steps[i] / norm / scale - scale * next_drift[i]
                back = _squared_length(next_metric, steps)
                log_ratio += 0.5 * (next_log_determinant - log_determinant)
                log_ratio -= 2 * dim * np.log(norm) + 0.5 * (back - length)
            else:
                log_ratio -= (dim + num_moved) * np.log(norm)
                log_ratio -= 0.5 * length * (norm**-2 - 1.0)
            if proposals.log_uniforms[s, c] < log_ratio:
                weights[:] = proposal
                error = next_error
                optima, next_optima = next_optima, optima
                if kind == LOCAL:
                    metric, next_metric = next_metric, metric
                    drift, next_drift = next_drift, drift
                    log_determinant = next_log_determinant
                else:
                    is_metric_current = False
            likelihood = _answer_log_likelihood(error, log_std, features)
            if is_std_sampled:
                other = log_std + proposals.std_noise[s, c]
                other_likelihood = _answer_log_likelihood(error, other, features)
                gain = power * (other_likelihood - likelihood)
                median, spread = features.noise_std, features.noise_spread
                gain += log_normal(other, median, spread)
                gain -= log_normal(log_std, median, spread)
                if proposals.std_log_uniforms[s, c] < gain:
                    log_std, likelihood = other, other_likelihood
                    is_metric_current = False
            states[s, c, :dim] = weights
            if is_std_sampled:
                states[s, c, dim] = log_std
            log_likelihoods[s, c] = likelihood
            log_ratios[s, c] = log_ratio
    return states, log_likelihoods, log_ratios
