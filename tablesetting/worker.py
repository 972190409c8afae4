"""A process that computes one item after the other for the one that started it."""

import contextlib
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from types import FrameType
from typing import Any

GRACE = 2.0
"""Seconds from the request to end until the kill."""

# The workers share the cores already: more threads would only spin.
_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OPENBLAS", "OMP", "MKL", "NUMBA")
}


class Worker:
    """A process that computes one item after the other.

    Attributes:
        process: The process.
        connection: This end of the pipe to it.
        index: Which item it has.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, its_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(its_end,), daemon=True)
        self.index = -1
        with _one_thread_each():
            self.process.start()
        its_end.close()  # So that the pipe ends with the worker.

    def give(self, index: int, work: tuple[Callable[[Any], Any], Any]) -> None:
        """Hand an item over."""
        self.index = index
        message = pickle.dumps(work)
        # If the worker has died, that shows when its answer is awaited.
        with contextlib.suppress(OSError):
            self.connection.send_bytes(message)

    def answer(self) -> bytes | None:
        """Take the answer that is there; None if the worker died instead."""
        try:
            return self.connection.recv_bytes()
        except (EOFError, OSError):
            self.process.join(GRACE)  # The pipe ends a little before the process.
            return None


def _serve(connection: Connection) -> None:
    """Answer until nobody asks or listens; this is what a worker does."""
    threading.Thread(target=_exit_with_parent, daemon=True).start()
    with contextlib.suppress(EOFError, OSError):
        while True:
            connection.send_bytes(_answer_to(connection.recv_bytes()))


def _exit_with_parent() -> None:
    """Leave even a long item once nobody waits for it."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _answer_to(message: bytes) -> bytes:
    """Compute an item; returns what `result_of` turns into its result or its error."""
    try:
        function, item = pickle.loads(message)
        return pickle.dumps((function(item), None))
    except BaseException as error:
        return pickle.dumps((None, _portable(error)))


def _portable(error: BaseException) -> BaseException:
    """Return an error that survives the pipe and tells where it comes from."""
    try:
        copy = pickle.loads(pickle.dumps(error))
    except Exception:
        copy = RuntimeError(f"{type(error).__name__}: {error}")
    report = "".join(traceback.format_exception(error))
    copy.add_note(f"In a worker process:\n{report}")
    return copy


def result_of(answer: bytes) -> Any:
    """Return the result in an answer, or raise the error."""
    result, error = pickle.loads(answer)
    if error is not None:
        raise error
    return result


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Let Ctrl-C wait until the block is left; processes started in it never see it.

    They inherit the mask. Here it is not enough: if another thread gets the signal,
    Python calls the handler in the main thread all the same.
    """
    held: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:
        held.append(number)

    mask = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    handler = signal.getsignal(signal.SIGINT)
    is_main = threading.current_thread() is threading.main_thread()
    if is_main and callable(handler):
        signal.signal(signal.SIGINT, hold)
    try:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if is_main and callable(handler):
            signal.signal(signal.SIGINT, handler)
        if held:
            signal.raise_signal(signal.SIGINT)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes started in the block keep to one thread.

    A worker could not do so itself: its libraries look when they are imported, which
    may be by the main module, before any work.
    """
    before = {name: os.environ[name] for name in _ONE_THREAD if name in os.environ}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name in _ONE_THREAD:
            os.environ.pop(name, None)
        os.environ.update(before)
