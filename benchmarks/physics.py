"""Speed of planning and simulation."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from statistics import median
from time import perf_counter, process_time

import mujoco
import numpy as np
from figure import Figure, Quantity, cpu_seconds, measure, summarize

from tablesetting.experiments.arm import Arm
from tablesetting.experiments.config import ArmConfig, TaskName
from tablesetting.experiments.execution_study import Request, draw_request
from tablesetting.experiments.studies import run_trial
from tablesetting.experiments.study_config import ExecutionStudyConfig, GoalName
from tablesetting.experiments.trials import Trial, all_trials
from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution, run_to_end
from tablesetting.planner.pick_place import Plan, plan
from tablesetting.planner.place import place
from tablesetting.recording import RunCard, RunRecorder
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.tasks import TASKS
from tablesetting.scene.scene import Scene
from tablesetting.workers import map_unordered

_CASES: tuple[tuple[TaskName, GoalName], ...] = (
    ("vase", "table"),
    ("spoon", "table"),
    ("spoon", "bowl"),
)
_MODES = {
    "precise": ArmConfig(),
    "fast": ArmConfig(fast=True),
    "real servos": ArmConfig(servos="real"),
}
_NUM_LAYOUTS = 20
_NUM_TRIALS = 60  # For each number of processes.


@dataclass(frozen=True)
class _Bench:
    """An arm, and random placements for it to make.

    Attributes:
        arm: At its table.
        layouts: Object centers, shape (L, K, 2), in table units.
        requests: What to ask for in each.
    """

    arm: Arm
    layouts: Array
    requests: list[Request]

    def lay(self, index: int) -> Request:
        """Lay a table; return what to ask for."""
        self.arm.lay(self.layouts[index], rng=np.random.default_rng(index))
        return self.requests[index]


@dataclass(frozen=True)
class _Episode:
    """What came of one placement, and the processor time of planning and motion."""

    execution: Execution
    seconds: float


def compilation() -> Iterator[Figure]:
    """A scene from its parts to a model, once per run."""
    for task in TASKS.values():
        yield measure(
            f"compile the scene, {task.name}", partial(Scene, task.objects, task.item)
        )


def planning() -> Iterator[Figure]:
    """A whole pick and place, checked for collisions."""
    for task, goal in _CASES:
        bench = _bench(task, goal, "precise")
        seconds = []
        for index in range(_NUM_LAYOUTS):
            request = bench.lay(index)
            work = partial(plan, bench.arm.scene, request.target, request.yaw)
            assert isinstance(work(), Plan), f"layout {index}: {work()}"
            seconds.append(cpu_seconds(work))
        yield summarize(f"plan, {task}, {goal}", seconds)
        yield _percentile(f"plan, {task}, {goal}, 95 %", seconds)


def episode() -> Iterator[Figure]:
    """Plan and carry out, recorded by nobody, with a compiled scene."""
    for mode in _MODES:
        for task, goal in _CASES:
            bench = _bench(task, goal, mode)
            episodes = [_run_episode(bench, index) for index in range(_NUM_LAYOUTS)]
            seconds = [each.seconds for each in episodes]
            durations = [each.execution.duration for each in episodes]
            factors = np.array(durations) / np.array(seconds)
            steps = median(durations) / bench.arm.scene.model.opt.timestep
            name = f"{task}, {goal}, {mode}"
            yield summarize(f"episode, {name}", seconds)
            yield _percentile(f"episode, {name}, 95 %", seconds)
            yield Quantity(f"steps of an episode, {name}", round(steps), "")
            yield Quantity(f"real-time factor, {name}", median(factors), "x")


def recorded_episode() -> Iterator[Figure]:
    """The same episodes as a run has them, laid and recorded."""
    for task, goal in _CASES:
        bench = _bench(task, goal, "precise")
        scene = bench.arm.scene
        card = RunCard(task, "", 0, scene.objects, scene.item, {})
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "recording.rrd"
            with RunRecorder(path, scene.model, card, recording_id=task) as recorder:
                seconds = [
                    cpu_seconds(partial(_record_episode, bench, recorder, index))
                    for index in range(_NUM_LAYOUTS)
                ]
        yield summarize(f"episode, recorded, {task}, {goal}", seconds)


def sleeping() -> Iterator[Figure]:
    """One step of an episode, with things at rest asleep and kept awake."""
    for task, goal in _CASES[:2]:
        bench = _bench(task, goal, "precise")
        yield _step_time(f"step, {task}, sleeping", bench)
        with _kept_awake(bench.arm.scene.model):
            yield _step_time(f"step, {task}, kept awake", bench)


def processes() -> Iterator[Figure]:
    """Many episodes at once, wall time, each process with one scene of its own."""
    rates = {}
    for num_jobs in (1, 2):
        config = ExecutionStudyConfig(
            tasks=("vase",), goals=("table",), num_trials=_NUM_TRIALS
        )
        work = partial(run_trial, config)
        done = map_unordered(work, all_trials(config), num_jobs=num_jobs)
        next(done)  # Until then the processes start.
        started = perf_counter()
        num_done = sum(1 for _ in done)
        rates[num_jobs] = num_done / (perf_counter() - started)
        yield Quantity(f"episodes, vase, {num_jobs} process(es)", rates[num_jobs], "/s")
    yield Quantity("episodes, 2 processes against 1", rates[2] / rates[1], "x")


FIGURES: tuple[Callable[[], Iterator[Figure]], ...] = (
    compilation,
    planning,
    episode,
    recorded_episode,
    sleeping,
    processes,
)


@cache
def _bench(task: TaskName, goal: GoalName, mode: str) -> _Bench:
    """Draw layouts and places as the execution study does."""
    arm = Arm(TASKS[task].objects, TASKS[task].item, _MODES[mode])
    space = LayoutSpace.of_task(TASKS[task], are_points=False)
    rng = np.random.default_rng(0)
    layouts = space.sample(_NUM_LAYOUTS, rng=rng)
    requests = []
    for index, layout in enumerate(layouts):
        arm.lay(layout, rng=rng)
        trial = Trial(task, index)
        requests.append(draw_request(goal, arm.scene, trial, rng=rng))
    return _Bench(arm, layouts, requests)


def _run_episode(bench: _Bench, index: int) -> _Episode:
    request = bench.lay(index)
    started = process_time()
    execution = run_to_end(place(bench.arm.scene, request.target, request.yaw))
    seconds = process_time() - started
    assert isinstance(execution, Execution), f"layout {index}: {execution}"
    assert execution.success, f"layout {index}: {execution.failure}"
    return _Episode(execution, seconds)


def _record_episode(bench: _Bench, recorder: RunRecorder, index: int) -> None:
    request = bench.lay(index)
    running = place(bench.arm.scene, request.target, request.yaw)
    outcome = run_to_end(recorder.record(running))
    assert isinstance(outcome, Execution), f"layout {index}: {outcome}"


def _percentile(name: str, seconds: list[float]) -> Quantity:
    return Quantity(name, 1e3 * float(np.percentile(seconds, 95.0)), "ms")


def _step_time(name: str, bench: _Bench) -> Quantity:
    """Take the least of the episodes; control and checks are included."""
    timestep = bench.arm.scene.model.opt.timestep
    episodes = [_run_episode(bench, index) for index in range(_NUM_LAYOUTS)]
    per_step = [
        episode.seconds * timestep / episode.execution.duration for episode in episodes
    ]
    return Quantity(name, 1e6 * min(per_step), "us")


@contextmanager
def _kept_awake(model: mujoco.MjModel) -> Iterator[None]:
    flags = model.opt.enableflags
    model.opt.enableflags = flags & ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    try:
        yield
    finally:
        model.opt.enableflags = flags
