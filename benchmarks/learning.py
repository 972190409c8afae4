"""Speed of learning, each figure beside the same work by the plain loops."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import islice
from statistics import fmean

import numpy as np
from cases import (
    NUM_CANDIDATES,
    NUM_ROUNDS,
    NUM_TEST_LAYOUTS,
    TASKS,
    demonstrations,
    make_rng,
    posterior_rewards,
    table_kinds,
)
from figure import MIN_REPEATS, Figure, Plain, Quantity, measure
from plain_work import plain_inference, plain_placements, plain_trial

from tablesetting.experiments.validation import ValidationSet
from tablesetting.irl.active import run_active, score_active_var
from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.problem import DEFAULT, PAPER, PlacementProblem
from tablesetting.reward.rbf import all_centers, rbf_features

_MISS = 0.02  # Distance from the optimum that counts as a miss, in table units.


def query() -> Iterator[Figure]:
    """Best placements of 100 posterior rewards in 50 layouts."""
    for task in TASKS:
        weights = posterior_rewards(task)
        for label, problem in table_kinds(task):
            layouts = problem.space.sample(NUM_CANDIDATES, rng=make_rng())
            part = weights[::50]
            yield measure(
                f"query of 50 x 100 placements, {label}",
                partial(problem.best_placements, weights, layouts),
                plain=Plain(
                    partial(plain_placements, problem, part, layouts),
                    share=len(part) / len(weights),
                ),
                traces_memory=True,
            )


def plain_misses() -> Iterator[Figure]:
    """How often the plain ascent ends elsewhere than at the optimum."""
    for task in TASKS:
        weights = posterior_rewards(task)[::10]
        for label, problem in table_kinds(task):
            layouts = problem.space.sample(NUM_CANDIDATES, rng=make_rng())
            best = problem.best_placements(weights, layouts)
            climbed = plain_placements(problem, weights, layouts)
            gain = _rewards(problem, weights, layouts, best) - _rewards(
                problem, weights, layouts, climbed
            )
            assert gain.min() > -1e-9, f"{label}: the plain ascent found a better place"
            missed = np.linalg.norm(climbed - best, axis=-1) > _MISS
            yield Quantity(
                f"plain misses the optimum by > {_MISS}, {label}",
                100.0 * float(missed.mean()),
                "%",
            )


def inference() -> Iterator[Figure]:
    """The posterior after 1, 5 and 10 demonstrations, and what its samples are worth."""
    for task in TASKS:
        for preset, config in (("paper", PAPER), ("default", DEFAULT)):
            problem = PlacementProblem(task, config)
            demos = demonstrations(problem, 10)
            for num_demos in (1, 5, 10):
                label = f"{task.name}, {preset}, {num_demos} demos"
                yield from _time_inference(label, problem, demos[:num_demos])


def validation() -> Iterator[Figure]:
    """Placement errors of learned weights in 200 test layouts."""
    for task in TASKS:
        weights = posterior_rewards(task)[-1]
        for label, problem in table_kinds(task):
            layouts = problem.space.sample(NUM_TEST_LAYOUTS, rng=make_rng())
            tests = ValidationSet.of_problem(problem, layouts)
            part = layouts[:50]
            yield measure(
                f"200 test layouts, {label}",
                partial(tests.placement_errors, weights),
                plain=Plain(
                    partial(plain_placements, problem, weights[None], part),
                    share=len(part) / len(layouts),
                ),
                traces_memory=True,
            )


def paper_trial() -> Iterator[Figure]:
    """One trial of the paper's experiment: ten queries, each round validated."""
    for task in TASKS:
        problem = PlacementProblem(task, PAPER)
        yield measure(
            f"paper trial of 10 queries, {task.name}",
            partial(_run_trial, problem),
            plain=plain_trial(problem),
        )


FIGURES: tuple[Callable[[], Iterator[Figure]], ...] = (
    query,
    plain_misses,
    inference,
    validation,
    paper_trial,
)


def _rewards(
    problem: PlacementProblem, weights: Array, layouts: Array, placements: Array
) -> Array:
    """Evaluate rewards (N, D) at their placements (L, N, 2), shape (L, N)."""
    features = rbf_features(placements, all_centers(layouts), problem.widths)
    return (features * weights).sum(axis=-1)


def _time_inference(
    label: str, problem: PlacementProblem, demos: Sequence[Demonstration]
) -> Iterator[Figure]:
    rng, posteriors = make_rng(), list[Posterior]()
    timing = measure(
        f"inference, {label}",
        lambda: posteriors.append(problem.infer(demos, None, rng=rng)),
        plain=plain_inference(problem, demos, num_steps=100 // len(demos)),
        traces_memory=True,
    )
    yield timing
    # As many as there are on every machine, so that a slow one sees the same chains.
    ess = fmean(posterior.ess for posterior in posteriors[:MIN_REPEATS])
    yield Quantity(f"ESS per second, {label}", ess / timing.seconds_min, "1/s")


def _run_trial(problem: PlacementProblem) -> list[Array]:
    """Learn with ten queries; return the errors of every round."""
    rng = make_rng()
    layouts = problem.space.sample(NUM_TEST_LAYOUTS, rng=rng)
    tests = ValidationSet.of_problem(problem, layouts)
    first = demonstrations(problem, 1)
    rounds = run_active(problem, first, score_active_var, problem.config.risk, rng=rng)
    errors = [
        tests.placement_errors(latest.posterior.map_weights)
        for latest in islice(rounds, NUM_ROUNDS)
    ]
    assert errors[-1].mean() < errors[0].mean(), "ten queries taught nothing"
    return errors
