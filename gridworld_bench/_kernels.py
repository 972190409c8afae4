"""Compiled chains over rewards; the tests hold each against plain code.

A proposal is given up as soon as it cannot be accepted any more: while its MDP is being
solved, the values of a policy are below the optimal ones, and these are less than the
largest improvement, over one less the discount, above (MacQueen 1966). Values that are
iterated are as far off as the spread of their last change, times discount over one less
the discount, as a common shift changes no probability.

A choice is, for each state, where the policy leads if that is certain, else its action.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tablesetting.compiling import compiled
from tablesetting.irl.arrays import Array

Unsigned = npt.NDArray[np.uint32]

_ROUNDING = 1e-12  # Of an improvement, relative to the values.
_MARGIN = 1e-9  # Of a log likelihood, before a proposal is given up.
_SWEEPS = 8  # Between two looks at the bound,
_MOST_LOOKS = 6  # before a policy is made of the values.
_SWEEPS_OF_OUTCOMES = 6  # Between two looks in a large uncertain world.
_ENOUGH = 1e-7  # Error of values that are only iterated, relative to the largest.


class World(NamedTuple):
    """An MDP; a plain grid without ends is solved many times faster."""

    nexts: Unsigned
    """Where each action leads, (A, S); of shape (0, 0) where that is not certain."""
    successors: npt.NDArray[np.intp]
    """As in `Mdp`, (S, A, B)."""
    probabilities: Array
    """As in `Mdp`, (S, A, B)."""
    continuations: Array
    """As in `Mdp`, (S,)."""
    num_rows: int
    """Rows of a plain grid; 0 of any other world."""
    num_columns: int
    """Its columns."""
    outcomes: Unsigned
    """Which outcome each action has, (S, A), where a large world is uncertain; else (0, 0)."""
    starts: Unsigned
    """Where the states of each outcome start in the next two, and the end, (U + 1,)."""
    reached: Unsigned
    """States of the outcomes, one after the other."""
    chances: Array
    """How probable each is."""


class Pairs(NamedTuple):
    """Distinct pairs that were judged."""

    states: Unsigned
    """State of each, (K,)."""
    actions: Unsigned
    """Action of each, (K,)."""
    signs: npt.NDArray[np.intp]
    """1 if it is good, -1 if not, (K,)."""
    counts: Array
    """How often it was judged so, (K,)."""
    paths: Unsigned
    """Where its action leads, then the others, if that is certain, (K, A)."""


_NONE = np.empty(0, dtype=np.uint32)
NO_PAIRS = Pairs(
    _NONE, _NONE, np.empty(0, np.intp), np.empty(0), np.empty((0, 0), np.uint32)
)
"""Nothing was judged."""


class Workspace(NamedTuple):
    """Arrays that are written anew for each reward."""

    order: Unsigned
    mark: Unsigned
    best: Array
    old: Array
    new: Array
    framed: Array
    places: Unsigned


@compiled(error_model="numpy", inline="always")
def _follow(
    choice: Unsigned, first: int, order: Unsigned, mark: Unsigned
) -> tuple[int, np.uint32]:
    """Follow a policy until it meets what is known, or itself; return how far, and where."""
    length, state = 0, np.uint32(first)
    while mark[state] == 0:
        mark[state] = length + 2
        order[length] = state
        length += 1
        state = choice[state]
    return length, state


@compiled(error_model="numpy")
def _evaluate_graph(
    choice: Unsigned,
    continuations: Array,
    rewards: Array,
    values: Array,
    order: Unsigned,
    mark: Unsigned,
) -> None:
    """Value a policy that leads from each state to one, along its paths and cycles."""
    for s in range(len(rewards)):
        mark[s] = 0
    for first in range(len(rewards)):
        if mark[first] != 0:
            continue
        length, state = _follow(choice, first, order, mark)
        if mark[state] >= 2:
            start = mark[state] - 2
            total, factor = 0.0, 1.0
            for k in range(start, length):
                here = order[k]
                total += factor * rewards[here]
                factor *= continuations[here]
            value = total / (1.0 - factor)
            values[state] = value
            for k in range(length - 1, start, -1):
                here = order[k]
                value = rewards[here] + continuations[here] * value
                values[here] = value
                mark[here] = 1
            mark[state] = 1
            length = start
        value = values[state]
        for k in range(length - 1, -1, -1):
            here = order[k]
            value = rewards[here] + continuations[here] * value
            values[here] = value
            mark[here] = 1


@compiled(error_model="numpy")
def _improve_graph(
    nexts: Unsigned, continuations: Array, choice: Unsigned, values: Array, best: Array
) -> float:
    """Improve such a policy; return the largest gain, 0 if there is none."""
    num_states, scale, largest = len(values), 1.0, 0.0
    for s in range(num_states):
        best[s] = values[choice[s]]
        scale = max(scale, abs(values[s]))
    for a in range(nexts.shape[0]):
        for s in range(num_states):
            there = values[nexts[a, s]]
            best[s] = there if there > best[s] else best[s]
    tolerance = _ROUNDING * scale
    for s in range(num_states):
        gain = continuations[s] * (best[s] - values[choice[s]])
        if gain > tolerance:
            largest = max(largest, gain)
            for a in range(nexts.shape[0]):
                if values[nexts[a, s]] == best[s]:
                    choice[s] = nexts[a, s]
    return largest


@compiled(error_model="numpy", inline="always")
def _expected(
    nexts: Unsigned,
    successors: npt.NDArray[np.intp],
    probabilities: Array,
    values: Array,
    state: int,
    action: int,
) -> float:
    """Return the value of where an action leads."""
    if len(nexts):
        total = values[nexts[action, state]]
    else:
        total = 0.0
        for b in range(successors.shape[2]):
            chance = probabilities[state, action, b]
            total += chance * values[successors[state, action, b]]
    return total


@compiled(error_model="numpy")
def _evaluate_chances(
    world: World, rewards: Array, choice: Unsigned, values: Array
) -> None:
    """Value any policy, by a linear system."""
    successors, probabilities = world.successors, world.probabilities
    continuations = world.continuations
    system = np.eye(len(rewards))
    for s in range(len(rewards)):
        for b in range(successors.shape[2]):
            chance = probabilities[s, choice[s], b]
            system[s, successors[s, choice[s], b]] -= continuations[s] * chance
    values[:] = np.linalg.solve(system, rewards)


@compiled(error_model="numpy")
def _improve_chances(world: World, choice: Unsigned, values: Array) -> float:
    """Improve any policy; return the largest gain, 0 if there is none."""
    nexts, successors = world.nexts, world.successors
    probabilities, continuations = world.probabilities, world.continuations
    largest = 0.0
    tolerance = _ROUNDING * max(1.0, np.abs(values).max())
    for s in range(len(values)):
        here = _expected(nexts, successors, probabilities, values, s, choice[s])
        best, action = here, choice[s]
        for a in range(successors.shape[1]):
            there = _expected(nexts, successors, probabilities, values, s, a)
            if there > best:
                best, action = there, np.uint32(a)
        gain = continuations[s] * (best - here)
        if gain > tolerance:
            largest = max(largest, gain)
            choice[s] = action
    return largest


@compiled(error_model="numpy")
def _log_likelihood(world: World, values: Array, pairs: Pairs, beta: float) -> float:
    """Evaluate the log likelihood of the pairs, given optimal values."""
    if world.successors.shape[1] == 1:
        return 0.0  # There is no choice.
    nexts, successors = world.nexts, world.successors
    probabilities, continuations = world.probabilities, world.continuations
    states, actions = pairs.states, pairs.actions
    signs, counts = pairs.signs, pairs.counts
    total = 0.0
    for k in range(len(states)):
        s, a = states[k], actions[k]
        own = _expected(nexts, successors, probabilities, values, s, a)
        best = -np.inf
        for b in range(successors.shape[1]):
            there = _expected(nexts, successors, probabilities, values, s, b)
            best = there if b != a and there > best else best
        strength, odds = beta * continuations[s], 0.0  # Relative to the best other.
        for b in range(successors.shape[1]):
            there = _expected(nexts, successors, probabilities, values, s, b)
            if b != a:
                odds += np.exp(strength * (there - best))
        log_odds = signs[k] * (strength * (best - own) + np.log(odds))
        # -log(1 + exp(x)), without overflow.
        total -= counts[k] * (max(log_odds, 0.0) + np.log1p(np.exp(-abs(log_odds))))
    return total


@compiled(error_model="numpy")
def _bound_log_likelihood(
    world: World, values: Array, pairs: Pairs, beta: float, slack: float
) -> float:
    """Bound it from above, if the values are up to `slack` too low, without any exp.

    The odds against an action are at least those of the best other, and at most as many
    times that as there are others.
    """
    if world.successors.shape[1] == 1:
        return 0.0  # There is no choice.
    nexts, successors = world.nexts, world.successors
    probabilities, continuations = world.probabilities, world.continuations
    states, actions, paths = pairs.states, pairs.actions, pairs.paths
    signs, counts = pairs.signs, pairs.counts
    num_actions, total = successors.shape[1], 0.0
    log_others = np.log(num_actions - 1.0)
    for k in range(len(states)):
        s, best = states[k], -np.inf
        if len(nexts):
            own = values[paths[k, 0]]
            for b in range(1, num_actions):
                there = values[paths[k, b]]
                best = there if there > best else best
        else:
            a = actions[k]
            own = _expected(nexts, successors, probabilities, values, s, a)
            for b in range(num_actions):
                there = _expected(nexts, successors, probabilities, values, s, b)
                best = there if b != a and there > best else best
        strength = beta * continuations[s]
        if signs[k] > 0:
            log_odds = strength * (best - own - slack)
            total -= counts[k] * (log_odds if log_odds > 0.0 else 0.0)
        else:
            log_odds = strength * (best - own + slack) + log_others
            total += counts[k] * (log_odds if log_odds < 0.0 else 0.0)
    return total


@compiled(error_model="numpy", inline="always")
def _frame(values: Array, num_rows: np.uint64, width: np.uint64) -> None:
    """Repeat the border of a grid around it, as a step off the grid stays in place."""
    one = np.uint64(1)
    for row in range(width, (num_rows + one) * width, width):
        values[row] = values[row + one]
        values[row + width - one] = values[row + width - one - one]
    last = num_rows * width
    for column in range(width):
        values[column] = values[column + width]
        values[last + width + column] = values[last + column]


@compiled("nnan", "nsz", error_model="numpy")
def _sweep(
    old: Array,
    new: Array,
    rewards: Array,
    num_rows: np.uint64,
    width: np.uint64,
    discount: float,
) -> None:
    """Iterate the values of a framed grid once.

    Rows and width are unsigned, or every index would be checked for being negative.
    """
    one = np.uint64(1)
    for i in range(width, (num_rows + one) * width):
        vertical = max(old[i - width], old[i + width])
        horizontal = max(old[i - one], old[i + one])
        new[i] = rewards[i] + discount * max(vertical, horizontal)
    _frame(new, num_rows, width)


@compiled(error_model="numpy")
def _is_hopeless(
    world: World,
    rewards: Array,
    pairs: Pairs,
    beta: float,
    least: float,
    choice: Unsigned,
    values: Array,
    work: Workspace,
) -> bool:
    """Sweep a grid until its likelihood must be below `least`, or is worth knowing.

    Values are a start at first, and better ones then; the choice is greedy in them.
    """
    num_rows, width = np.uint64(world.num_rows), np.uint64(world.num_columns + 2)
    discount = world.continuations[0]
    old, new, framed, places = work.old, work.new, work.framed, work.places
    for s in range(len(values)):
        framed[places[s]] = rewards[s]
        new[places[s]] = values[s]
    _frame(new, num_rows, width)
    for _ in range(_MOST_LOOKS):
        for _ in range(_SWEEPS // 2):
            _sweep(new, old, framed, num_rows, width, discount)
            _sweep(old, new, framed, num_rows, width, discount)
        least_change = most_change = new[places[0]] - old[places[0]]
        for s in range(len(values)):
            values[s] = new[places[s]]
            change = values[s] - old[places[s]]
            least_change = change if change < least_change else least_change
            most_change = change if change > most_change else most_change
        slack = (most_change - least_change) * discount / (1.0 - discount)
        bound = _bound_log_likelihood(world, values, pairs, beta, slack)
        if bound < least - _MARGIN:
            return True
    nexts = world.nexts
    for s in range(len(values)):
        best = choice[s]
        for a in range(len(nexts)):
            if values[nexts[a, s]] > values[best]:
                best = nexts[a, s]
        choice[s] = best
    return False


@compiled(error_model="numpy")
def _sweep_outcomes(
    world: World, rewards: Array, values: Array, expected: Array
) -> tuple[float, float]:
    """Iterate the values once; return the least and the largest change."""
    outcomes, continuations = world.outcomes, world.continuations
    for u in range(len(world.starts) - 1):
        total = 0.0
        for k in range(world.starts[u], world.starts[u + 1]):
            total += world.chances[k] * values[world.reached[k]]
        expected[u] = total
    least_change, most_change = np.inf, -np.inf
    for s in range(len(rewards)):
        best = expected[outcomes[s, 0]]
        for a in range(1, outcomes.shape[1]):
            there = expected[outcomes[s, a]]
            best = there if there > best else best
        new = rewards[s] + continuations[s] * best
        change = new - values[s]
        values[s] = new
        least_change = change if change < least_change else least_change
        most_change = change if change > most_change else most_change
    return least_change, most_change


@compiled(error_model="numpy")
def _weigh_by_sweeps(
    world: World,
    discount: float,
    rewards: Array,
    pairs: Pairs,
    beta: float,
    least: float,
    values: Array,
    work: Workspace,
) -> float:
    """Do what `_weigh` does in a large uncertain world, without any linear system.

    Where nothing ends, the optimal values are above the last ones by between the least
    and the largest change, times discount over one less the discount.
    """
    ends = world.continuations.min() < discount
    scale = discount / (1.0 - discount)
    while True:
        for _ in range(_SWEEPS_OF_OUTCOMES):
            lower, upper = _sweep_outcomes(world, rewards, values, work.best)
        if ends:
            upper = max(abs(lower), abs(upper))
            lower = -upper
        slack, shift = (upper - lower) * scale, 0.5 * (upper + lower) * scale
        largest = 1.0
        for s in range(len(values)):
            values[s] += shift
            largest = max(largest, abs(values[s]))
        bound = _bound_log_likelihood(world, values, pairs, beta, slack)
        if bound < least - _MARGIN:
            return -np.inf
        if slack < _ENOUGH * largest:
            return _log_likelihood(world, values, pairs, beta)


@compiled(error_model="numpy")
def _weigh(
    world: World,
    largest_discount: float,
    rewards: Array,
    pairs: Pairs,
    beta: float,
    least: float,
    choice: Unsigned,
    values: Array,
    work: Workspace,
) -> float:
    """Solve an MDP for its log likelihood; -inf as soon as that is below `least`.

    Choice and values are a start at first, and the solution then; the choice is left as it
    is where values are iterated.
    """
    if len(world.starts) > 1:
        return _weigh_by_sweeps(
            world, largest_discount, rewards, pairs, beta, least, values, work
        )
    if (
        world.num_rows > 0
        and least > -np.inf
        and _is_hopeless(world, rewards, pairs, beta, least, choice, values, work)
    ):
        return -np.inf
    while True:
        if len(world.nexts):
            _evaluate_graph(
                choice, world.continuations, rewards, values, work.order, work.mark
            )
            gain = _improve_graph(
                world.nexts, world.continuations, choice, values, work.best
            )
        else:
            _evaluate_chances(world, rewards, choice, values)
            gain = _improve_chances(world, choice, values)
        slack = gain / (1.0 - largest_discount)
        bound = _bound_log_likelihood(world, values, pairs, beta, slack)
        if bound < least - _MARGIN:
            return -np.inf
        if gain == 0.0:
            return _log_likelihood(world, values, pairs, beta)


@compiled(error_model="numpy")
def _workspace(world: World) -> Workspace:
    num_states = len(world.continuations)
    num_rows, num_columns = world.num_rows, world.num_columns
    size = (num_rows + 2) * (num_columns + 2)
    places = np.zeros(num_states, dtype=np.uint32)  # In the frame, of each state.
    for s in range(num_rows * num_columns):
        places[s] = (s // num_columns + 1) * (num_columns + 2) + s % num_columns + 1
    return Workspace(
        np.empty(num_states, np.uint32),
        np.empty(num_states, np.uint32),
        np.empty(max(num_states, len(world.starts))),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        places,
    )


@compiled(error_model="numpy")
def _first_choice(world: World) -> Unsigned:
    """Return the choice of the first action everywhere."""
    if len(world.nexts):
        return world.nexts[0].copy()
    return np.zeros(len(world.continuations), dtype=np.uint32)


@compiled(error_model="numpy")
def weigh_all(
    world: World, all_rewards: Array, pairs: Pairs, beta: float
) -> tuple[Array, Array]:
    """Solve the MDP for many rewards, (N, S): log likelihoods and optimal values."""
    log_likelihoods, all_values = np.empty(len(all_rewards)), np.zeros_like(all_rewards)
    choice, work = _first_choice(world), _workspace(world)
    for n in range(len(all_rewards)):
        log_likelihoods[n] = _weigh(
            world,
            world.continuations.max(),
            all_rewards[n],
            pairs,
            beta,
            -np.inf,
            choice,
            all_values[n],
            work,
        )
    return log_likelihoods, all_values


@compiled(error_model="numpy")
def _expect_features(
    choice: Unsigned,
    continuations: Array,
    features: Array,
    expectations: Array,
    order: Unsigned,
    mark: Unsigned,
) -> None:
    """Value a policy as `_evaluate_graph` does, for all features, (S, D), at once."""
    num_states, dim = features.shape
    for s in range(num_states):
        mark[s] = 0
    for first in range(num_states):
        if mark[first] != 0:
            continue
        length, state = _follow(choice, first, order, mark)
        if mark[state] >= 2:
            total, factor = expectations[state], 1.0
            total[:] = 0.0
            for k in range(mark[state] - 2, length):
                here = order[k]
                for i in range(dim):
                    total[i] += factor * features[here, i]
                factor *= continuations[here]
            for i in range(dim):
                total[i] /= 1.0 - factor
            mark[state] = 1
        for k in range(length - 1, -1, -1):
            here = order[k]
            if mark[here] != 1:
                there, discount = expectations[choice[here]], continuations[here]
                for i in range(dim):
                    expectations[here, i] = features[here, i] + discount * there[i]
                mark[here] = 1


@compiled(error_model="numpy")
def walk_coordinates(
    world: World,
    columns: Array,
    pairs: Pairs,
    beta: float,
    start: Array,
    coordinates: npt.NDArray[np.intp],
    steps: Array,
    log_uniforms: Array,
    thinning: int,
) -> tuple[Array, Array, Array, Array, float, int]:
    """Walk the paper's chain: some coordinates step, are clipped and renormalised.

    `columns` are the features, (D, S); coordinates and steps are of shape (P, J). Returns
    states, their optimal values and log likelihoods after each `thinning` proposals, the
    best state ever, its log likelihood and how many proposals were accepted.
    """
    num_states, largest = columns.shape[1], world.continuations.max()
    num_kept = len(steps) // thinning
    kept = np.empty((num_kept, len(columns)))
    kept_values, kept_logs = np.empty((num_kept, num_states)), np.empty(num_kept)
    work = _workspace(world)
    weights, rewards = start.copy(), start @ columns
    choice, values = _first_choice(world), np.zeros(num_states)
    here = _weigh(world, largest, rewards, pairs, beta, -np.inf, choice, values, work)
    best, best_log, num_accepted = weights.copy(), here, 0
    # What the policy expects of each feature, as its values are a good start.
    features = np.ascontiguousarray(columns.T)
    expectations = np.zeros_like(features)
    is_certain = len(world.nexts) > 0
    if is_certain:
        _expect_features(
            choice, world.continuations, features, expectations, work.order, work.mark
        )
    changes = np.zeros(coordinates.shape[1])
    proposal, new_rewards = np.empty_like(weights), np.empty_like(rewards)
    new_choice, new_values = choice.copy(), np.empty(num_states)
    for k in range(len(steps)):
        proposal[:] = weights
        new_rewards[:] = rewards
        norm = 1.0
        for j in range(coordinates.shape[1]):
            i = coordinates[k, j]
            moved = min(max(proposal[i] + steps[k, j], -1.0), 1.0)
            change = moved - proposal[i]
            norm += abs(moved) - abs(proposal[i])
            proposal[i] = moved
            changes[j] = change
            for s in range(num_states):
                new_rewards[s] += change * columns[i, s]
        if norm > 1e-9:
            inverse = 1.0 / norm
            for s in range(num_states):
                new_rewards[s] *= inverse
                value = values[s]
                for j in range(len(changes)):
                    value += changes[j] * expectations[s, coordinates[k, j]]
                new_values[s] = value * inverse
            new_choice[:] = choice
            least = here + log_uniforms[k]
            there = _weigh(
                world,
                largest,
                new_rewards,
                pairs,
                beta,
                least,
                new_choice,
                new_values,
                work,
            )
            if there > least:
                weights[:] = proposal / np.abs(proposal).sum()
                rewards[:] = weights @ columns  # Lest errors add up.
                if is_certain and (choice != new_choice).any():
                    _expect_features(
                        new_choice,
                        world.continuations,
                        features,
                        expectations,
                        work.order,
                        work.mark,
                    )
                choice[:] = new_choice
                values[:] = new_values
                here = there
                num_accepted += 1
                if here > best_log:
                    best_log = here
                    best[:] = weights
        if (k + 1) % thinning == 0:
            n = k // thinning
            kept[n], kept_values[n], kept_logs[n] = weights, values, here
    return kept, kept_values, kept_logs, best, best_log, num_accepted


@compiled(error_model="numpy")
def walk_sphere(
    world: World,
    columns: Array,
    pairs: Pairs,
    beta: float,
    start: Array,
    log_likelihoods: Array,
    steps: Array,
    squared_noise: Array,
    log_uniforms: Array,
    is_prior_uniform: bool,
    power: float,
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Do what `tablesetting.irl.random_walk.walk` does, without what is hopeless.

    Returns states, (S, C, D), log likelihoods and which steps were taken, (S, C).
    """
    num_steps, num_chains, dim = steps.shape
    states = np.empty_like(steps)
    logs = np.empty((num_steps, num_chains))
    is_taken = np.zeros((num_steps, num_chains), dtype=np.bool_)
    work, largest = _workspace(world), world.continuations.max()
    values = np.zeros(columns.shape[1])
    new_values = np.empty_like(values)
    for c in range(num_chains):
        state, here = start[c].copy(), log_likelihoods[c]
        choice = _first_choice(world)
        _weigh(
            world,
            largest,
            state @ columns,
            pairs,
            beta,
            -np.inf,
            choice,
            values,
            work,
        )
        new_choice = choice.copy()
        for k in range(num_steps):
            proposal = state + steps[k, c]
            norm = np.abs(proposal).sum()
            proposal /= norm
            log_needed = log_uniforms[k, c]
            if is_prior_uniform:
                log_needed += 2 * dim * np.log(norm)
                log_needed += 0.5 * squared_noise[k, c] * (norm**-2 - 1.0)
            least = -np.inf
            if power > 0.0:
                least = here + log_needed / power
            new_choice[:] = choice
            new_values[:] = values
            there = _weigh(
                world,
                largest,
                proposal @ columns,
                pairs,
                beta,
                least,
                new_choice,
                new_values,
                work,
            )
            if log_needed < power * (there - here):
                state[:] = proposal
                choice[:] = new_choice
                values[:] = new_values
                here = there
                is_taken[k, c] = True
            states[k, c] = state
            logs[k, c] = here
    return states, logs, is_taken
