"""Speed of learning, each figure beside the same work by the plain loops."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from itertools import islice
from statistics import fmean

import numpy as np
import plain
from figure import MIN_REPEATS, Figure, Plain, Quantity, measure

from tablesetting.experiments.validation import ValidationSet
from tablesetting.irl.active import run_active, score_active_var
from tablesetting.irl.arrays import Array
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.sampler import sample_uniform_weights
from tablesetting.reward.likelihood import BoltzmannLikelihood, Demonstration
from tablesetting.reward.problem import DEFAULT, PAPER, PlacementProblem
from tablesetting.reward.rbf import all_centers, rbf_features
from tablesetting.reward.tasks import SPOON, VASE, PlacementTask

_TASKS = (VASE, SPOON)
_NUM_CANDIDATES = 50
_NUM_REWARDS = 100
_NUM_TEST_LAYOUTS = 200
_NUM_ROUNDS = 11  # The first demonstration and ten queries.
_MISS = 0.02  # Distance from the optimum that counts as a miss, in table units.


def query() -> Iterator[Figure]:
    """Best placements of 100 posterior rewards in 50 layouts."""
    for task in _TASKS:
        weights = _posterior_rewards(task)
        for label, problem in _table_kinds(task):
            layouts = problem.space.sample(_NUM_CANDIDATES, rng=_rng())
            part = weights[:2]
            yield measure(
                f"query of 50 x 100 placements, {label}",
                partial(problem.best_placements, weights, layouts),
                plain=Plain(
                    partial(_plain_placements, problem, part, layouts),
                    share=len(part) / len(weights),
                ),
                traces_memory=True,
            )


def plain_misses() -> Iterator[Figure]:
    """How often the plain ascent ends elsewhere than at the optimum."""
    for task in _TASKS:
        weights = _posterior_rewards(task)[::10]
        for label, problem in _table_kinds(task):
            layouts = problem.space.sample(_NUM_CANDIDATES, rng=_rng())
            best = problem.best_placements(weights, layouts)
            climbed = _plain_placements(problem, weights, layouts)
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
    for task in _TASKS:
        for preset, config in (("paper", PAPER), ("default", DEFAULT)):
            problem = PlacementProblem(task, config)
            demos = _demonstrations(problem, 10)
            for num_demos in (1, 5, 10):
                label = f"{task.name}, {preset}, {num_demos} demos"
                yield from _time_inference(label, problem, demos[:num_demos])


def validation() -> Iterator[Figure]:
    """Placement errors of learned weights in 200 test layouts."""
    for task in _TASKS:
        weights = _posterior_rewards(task)[-1]
        for label, problem in _table_kinds(task):
            layouts = problem.space.sample(_NUM_TEST_LAYOUTS, rng=_rng())
            tests = ValidationSet.of_problem(problem, layouts)
            part = layouts[:50]
            yield measure(
                f"200 test layouts, {label}",
                partial(tests.placement_errors, weights),
                plain=Plain(
                    partial(_plain_placements, problem, weights[None], part),
                    share=len(part) / len(layouts),
                ),
                traces_memory=True,
            )


def paper_trial() -> Iterator[Figure]:
    """One trial of the paper's experiment: ten queries, each round validated."""
    for task in _TASKS:
        problem = PlacementProblem(task, PAPER)
        yield measure(
            f"paper trial of 10 queries, {task.name}",
            partial(_run_trial, problem),
            plain=_plain_trial(problem),
        )


FIGURES: tuple[Callable[[], Iterator[Figure]], ...] = (
    query,
    plain_misses,
    inference,
    validation,
    paper_trial,
)


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _table_kinds(task: PlacementTask) -> list[tuple[str, PlacementProblem]]:
    """Return a task with and without objects that take up room."""
    return [
        (f"{task.name}, points", PlacementProblem(task, PAPER)),
        (f"{task.name}, true size", PlacementProblem(task, DEFAULT)),
    ]


def _demonstrations(problem: PlacementProblem, num_demos: int) -> list[Demonstration]:
    layouts = problem.space.sample(num_demos, rng=_rng())
    return [problem.demonstrate(layout) for layout in layouts]


@cache
def _posterior_rewards(task: PlacementTask) -> Array:
    """Return 100 rewards as they are possible after one demonstration, shape (100, D).

    Ten in a row are from one posterior; there are ten demonstrations, each by itself.
    """
    problem = PlacementProblem(task, PAPER)
    posteriors = [
        problem.infer([demo], None, rng=_rng()) for demo in _demonstrations(problem, 10)
    ]
    return np.concatenate([posterior.weights[9::10] for posterior in posteriors])


