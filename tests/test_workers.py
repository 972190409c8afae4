import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import pytest
import worker_tasks
from worker_tasks import Task

from tablesetting import workers
from tablesetting.errors import WorkerDied
from tablesetting.workers import map_unordered


def tasks_in(folder, numbers, fatal=None):
    return [Task(number, folder, number == fatal) for number in numbers]


def wait_until(is_so, seconds=30.0):
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@contextmanager
def sleepers(folder):
    """Run a program whose two workers sleep, in a process group of its own.

    All processes hold its pipes, so these end only when the last one is gone.
    """
    with subprocess.Popen(
        [sys.executable, worker_tasks.__file__, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as program:
        wait_until((folder / "begun").exists)
        try:
            yield program
        finally:
            with suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)


@pytest.fixture
def interruptible():
    """Ctrl-C reaches Python, and another thread than the main one may get it."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    over = threading.Event()
    other = threading.Thread(target=over.wait)
    other.start()
    yield
    over.set()
    other.join()
    signal.signal(signal.SIGINT, handler)


def run_script(text, folder):
    script = folder / "script.py"
    script.write_text(text)
    return subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=60.0
    )


@pytest.mark.parametrize("num_jobs", [1, 3])
def test_every_item_comes_once_with_its_result(num_jobs):
    done = list(map_unordered(worker_tasks.square, range(10), num_jobs=num_jobs))
    assert sorted(done) == [(number, number**2) for number in range(10)]
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(("items", "num_jobs"), [([4, 5], 1), ([4], 8), ([], 8)])
def test_one_job_or_one_item_stays_in_this_process(items, num_jobs):
    done = list(map_unordered(worker_tasks.own_pid, items, num_jobs=num_jobs))
    assert done == [(item, os.getpid()) for item in items]


def test_several_jobs_are_as_many_other_processes():
    done = dict(map_unordered(worker_tasks.own_pid, range(9), num_jobs=2))
    assert len(set(done.values()) - {os.getpid()}) == 2


def test_no_jobs_are_refused():
    with pytest.raises(ValueError, match="at least 1; got 0"):
        next(map_unordered(worker_tasks.square, [1, 2], num_jobs=0))


def test_data_larger_than_any_pipe_goes_both_ways():
    items = [bytes([number]) * 1_000_000 for number in range(3)]
    done = list(map_unordered(worker_tasks.double, items, num_jobs=2))
    assert sorted(done) == [(item, item + item) for item in items]


def test_a_killed_worker_costs_its_item_a_second_try_and_nothing_else(tmp_path):
    tasks = tasks_in(tmp_path, range(6), fatal=2)
    done = dict(map_unordered(worker_tasks.die_at_first, tasks, num_jobs=2))
    assert done == {task: task.number**2 for task in tasks}
    assert [task.num_tries for task in tasks] == [1, 1, 2, 1, 1, 1]


def test_three_deaths_at_one_item_are_an_error_that_names_it(tmp_path):
    tasks, done = tasks_in(tmp_path, range(3), fatal=2), []
    results = map_unordered(worker_tasks.die_always, tasks, num_jobs=2)
    with pytest.raises(WorkerDied) as caught:
        done.extend(results)
    for text in ("number=2", "3 processes", "exit code 3", "--jobs", "--resume"):
        assert text in str(caught.value)
    assert tasks[2].num_tries == 3
    assert done  # Somebody was done with another one before.
    assert set(done) <= {(tasks[0], 0), (tasks[1], 1)}
    assert multiprocessing.active_children() == []


def test_the_name_of_a_killed_item_is_cut_short_and_the_signal_told(tmp_path):
    items = [f"{number}{'x' * 5000}" for number in range(2)]
    with pytest.raises(WorkerDied, match=r"'0x+\.\.\., .* signal 9, Killed") as caught:
        list(map_unordered(worker_tasks.be_killed_at_zero, items, num_jobs=2))
    assert len(str(caught.value)) < 500


def test_a_worker_that_dies_between_two_items_is_replaced(tmp_path):
    tasks = tasks_in(tmp_path, range(5), fatal=0)
    done = {}
    for task, result in map_unordered(worker_tasks.die_soon_after, tasks, num_jobs=2):
        done[task] = result
        time.sleep(0.1)
    assert done == {task: task.number**2 for task in tasks}


def test_workers_that_all_die_at_their_start_are_an_error(tmp_path):
    script = """
import os
from operator import neg
from tablesetting.workers import map_unordered
if __name__ == "__mp_main__":
    os._exit(7)
if __name__ == "__main__":
    list(map_unordered(neg, range(4), num_jobs=2))
"""
    error = run_script(script, tmp_path).stderr
    assert "WorkerDied: 3 processes died at" in error
    assert "exit code 7" in error


def test_an_error_arrives_as_it_was_raised_with_the_place_in_a_note():
    results = map_unordered(worker_tasks.refuse_two, range(5), num_jobs=2)
    with pytest.raises(worker_tasks.Particular) as caught:
        list(results)
    assert str(caught.value) == "no 2"
    assert "in refuse_two" in caught.value.__notes__[0]
    assert multiprocessing.active_children() == []


def test_an_error_that_cannot_be_sent_arrives_as_its_text():
    results = map_unordered(worker_tasks.refuse_peculiarly, [1, 2], num_jobs=2)
    with pytest.raises(RuntimeError, match=r"^Peculiar: . is not at home") as caught:
        list(results)
    assert "in refuse_peculiarly" in caught.value.__notes__[0]


def test_a_result_that_cannot_be_sent_is_an_error_not_a_death():
    results = map_unordered(worker_tasks.return_a_lambda, [1, 2], num_jobs=2)
    with pytest.raises((AttributeError, pickle.PicklingError), match="lambda"):
        list(results)


@pytest.mark.parametrize("sleep", ["sleep_long", "sleep_stubbornly"])
def test_no_worker_outlives_a_closed_generator(tmp_path, monkeypatch, sleep):
    monkeypatch.setattr(workers, "GRACE", 0.5)
    tasks = tasks_in(tmp_path, range(3))
    results = map_unordered(getattr(worker_tasks, sleep), tasks, num_jobs=2)
    with closing(results):
        next(results)
        wait_until(lambda: tasks[1].num_tries and tasks[2].num_tries)
        closed_at = time.monotonic()
    assert multiprocessing.active_children() == []
    assert time.monotonic() - closed_at < 30.0  # They would sleep for a minute.


def test_workers_do_not_outlive_a_killed_parent(tmp_path):
    with sleepers(tmp_path) as program:
        wait_until(lambda: len(list(tmp_path.glob("*-*"))) == 2)
        program.kill()
        assert program.communicate(timeout=30.0) == ("", "")


@pytest.mark.parametrize("delay", [0.0, 0.02, 0.1, None])
def test_an_interrupt_is_told_once_and_ends_all(tmp_path, delay):
    """After a delay, while the workers start, or else at their work."""
    with sleepers(tmp_path) as program:
        if delay is None:
            wait_until(lambda: len(list(tmp_path.glob("*-*"))) == 2)
        else:
            time.sleep(delay)
        os.killpg(program.pid, signal.SIGINT)
        _, error = program.communicate(timeout=30.0)
    assert program.returncode == -signal.SIGINT
    assert error.count("Traceback") == 1
    assert error.endswith("KeyboardInterrupt\n")
    assert "SpawnProcess" not in error


def test_no_worker_sees_an_interrupt_the_first_one_included(tmp_path):
    script = f"""
import sys
sys.path.append({str(Path(worker_tasks.__file__).parent)!r})
import worker_tasks
from tablesetting.workers import map_unordered
if __name__ == "__main__":
    seen = dict(map_unordered(worker_tasks.sees_interrupts, range(2), num_jobs=2))
    print(*seen.values(), worker_tasks.sees_interrupts(0))
"""
    assert run_script(script, tmp_path).stdout == "False False True\n"


def test_an_interrupt_waits_until_a_started_worker_is_known(interruptible, monkeypatch):
    started = []

    class Interrupted(workers.Worker):
        def __init__(self):
            os.kill(os.getpid(), signal.SIGINT)
            super().__init__()
            started.append(self)

    monkeypatch.setattr(workers, "Worker", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        list(map_unordered(worker_tasks.square, range(4), num_jobs=2))
    assert len(started) == 1
    assert multiprocessing.active_children() == []
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_workers_keep_to_one_thread_from_their_first_import_on(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    before = dict(os.environ)
    done = dict(map_unordered(worker_tasks.thread_settings, range(2), num_jobs=2))
    assert list(done.values()) == [["1"] * 4] * 2
    assert dict(os.environ) == before


def test_the_main_module_is_imported_with_one_thread_too(tmp_path):
    script = """
import os
import numpy as np
THREADS = os.environ.get("OPENBLAS_NUM_THREADS"), len(os.listdir("/proc/self/task"))
from tablesetting.workers import map_unordered
def tell(number):
    return THREADS
if __name__ == "__main__":
    print(*dict(map_unordered(tell, range(2), num_jobs=2)).values())
"""
    assert run_script(script, tmp_path).stdout == "('1', 1) ('1', 1)\n"


def test_nothing_heavy_is_imported_with_the_module():
    code = "import sys, tablesetting.workers; print('numpy' in sys.modules)"
    command = [sys.executable, "-c", code]
    assert subprocess.check_output(command, text=True) == "False\n"
