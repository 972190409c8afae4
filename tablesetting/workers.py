"""The same function of many items, in processes of which each may die.

A pool of the standard library breaks or hangs when the system kills one of its
processes. Here that costs one item another try.
"""

import signal
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from time import monotonic
from typing import TypeVar

from tablesetting.errors import WorkerDied
from tablesetting.worker import GRACE, Worker, interrupts_held, result_of

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")

_MAX_TRIES = 3
_MAX_NAME = 200  # Characters of an item in a message.


def map_unordered(
    function: Callable[[ItemT], ResultT], items: Sequence[ItemT], *, num_jobs: int
) -> Iterator[tuple[ItemT, ResultT]]:
    """Apply a function to every item, in up to `num_jobs` processes.

    However it is left, by an error, Ctrl-C or `close`, the processes are gone then.

    Args:
        function: Stands at the top of a module, so that it can be pickled.
        items: Are begun in this order; can be pickled, as can the results.
        num_jobs: Number of processes; with 1, all is done in this one.

    Yields:
        Each item with its result, as soon as it is done.

    Raises:
        WorkerDied: If processes die at every try of an item.
    """
    if num_jobs < 1:
        raise ValueError(f"`num_jobs` must be at least 1; got {num_jobs}")
    if min(num_jobs, len(items)) <= 1:
        for item in items:
            yield item, function(item)
        return
    crew = _Crew()
    indices = iter(range(len(items)))
    deaths = Counter[int]()
    try:
        for index in islice(indices, num_jobs):
            crew.hire().give(index, (function, items[index]))
        while crew.workers:
            for worker in crew.ready():
                index, answer = worker.index, worker.answer()
                if answer is None:
                    crew.dismiss([worker])
                    # Any death is the item's, or dying at the start would never end.
                    deaths[index] += 1
                    if deaths[index] == _MAX_TRIES:
                        raise _worker_died(items[index], worker.process.exitcode)
                    crew.hire().give(index, (function, items[index]))
                    continue
                # The worker goes on while the caller sees to the result.
                following = next(indices, None)
                if following is None:
                    crew.dismiss([worker])
                else:
                    worker.give(following, (function, items[following]))
                yield items[index], result_of(answer)
    finally:
        crew.dismiss(crew.workers)


class _Crew:
    """The workers there are.

    Attributes:
        workers: Every one has an item.
    """

    def __init__(self) -> None:
        self.workers: list[Worker] = []
        # Else the first start does it, and lets Ctrl-C through on that occasion.
        resource_tracker.ensure_running()

    def hire(self) -> Worker:
        """Start a worker."""
        with interrupts_held():
            self.workers.append(Worker())
        return self.workers[-1]

    def ready(self) -> list[Worker]:
        """Wait until some worker has answered or died; return all that have."""
        ready = wait([worker.connection for worker in self.workers])
        return [worker for worker in self.workers if worker.connection in ready]

    def dismiss(self, workers: Sequence[Worker]) -> None:
        """End workers, whatever they do, and wait until they are gone."""
        with interrupts_held():
            for worker in workers:
                worker.connection.close()
                worker.process.terminate()
            deadline = monotonic() + GRACE
            for worker in workers:
                worker.process.join(max(0.0, deadline - monotonic()))
                worker.process.kill()
                worker.process.join()
            self.workers = [kept for kept in self.workers if kept not in workers]


def _worker_died(item: object, exit_code: int | None) -> WorkerDied:
    name = repr(item)
    if len(name) > _MAX_NAME:
        name = f"{name[:_MAX_NAME]}..."
    end = f"exit code {exit_code}"
    if exit_code is not None and exit_code < 0:
        end = f"signal {-exit_code}, {signal.strsignal(-exit_code)}"
    return WorkerDied(
        f"{_MAX_TRIES} processes died at {name}, the last of {end}; free some memory "
        "or lower --jobs, and go on with --resume: what is finished is kept"
    )
