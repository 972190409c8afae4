"""From the options of a run to its problem, first layout and test layouts."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tablesetting.errors import InvalidLayout
from tablesetting.experiments.config import LearnConfig, ModelConfig, RunConfig
from tablesetting.experiments.validation import ValidationSet
from tablesetting.irl.arrays import Array
from tablesetting.irl.sampler import McmcConfig, sample_uniform_weights
from tablesetting.reward.config import PRESETS, PlacementConfig
from tablesetting.reward.files import read_layouts
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.placement_likelihood import NoiseConfig
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import TASKS
from tablesetting.reward.teachers import TEACHERS

_NUM_DEPLOYED = 100  # Layouts that the bound is over,
_ARM_STREAM = 7  # Of randomness, after the seven others of a run.
_NUM_REFERENCES = 32  # and those of them that strategies think ahead to.


@dataclass(frozen=True)
class RunDefaults:
    """What a run does where it is not told; one for each preset.

    Attributes:
        first_layout: Where the first demonstration is given.
        layouts: Where the learned weights are tested.
        epsilon: Bound that ends the run, in table units.
        executes: Whether the arm acts.
        is_bound_deployed: Whether the bound that ends the run is over layouts such as
            the robot will meet, rather than over the candidates.
    """

    first_layout: str
    layouts: str
    epsilon: float
    executes: bool
    is_bound_deployed: bool


DEFAULTS = {
    "default": RunDefaults("random", "valid", 0.05, True, is_bound_deployed=True),
    "paper": RunDefaults("paper", "uniform", 0.0, False, is_bound_deployed=False),
}


@dataclass(frozen=True)
class Session:
    """What is learned, and the layouts that the bound on the loss is over.

    Attributes:
        problem: What is learned.
        validation: The test layouts; None if nobody knows what the person wants there.
        deployment: Layouts such as the robot will meet, shape (T, K, 2).
        distribution: Where these come from, in words.
        epsilon: The bound is wanted below this, in table units.
        is_bound_deployed: Whether the bound that ends a session is over these layouts,
            rather than over the candidates.
        rng: Source of the randomness of the active loop.
        side_seeds: Source of that of whatever only looks on.
    """

    problem: PlacementProblem
    validation: ValidationSet | None
    deployment: Array
    distribution: str
    epsilon: float
    is_bound_deployed: bool
    rng: np.random.Generator
    side_seeds: np.random.SeedSequence


@dataclass(frozen=True)
class RunSetup(Session):
    """A run, ready to start.

    Attributes:
        validation: The test layouts.
        first_layout: Where the first demonstration is given, shape (K, 2).
        num_executions: In how many queried layouts the arm acts.
        teacher_rng: Source of the randomness of the first demonstration.
        arm_seeds: Source of that of the arm's senses, and of its props; see `arm_rng`.
    """

    validation: ValidationSet
    first_layout: Array
    num_executions: int
    teacher_rng: np.random.Generator
    arm_seeds: np.random.SeedSequence

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
        seeds = seeds or np.random.SeedSequence(config.seed)
        *children, side_seeds = seeds.spawn(_ARM_STREAM)
        first_rng, test_rng, loop_rng, deployed_rng, teacher_rng, truth_rng = map(
            np.random.default_rng, children
        )
        settings, task = problem_settings(config), TASKS[config.task]
        if config.learning.truth == "prior":
            dim = len(task.true_weights)
            task = task.wanting(sample_uniform_weights(1, dim, rng=truth_rng)[0])
        test = _TestLayouts.of_config(config, PlacementProblem(task, settings))
        deployment = test.draw(_NUM_DEPLOYED, rng=deployed_rng)
        problem = PlacementProblem(
            task,
            settings,
            teacher=TEACHERS[config.learning.teacher],
            deployment=deployment[:_NUM_REFERENCES],
        )
        executes = (
            config.num_queries if defaults.executes and not settings.are_points else 0
        )
        layouts = test.draw(config.num_layouts, rng=test_rng)
        return cls(
            problem=problem,
            first_layout=_first_layout(problem, config, defaults, first_rng),
            validation=ValidationSet.of_problem(problem, layouts),
            deployment=deployment,
            distribution=test.description,
            epsilon=defaults.epsilon if config.epsilon is None else config.epsilon,
            is_bound_deployed=defaults.is_bound_deployed,
            num_executions=executes if config.execute is None else config.execute,
            rng=loop_rng,
            teacher_rng=teacher_rng,
            side_seeds=side_seeds,
            arm_seeds=seeds,
        )


def arm_rng(seeds: np.random.SeedSequence, num_demos: int) -> np.random.Generator:
    """Return what the arm's senses and its props draw from in one round.

    Every round has its own, so that an episode can be repeated alone.

    Args:
        seeds: Source of all randomness of a run.
        num_demos: Demonstrations learned from by then.
    """
    key = (*seeds.spawn_key, _ARM_STREAM, num_demos)
    return np.random.default_rng(np.random.SeedSequence(seeds.entropy, spawn_key=key))


def problem_settings(config: RunConfig | LearnConfig) -> PlacementConfig:
    """Return how a run learns: its preset, with what the options change of it."""
    preset, learning = PRESETS[config.preset], config.learning
    boltzmann = replace(
        preset.boltzmann, beta=learning.beta, beta_spread=learning.beta_spread
    )
    return replace(
        preset,
        # Those of a file stand in place of any.
        candidates="one-moved"
        if (config.candidates or preset.candidates) == "one-moved"
        else "any",
        num_candidates=config.num_candidates,
        are_points=preset.are_points or learning.points,
        likelihood=learning.likelihood or preset.likelihood,
        guess=learning.guess,
        boltzmann=boltzmann,
        noise=NoiseConfig(learning.noise, learning.noise_spread),
        mcmc=preset.mcmc if config.preset == "paper" else _sampler(preset, learning),
        risk=replace(preset.risk, delta=config.delta),
    )


def _sampler(preset: PlacementConfig, learning: ModelConfig) -> McmcConfig:
    """Return when the chains are to end."""
    return replace(
        preset.mcmc,
        target_ess=learning.target_ess,
        max_rhat=learning.max_rhat,
        num_steps=learning.num_steps,
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


@dataclass(frozen=True)
class _TestLayouts:
    """Where layouts such as the robot will meet come from.

    Attributes:
        space: The layouts to draw from; None where they are given.
        given: Those that are given, shape (L, K, 2).
        description: The same in words.
    """

    space: LayoutSpace | None
    given: Array | None
    description: str

    @classmethod
    def of_config(cls, config: RunConfig, problem: PlacementProblem) -> "_TestLayouts":
        """Resolve the options."""
        usual = DEFAULTS[config.preset].layouts
        choice = config.layouts or ("uniform" if config.learning.points else usual)
        if choice in ("uniform", "valid"):
            is_uniform = choice == "uniform"  # Points may stand anywhere.
            space = LayoutSpace.of_task(problem.task, are_points=is_uniform)
            return cls(space, None, choice)
        layouts = _given_layouts(problem, Path(choice))
        return cls(None, layouts, f"the {len(layouts)} of {choice}")

    def draw(self, num: int, *, rng: np.random.Generator) -> Array:
        """Draw layouts, or return all that are given, shape (L, K, 2)."""
        if self.space is None:
            return np.asarray(self.given)
        return self.space.sample(num, rng=rng)


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
