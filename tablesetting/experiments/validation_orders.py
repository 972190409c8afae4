"""The arm carries out what learned weights want in test layouts."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from tablesetting.experiments.arm import Attempt
from tablesetting.experiments.orders import Order, carry_out_all
from tablesetting.experiments.validate import Validation
from tablesetting.irl.arrays import Array
from tablesetting.reward.config import DEFAULT
from tablesetting.reward.files import LearnedReward
from tablesetting.reward.problem import PlacementProblem


def execute_orders(
    validation: Validation, done: Collection[int], num_jobs: int
) -> Iterator[tuple[int, dict[str, object]]]:
    """Let the arm do what is not done yet: each reward's wish, where it fits.

    Args:
        validation: Says in how many layouts it acts.
        done: Rows that are there already.
        num_jobs: Processes.

    Yields:
        The number of each row with the cells that it gets.
    """
    orders = [order for order in _orders(validation) if order.index not in done]
    for index, attempt in carry_out_all(
        validation.task.name, validation.config.arm, orders, num_jobs=num_jobs
    ):
        yield index, _cells(attempt)


def _orders(validation: Validation) -> list[Order]:
    """List all orders; two rewards meet the same senses and props in a layout."""
    config, num_rewards = validation.config, len(validation.rewards)
    seeds = np.random.SeedSequence(config.seed, spawn_key=(1,)).spawn(config.execute)
    layouts = validation.layouts[: config.execute]
    return [
        Order(index * num_rewards + which, layout, fit(layout), seeds[index])
        for which, fit in enumerate(map(_fitter, validation.rewards))
        for index, layout in enumerate(layouts)
    ]


def _fitter(reward: LearnedReward) -> Callable[[Array], Array]:
    """Return what finds the best place where the item fits, in a layout."""
    problem = PlacementProblem(reward.task, replace(DEFAULT, widths=reward.widths))
    return partial(problem.best_free_placement, reward.weights)


def _cells(attempt: Attempt) -> dict[str, object]:
    settled = (None, None) if attempt.settled is None else attempt.settled
    return {
        "commanded_x": attempt.commanded[0],
        "commanded_y": attempt.commanded[1],
        "settled_x": settled[0],
        "settled_y": settled[1],
        "execution_error_mm": attempt.error_mm,
        "bystander_shift_mm": attempt.max_bystander_shift_mm,
        "success": int(attempt.failure is None),
        "failure": attempt.failure,
    }