def _rewards(
    problem: PlacementProblem, weights: Array, layouts: Array, placements: Array
) -> Array:
    """Evaluate rewards (N, D) at their placements (L, N, 2), shape (L, N)."""
    features = rbf_features(placements, all_centers(layouts), problem.widths)
    return (features * weights).sum(axis=-1)


def _plain_placements(
    problem: PlacementProblem, weights: Array, layouts: Array
) -> Array:
    """Do what `PlacementProblem.best_placements` does, one by one."""
    rng = _rng()
    best = np.empty((len(layouts), len(weights), 2))
    for i, layout in enumerate(layouts):
        space = problem.space.free_space(layout)
        for j, sample in enumerate(weights):
            rbfs = plain.make_rbfs(sample, layout, problem.widths)
            best[i, j] = plain.best_placement(rbfs, space, rng=rng)
    return best


def _time_inference(
    label: str, problem: PlacementProblem, demos: Sequence[Demonstration]
) -> Iterator[Figure]:
    rng, posteriors = _rng(), list[Posterior]()
    timing = measure(
        f"inference, {label}",
        lambda: posteriors.append(problem.infer(demos, None, rng=rng)),
        plain=_plain_inference(problem, demos),
        traces_memory=True,
    )
    yield timing
    # As many as there are on every machine, so that a slow one sees the same chains.
    ess = fmean(posterior.ess for posterior in posteriors[:MIN_REPEATS])
    yield Quantity(f"ESS per second, {label}", ess / timing.seconds_median, "1/s")


def _plain_inference(
    problem: PlacementProblem, demos: Sequence[Demonstration], num_steps: int = 10
) -> Plain:
    """Prepare a few steps of a plain chain with the same likelihood."""
    config, mcmc = problem.config.boltzmann, problem.config.mcmc
    spaces = [problem.space.free_space(demo.layout) for demo in demos]
    nodes = [_free_nodes(*config.nodes(space)) for space in spaces]
    log_post = partial(
        plain.log_likelihood,
        demos=demos,
        nodes=nodes,
        widths=problem.widths,
        beta=config.beta,
    )
    start = sample_uniform_weights(1, len(problem.widths), rng=_rng())
    fast = BoltzmannLikelihood(demos, spaces, problem.widths, config)
    np.testing.assert_allclose(log_post(start[0]), fast(start)[0], rtol=1e-9)
    chain = partial(plain.run_chain, log_post, start[0], num_steps, mcmc.step_std)
    return Plain(
        lambda: chain(rng=_rng()), share=num_steps / (mcmc.num_chains * mcmc.num_steps)
    )


def _free_nodes(points: Array, areas: Array) -> list[plain.Node]:
    """List the terms of a normaliser whose area is not 0."""
    columns = np.column_stack([points, areas])[areas > 0.0]
    return [tuple(row) for row in columns.tolist()]


def _run_trial(problem: PlacementProblem) -> list[Array]:
    """Learn with ten queries; return the errors of every round."""
    rng = _rng()
    layouts = problem.space.sample(_NUM_TEST_LAYOUTS, rng=rng)
    tests = ValidationSet.of_problem(problem, layouts)
    first = _demonstrations(problem, 1)
    rounds = run_active(problem, first, score_active_var, problem.config.risk, rng=rng)
    errors = [
        tests.placement_errors(latest.posterior.map_weights)
        for latest in islice(rounds, _NUM_ROUNDS)
    ]
    assert errors[-1].mean() < errors[0].mean(), "ten queries taught nothing"
    return errors


def _plain_trial(problem: PlacementProblem) -> Plain:
    """Prepare the mean round of a trial in part: six demonstrations are the mean.

    A round takes one chain, and placements for the MAP and 100 samples in 50 layouts and
    for the MAP in 200 more; each part is done to the same share.
    """
    share = 0.01
    num_placements = (_NUM_REWARDS + 1) * _NUM_CANDIDATES + _NUM_TEST_LAYOUTS
    demos = _demonstrations(problem, (_NUM_ROUNDS + 1) // 2)
    chain = _plain_inference(
        problem, demos, num_steps=round(share * problem.config.mcmc.num_steps)
    )
    layouts = problem.space.sample(round(share * num_placements), rng=_rng())
    weights = _posterior_rewards(problem.task)[-1:]

    def work() -> None:
        chain.work()
        _plain_placements(problem, weights, layouts)

    return Plain(work, share=share / _NUM_ROUNDS)
