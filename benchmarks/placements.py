"""Speed of finding the best placement, beside the same work in plain numpy."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from cases import (
    NUM_CANDIDATES,
    NUM_TEST_LAYOUTS,
    TASKS,
    demonstrations,
    make_rng,
    posterior_rewards,
    weigh_queries,
)
from figure import Figure, Plain, Quantity, measure
from plain_work import plain_free_placements, plain_placements

from tablesetting.experiments.validation import ValidationSet
from tablesetting.irl.arrays import Array
from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.config import DEFAULT, PAPER
from tablesetting.reward.placement import best_placements
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.rbf import all_centers, rbf_features
from tablesetting.reward.square import best_on_square

_NUM_BATCHES = 200  # Of 5000 placements.
_MISS = 0.02  # Distance from the optimum that counts as a miss, in table units.


def query() -> Iterator[Figure]:
    """Which of 50 layouts to ask about, for the 100 samples after one demonstration."""
    for task in TASKS:
        problem = PlacementProblem(task, PAPER)
        demos = demonstrations(problem, 1)
        posterior = problem.infer(demos, None, rng=make_rng())
        weights = np.vstack([posterior.map_weights, posterior.weights])
        layouts = np.array(problem.propose_queries(demos, rng=make_rng()))
        yield measure(
            f"query of 50 layouts x 100 samples, {task.name}",
            partial(weigh_queries, problem, demos, posterior),
            plain=Plain(
                partial(plain_placements, weights, layouts, problem.widths), share=1.0
            ),
            traces_memory=True,
        )


def query_misses() -> Iterator[Figure]:
    """How often the plain ascent ends elsewhere than at the optimum."""
    for task in TASKS:
        problem, weights = PlacementProblem(task, PAPER), posterior_rewards(task)
        layouts = problem.space.sample(NUM_CANDIDATES, rng=make_rng())
        best = best_placements(weights, layouts, problem.widths)
        climbed = plain_placements(weights, layouts, problem.widths)
        yield _misses(task.name, problem, weights, layouts, best, climbed)


def optimum_misses() -> Iterator[Figure]:
    """For how many random rewards a finer grid shows a better placement."""
    for task in TASKS:
        problem, rng = PlacementProblem(task, PAPER), make_rng()
        fine, misses, largest = np.linspace(0.0, 1.0, 60), 0, 0.0
        for _ in range(_NUM_BATCHES):
            weights = sample_uniform_weights(200, len(problem.widths), rng=rng)
            layouts = problem.space.sample(25, rng=rng)
            best = best_placements(weights, layouts, problem.widths)
            better = best_on_square(weights, layouts, problem.widths, fine)
            features = rbf_features(
                np.stack([best, better]), all_centers(layouts), problem.widths
            )
            lost = np.diff((features * weights).sum(axis=-1), axis=0)
            misses += np.sum(lost > 1e-10)
            largest = max(largest, lost.max())
        million = f"of a million random rewards, {task.name}"
        yield Quantity(f"best placement missed {million}", float(misses), "")
        yield Quantity(f"largest reward lost {million}", float(largest), "")


def free_placements() -> Iterator[Figure]:
    """Where the arm puts the item for one learned reward in 200 layouts."""
    for task in TASKS:
        problem, weights = PlacementProblem(task, DEFAULT), posterior_rewards(task)[-1]
        layouts = problem.space.sample(NUM_TEST_LAYOUTS, rng=make_rng())
        fast = partial(_free_placements, problem, weights)
        slow = partial(plain_free_placements, problem, weights)
        yield measure(
            f"200 free placements, {task.name}",
            partial(fast, layouts),
            plain=Plain(partial(slow, layouts), share=1.0),
            traces_memory=True,
        )
        best, scanned = fast(layouts)[:, None], slow(layouts)[:, None]
        label = f"{task.name}, free"
        yield _misses(label, problem, weights[None], layouts, best, scanned)


def validation() -> Iterator[Figure]:
    """Placement errors of learned weights in 200 test layouts."""
    for task in TASKS:
        problem, weights = PlacementProblem(task, PAPER), posterior_rewards(task)[-1]
        layouts = problem.space.sample(NUM_TEST_LAYOUTS, rng=make_rng())
        tests = ValidationSet.of_problem(problem, layouts)
        yield measure(
            f"200 test layouts, {task.name}",
            partial(tests.placement_errors, weights),
            plain=Plain(
                partial(plain_placements, weights[None], layouts, problem.widths),
                share=1.0,
            ),
            traces_memory=True,
        )


FIGURES: tuple[Callable[[], Iterator[Figure]], ...] = (
    query,
    query_misses,
    optimum_misses,
    validation,
    free_placements,
)


def _free_placements(
    problem: PlacementProblem, weights: Array, layouts: Array
) -> Array:
    """Place for one reward, shape (D,), in every layout; return shape (L, 2)."""
    # Made anew for each run, as a free space keeps what it once computed.
    receptacles = problem.task.receptacles
    spaces = [problem.space.free_space(layout, receptacles) for layout in layouts]
    return best_placements(weights[None], layouts, problem.widths, spaces)[:, 0]


def _misses(
    label: str,
    problem: PlacementProblem,
    weights: Array,
    layouts: Array,
    best: Array,
    plain: Array,
) -> Quantity:
    """Compare placements of plain numpy with optima, both of shape (L, N, 2)."""
    places = np.stack([best, plain])
    features = rbf_features(places, all_centers(layouts), problem.widths)
    best_rewards, rewards = (features * weights).sum(axis=-1)
    assert (best_rewards - rewards).min() > -1e-9, f"{label}: plain numpy is better"
    missed = np.linalg.norm(plain - best, axis=-1) > _MISS
    return Quantity(
        f"plain misses the optimum by > {_MISS}, {label}",
        100.0 * float(missed.mean()),
        "%",
    )
