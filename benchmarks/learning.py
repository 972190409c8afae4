"""Speed of inference and of a trial, beside the same work in plain numpy."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from statistics import fmean

from cases import NUM_ROUNDS, NUM_TEST_LAYOUTS, TASKS, demonstrations, make_rng
from figure import MIN_REPEATS, Figure, Plain, Quantity, measure
from plain_work import plain_inference, plain_trial

from tablesetting.experiments.validation import ValidationSet
from tablesetting.irl.active import run_active
from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.strategies import STRATEGIES, score_active_var
from tablesetting.reward.config import DEFAULT, PAPER
from tablesetting.reward.inference import MODELS
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.problem import PlacementProblem


def paper_inference() -> Iterator[Figure]:
    """The paper's chain after 1, 5 and 10 demonstrations."""
    for task in TASKS:
        problem = PlacementProblem(task, PAPER)
        demos = demonstrations(problem, 10)
        for num_demos in (1, 5, 10):
            label = f"{task.name}, paper, {num_demos} demos"
            yield from _time_inference(
                label,
                problem,
                demos[:num_demos],
                plain=plain_inference(problem, demos[:num_demos]),
            )


def inference() -> Iterator[Figure]:
    """To 400 effective samples, and to an R-hat of 1.01 as well, as runs do."""
    for task in TASKS:
        for likelihood in MODELS:
            config = replace(DEFAULT, likelihood=likelihood, are_points=True)
            to_ess = replace(config, mcmc=replace(config.mcmc, max_rhat=10.0))
            problem = PlacementProblem(task, config)
            demos = demonstrations(problem, 10)
            for num_demos in (1, 5, 10):
                label = f"{task.name}, {likelihood}, {num_demos} demos"
                shown = demos[:num_demos]
                yield from _time_inference(
                    f"ESS 400, {label}", PlacementProblem(task, to_ess), shown
                )
                yield from _time_inference(f"mixed, {label}", problem, shown)


def queries() -> Iterator[Figure]:
    """Choose among 50 layouts after 3 demonstrations; the placements of all included."""
    for task in TASKS:
        for likelihood in MODELS:
            config = replace(DEFAULT, likelihood=likelihood, are_points=True)
            deployment = LayoutSpace.of_task(task, are_points=True).sample(
                32, rng=make_rng()
            )
            problem = PlacementProblem(task, config, deployment=deployment)
            demos = demonstrations(problem, 3)
            posterior = problem.infer(demos, None, rng=make_rng())
            candidates = problem.propose_queries(demos, rng=make_rng())
            for name in ("active-var", "information-gain", "placement-equivalence"):
                yield measure(
                    f"query by {name}, {task.name}, {likelihood}",
                    partial(_score, problem, candidates, posterior, name),
                )


def _score(
    problem: PlacementProblem,
    candidates: Sequence[Array],
    posterior: Posterior,
    name: str,
) -> Array:
    """Score candidates by a strategy, with nothing worked out yet."""
    outlook = problem.outlook(candidates, posterior)
    return STRATEGIES[name](outlook, problem.config.risk, make_rng())


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
    paper_inference,
    inference,
    queries,
    paper_trial,
)


def _time_inference(
    label: str,
    problem: PlacementProblem,
    demos: Sequence[Demonstration],
    plain: Plain | None = None,
) -> Iterator[Figure]:
    rng, posteriors = make_rng(), list[Posterior]()
    timing = measure(
        f"inference, {label}",
        lambda: posteriors.append(problem.infer(demos, None, rng=rng)),
        plain=plain,
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
        tests.placement_errors(latest.posterior.guessed_weights)
        for latest in islice(rounds, NUM_ROUNDS)
    ]
    assert errors[-1].mean() < errors[0].mean(), "ten queries taught nothing"
    return errors
