"""What workers are told to do in tests; as a script, two workers sleep."""

import os
import signal
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from tablesetting.workers import map_unordered

NAMES = [f"{name}_NUM_THREADS" for name in ("OPENBLAS", "OMP", "MKL", "NUMBA")]
SETTINGS_AT_IMPORT = [os.environ.get(name) for name in NAMES]


@dataclass(frozen=True)
class Task:
    """A number, and a folder that gets a mark whenever it is worked on."""

    number: int
    folder: Path
    is_fatal: bool = False

    @property
    def num_tries(self):
        return len(list(self.folder.glob(f"{self.number}-*")))

    def mark(self):
        os.close(tempfile.mkstemp(prefix=f"{self.number}-", dir=self.folder)[0])


class Particular(Exception):
    """An error that can be sent."""


class Peculiar(Exception):
    """An error that cannot be made anew from its message."""

    def __init__(self, number, place):
        super().__init__(f"{number} is not at {place}")


def square(number):
    return number**2


def own_pid(number):
    return os.getpid()


def square_marked(task):
    task.mark()
    return task.number**2


def die_at_first(task):
    task.mark()
    if task.is_fatal and task.num_tries == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return task.number**2


def die_always(task):
    task.mark()
    if task.is_fatal:
        os._exit(3)
    return task.number**2


def be_killed_at_zero(text):
    if text.startswith("0"):
        os.kill(os.getpid(), signal.SIGKILL)


def die_soon_after(task):
    task.mark()
    if task.is_fatal and task.num_tries == 1:
        threading.Timer(0.05, os._exit, [3]).start()
    return task.number**2


def refuse_two(number):
    if number == 2:
        raise Particular(f"no {number}")
    return number


def refuse_peculiarly(number):
    raise Peculiar(number, "home")


def return_a_lambda(number):
    return lambda: number


def double(data):
    return data + data


def sees_interrupts(number):
    return signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def thread_settings(number):
    return SETTINGS_AT_IMPORT


def sleep_stubbornly(task):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sleep_long(task)


def sleep_long(task):
    if task.number > 0:
        task.mark()
        time.sleep(60.0)


def main(folder):
    # A program in the background of a shell inherits that interrupts are ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    # Such as a progress bar has; it may be the one to get a signal.
    threading.Thread(target=threading.Event().wait, daemon=True).start()
    (folder / "begun").touch()
    tasks = [Task(number, folder) for number in (1, 2, 3)]
    list(map_unordered(sleep_long, tasks, num_jobs=2))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
