"""Placements for the arm, carried out side by side in several processes."""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from tablesetting.experiments.arm import Arm, Attempt
from tablesetting.experiments.config import ArmConfig
from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution
from tablesetting.planner.goal import Refusal
from tablesetting.reward.tasks import TASKS
from tablesetting.scene.scene import Snapshot
from tablesetting.workers import map_unordered


@dataclass(frozen=True)
class Order:
    """One placement that the arm is to make.

    Attributes:
        index: Tells it from others.
        layout: Object centers, shape (K, 2), in table units.
        placement: Where the item is to be put, shape (2,), in table units.
        seeds: Source of errors of the senses and of variations of the props.
    """

    index: int
    layout: Array
    placement: Array
    seeds: np.random.SeedSequence


def carry_out_all(
    task: str, arm: ArmConfig, orders: Sequence[Order], *, num_jobs: int
) -> Iterator[tuple[int, Attempt]]:
    """Let arms carry out orders, each at a table of its own.

    Args:
        task: Name of the task that says what stands on the table.
        arm: How good the arms are.
        orders: What is to be done.
        num_jobs: Processes; what comes of an order does not depend on it.

    Yields:
        The index of each order with what came of it, as soon as it is done.
    """
    work = partial(_carry_out, task, arm)
    for order, attempt in map_unordered(work, orders, num_jobs=num_jobs):
        yield order.index, attempt


def _carry_out(task: str, arm: ArmConfig, order: Order) -> Attempt:
    return _arm(task, arm).place(
        order.layout,
        order.placement,
        _unwatched,
        rng=np.random.default_rng(order.seeds),
    )


@cache
def _arm(task: str, config: ArmConfig) -> Arm:
    """One scene for each set of objects, compiled once in every process."""
    return Arm(TASKS[task].objects, TASKS[task].item, config)


def _unwatched(
    snapshots: Generator[Snapshot, None, Execution | Refusal],
) -> Generator[Snapshot, None, Execution | Refusal]:
    return snapshots
