"""Speed of planning and simulation."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from statistics import median
from time import process_time

import mujoco
import numpy as np
from figure import Figure, Quantity, cpu_seconds, measure, summarize

from tablesetting.experiments.arm import place
from tablesetting.irl.arrays import Array
from tablesetting.planner.execute import Execution, execute, run_to_end
from tablesetting.planner.pick_place import Plan, plan
from tablesetting.recording import RunCard, RunRecorder
from tablesetting.reward.config import DEFAULT
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import SPOON, VASE, PlacementTask
from tablesetting.scene.scene import Scene

_TASKS = (VASE, SPOON)
_NUM_LAYOUTS = 10


@dataclass(frozen=True)
class _Bench:
    """A scene, and placements that its arm can make.

    Attributes:
        scene: The table.
        layouts: Object centers, shape (L, K, 2), in table units.
        targets: Where to put the item in each, shape (L, 2), in [m].
    """

    scene: Scene
    layouts: Array
    targets: Array

    def plan(self, index: int) -> Plan:
        """Lay a table and plan."""
        self.scene.reset(self.layouts[index])
        found = plan(self.scene, self.targets[index])
        assert isinstance(found, Plan), f"layout {index}: {found}"
        return found


@dataclass(frozen=True)
class _Episode:
    """What came of one placement, and the processor time of its simulation."""

    execution: Execution
    seconds: float


def compilation() -> Iterator[Figure]:
    """A scene from its parts to a model, once per run."""
    for task in _TASKS:
        yield measure(
            f"compile the scene, {task.name}", partial(Scene, task.objects, task.item)
        )


def planning() -> Iterator[Figure]:
    """A whole pick and place, checked for collisions."""
    for task in _TASKS:
        bench = _bench(task)
        seconds = []
        for layout, target in zip(bench.layouts, bench.targets, strict=True):
            bench.scene.reset(layout)
            seconds.append(cpu_seconds(partial(plan, bench.scene, target)))
        yield summarize(f"plan a placement, {task.name}", seconds)


def episode() -> Iterator[Figure]:
    """Lay the table, plan and carry the plan out, recorded by nobody."""
    for task in _TASKS:
        bench = _bench(task)
        seconds, factors = [], []
        for index in range(_NUM_LAYOUTS):
            started = process_time()
            result = _run_episode(bench, index)
            seconds.append(process_time() - started)
            assert result.execution.success, result.execution.failure
            factors.append(result.execution.duration / result.seconds)
        yield summarize(f"one episode, {task.name}", seconds)
        yield Quantity(f"real-time factor, {task.name}", median(factors), "x")


def recorded_episode() -> Iterator[Figure]:
    """The same episodes as a run has them, recorded."""
    for task in _TASKS:
        bench = _bench(task)
        card = RunCard(task.name, "", 0, task.objects, task.item, {})
        placements = bench.scene.frame.from_world(bench.targets)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "recording.rrd"
            with RunRecorder(
                path, bench.scene.model, card, recording_id=task.name
            ) as recorder:
                seconds = [
                    cpu_seconds(partial(place, bench.scene, recorder, *pair))
                    for pair in zip(bench.layouts, placements, strict=True)
                ]
        yield summarize(f"one episode, recorded, {task.name}", seconds)


def sleeping() -> Iterator[Figure]:
    """One step of an episode, with things at rest asleep and kept awake."""
    for task in _TASKS:
        bench = _bench(task)
        yield _step_time(f"step, {task.name}, sleeping", bench)
        with _kept_awake(bench.scene.model):
            yield _step_time(f"step, {task.name}, kept awake", bench)


FIGURES: tuple[Callable[[], Iterator[Figure]], ...] = (
    compilation,
    planning,
    episode,
    recorded_episode,
    sleeping,
)


@cache
def _bench(task: PlacementTask) -> _Bench:
    """Let the person's own preference choose targets in random layouts."""
    problem = PlacementProblem(task, DEFAULT)
    layouts = problem.space.sample(_NUM_LAYOUTS, rng=np.random.default_rng(0))
    targets = [
        problem.best_free_placement(task.true_weights, layout) for layout in layouts
    ]
    scene = Scene(task.objects, task.item)
    return _Bench(scene, layouts, scene.frame.to_world(np.array(targets)))


def _run_episode(bench: _Bench, index: int) -> _Episode:
    found = bench.plan(index)
    started = process_time()
    execution = run_to_end(execute(bench.scene, found))
    return _Episode(execution, process_time() - started)


def _step_time(name: str, bench: _Bench) -> Quantity:
    """Take the least of the episodes; control and checks are included."""
    timestep = bench.scene.model.opt.timestep
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
