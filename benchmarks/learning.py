"""Speed of inference and of a trial, beside the same work in plain numpy."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import islice
from statistics import fmean

from cases import NUM_ROUNDS, NUM_TEST_LAYOUTS, TASKS, demonstrations, make_rng
from figure import MIN_REPEATS, Figure, Quantity, measure
from plain_work import plain_inference, plain_trial

from tablesetting.experiments.validation import ValidationSet
from tablesetting.irl.active import run_active, score_active_var
from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.problem import DEFAULT, PAPER, PlacementProblem


def inference() -> Iterator[Figure]:
    """The posterior after 1, 5 and 10 demonstrations, and what its samples are worth."""
    for task in TASKS:
        for preset, config in (("paper", PAPER), ("default", DEFAULT)):
            problem = PlacementProblem(task, config)
            demos = demonstrations(problem, 10)
            for num_demos in (1, 5, 10):
                label = f"{task.name}, {preset}, {num_demos} demos"
                yield from _time_inference(label, problem, demos[:num_demos])


def paper_trial() -> Iterator[Figure]:
    """One trial of the paper's experiment: ten queries, each round validated."""
    for task in TASKS:
        problem = PlacementProblem(task, PAPER)
        yield measure(
            f"paper trial of 10 queries, {task.name}",
            partial(_run_trial, problem),
            plain=plain_trial(problem),
        )


FIGURES: tuple[Callable[[], Iterator[Figure]], ...] = (inference, paper_trial)


def _time_inference(
    label: str, problem: PlacementProblem, demos: Sequence[Demonstration]
) -> Iterator[Figure]:
    rng, posteriors = make_rng(), list[Posterior]()
    timing = measure(
        f"inference, {label}",
        lambda: posteriors.append(problem.infer(demos, None, rng=rng)),
        plain=plain_inference(problem, demos),
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
