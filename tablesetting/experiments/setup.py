"""From the options of a run to its problem, first layout and test layouts."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tablesetting.errors import InvalidLayout
from tablesetting.experiments.config import RunConfig
from tablesetting.experiments.validation import ValidationSet
from tablesetting.irl.arrays import Array
from tablesetting.reward.files import read_layouts
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.problem import PRESETS, PlacementConfig, PlacementProblem
from tablesetting.reward.tasks import TASKS


@dataclass(frozen=True)
class RunDefaults:
    """What a run does where it is not told; one for each preset.

    Attributes:
        first_layout: Where the first demonstration is given.
        layouts: Where the learned weights are tested.
        epsilon: Bound that ends the run, in table units.
        executes: Whether the arm acts.
    """

    first_layout: str
    layouts: str
    epsilon: float
    executes: bool


DEFAULTS = {
    "default": RunDefaults("random", "valid", epsilon=0.05, executes=True),
    "paper": RunDefaults("paper", "uniform", epsilon=0.0, executes=False),
}


@dataclass(frozen=True)
class RunSetup:
    """A run, ready to start.

    Attributes:
        problem: What is learned.
        first_layout: Where the first demonstration is given, shape (K, 2).
        validation: The test layouts.
        epsilon: Bound that ends the run, in table units.
        num_executions: In how many queried layouts the arm acts.
        rng: Source of the randomness of the active loop.
    """

    problem: PlacementProblem
    first_layout: Array
    validation: ValidationSet
    epsilon: float
    num_executions: int
    rng: np.random.Generator

    @classmethod
    def of_config(
        cls, config: RunConfig, seeds: np.random.SeedSequence | None = None
    ) -> "RunSetup":
        """Resolve the options.

        Args:
            config: The options.
            seeds: Source of all randomness; that of the seed among the options if None.

        Raises:
            InvalidFile: If a file of layouts cannot be used.
            InvalidLayout: If a given layout is not possible, or the task has no layout
                of the paper's.
        """
        defaults = DEFAULTS[config.preset]
        first_rng, test_rng, loop_rng = (
            np.random.default_rng(child)
            for child in (seeds or np.random.SeedSequence(config.seed)).spawn(3)
        )
        problem = PlacementProblem(TASKS[config.task], problem_settings(config))
        executes = config.num_queries if defaults.executes else 0
        return cls(
            problem=problem,
            first_layout=_first_layout(problem, config, defaults, first_rng),
            validation=_validation_set(problem, config, defaults, test_rng),
            epsilon=defaults.epsilon if config.epsilon is None else config.epsilon,
            num_executions=executes if config.execute is None else config.execute,
            rng=loop_rng,
        )


def problem_settings(config: RunConfig) -> PlacementConfig:
    """Return how a run learns: its preset, with what the options change of it."""
    preset = PRESETS[config.preset]
    return replace(
        preset,
        candidates=config.candidates or preset.candidates,
        num_candidates=config.num_candidates,
    )


def _first_layout(
    problem: PlacementProblem,
    config: RunConfig,
    defaults: RunDefaults,
    rng: np.random.Generator,
) -> Array:
    choice, paper_layout = config.first_layout, problem.task.first_layout
    if choice is None:
        # The paper drew the first layout of a task at random where it names none.
        choice = defaults.first_layout if paper_layout else "random"
    if choice == "random":
        return problem.space.sample(1, rng=rng)[0]
    if choice != "paper":
        return _given_layouts(problem, Path(choice), at_most=1)[0]
    if paper_layout is None:
        raise InvalidLayout(
            f"the paper gives no first layout for '{problem.task.name}'; "
            "use --first-layout random or a file"
        )
    layout = np.array(paper_layout)
    problem.space.check(layout)
    return layout


def _validation_set(
    problem: PlacementProblem,
    config: RunConfig,
    defaults: RunDefaults,
    rng: np.random.Generator,
) -> ValidationSet:
    choice = config.layouts or defaults.layouts
    if choice in ("uniform", "valid"):
        is_uniform = choice == "uniform"  # Points may stand anywhere.
        space = LayoutSpace.of_task(problem.task, are_points=is_uniform)
        layouts = space.sample(config.num_layouts, rng=rng)
    else:
        layouts = _given_layouts(problem, Path(choice))
    return ValidationSet.of_problem(problem, layouts)


def _given_layouts(
    problem: PlacementProblem, path: Path, at_most: int | None = None
) -> Array:
    layouts = read_layouts(path, problem.task.objects)
    if at_most is not None and len(layouts) > at_most:
        raise InvalidLayout(
            f"'{path}' holds {len(layouts)} layouts; the first layout must be one"
        )
    for index, layout in enumerate(layouts):
        try:
            problem.space.check(layout)
        except InvalidLayout as error:
            raise InvalidLayout(f"'{path}': layout {index}: {error}") from error
    return layouts
