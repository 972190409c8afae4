"""From the options of `learn` to what is learned from, and over which layouts."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tablesetting.errors import InvalidFile, InvalidLayout
from tablesetting.experiments.config import LearnConfig
from tablesetting.experiments.setup import Session, problem_settings
from tablesetting.irl.arrays import Array
from tablesetting.reward.files import read_layouts
from tablesetting.reward.layout import LayoutSpace
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.problem import PlacementProblem
from tablesetting.reward.tasks import PlacementTask

_NUM_REFERENCES = 32  # Layouts that strategies think ahead to.


@dataclass(frozen=True)
class LearnSetup(Session):
    """A session with recorded demonstrations.

    Attributes:
        demos: What was demonstrated, in its order.
        first: From how many of them to learn first.
    """

    demos: tuple[Demonstration, ...]
    first: int

    @classmethod
    def of_config(
        cls, config: LearnConfig, task: PlacementTask, demos: Sequence[Demonstration]
    ) -> "LearnSetup":
        """Resolve the options.

        Objects may overlap in what was recorded and in layouts that are given.

        Args:
            config: The options.
            task: What was placed.
            demos: The demonstrations in their order, at least one.

        Raises:
            InvalidFile: If a file of layouts cannot be used, or no candidate can be
                made of a demonstrated layout.
        """
        seeds = np.random.SeedSequence(config.seed)
        loop_seeds, deployed_seeds, side_seeds = seeds.spawn(3)
        settings = problem_settings(config)
        is_point = settings.are_points
        layouts, distribution = _deployment(
            config, task, np.random.default_rng(deployed_seeds), is_point
        )
        problem = PlacementProblem(
            task,
            settings,
            candidates=_candidates(config, task),
            deployment=layouts[:_NUM_REFERENCES],
        )
        # All but the last tell whether that was foretold.
        is_whole = config.curve or settings.mcmc.starts_at_map
        first = 1 if is_whole else max(len(demos) - 1, 1)
        if settings.candidates == "one-moved":
            _check_moves(problem.space, demos, first)
        return cls(
            problem=problem,
            validation=None,
            deployment=layouts,
            distribution=distribution,
            epsilon=config.epsilon,
            is_bound_deployed=True,
            rng=np.random.default_rng(loop_seeds),
            side_seeds=side_seeds,
            demos=tuple(demos),
            first=first,
        )

    def following(self, num_demos: int) -> tuple[Array, Array] | tuple[None, None]:
        """Return layout and placement of the demonstration after so many, if any."""
        if num_demos == len(self.demos):
            return None, None
        demo = self.demos[num_demos]
        return demo.layout, demo.placement


def given_files(config: LearnConfig) -> dict[str, Path]:
    """Return the files of layouts that options name, by option."""
    words = (None, "any", "one-moved", "valid", "uniform")
    return {
        option: Path(str(getattr(config, option)))
        for option in ("candidates", "layouts")
        if getattr(config, option) not in words
    }


def _deployment(
    config: LearnConfig,
    task: PlacementTask,
    rng: np.random.Generator,
    are_points: bool,
) -> tuple[Array, str]:
    choice = config.layouts or ("uniform" if are_points else "valid")
    if choice not in ("valid", "uniform"):
        layouts = read_layouts(Path(choice), task.objects)
        return layouts, f"the {len(layouts)} of {choice}"
    space = LayoutSpace.of_task(task, are_points=choice == "uniform")
    return space.sample(config.num_layouts, rng=rng), choice


def _candidates(config: LearnConfig, task: PlacementTask) -> Array | None:
    path = given_files(config).get("candidates")
    return None if path is None else read_layouts(path, task.objects)


def _check_moves(
    space: LayoutSpace, demos: Sequence[Demonstration], first: int
) -> None:
    """Refuse layouts that stay impossible whatever object is moved."""
    rng = np.random.default_rng(0)
    for index, demo in enumerate(demos[first - 1 :], start=first - 1):
        try:
            space.sample_one_moved(demo.layout, 1, rng=rng)
        except InvalidLayout as error:
            raise InvalidFile(
                f"demonstration {index} leads to no candidates, as {error}; learn in "
                "another --out, with --candidates any or --points"
            ) from error


def parse_place(text: str) -> Array:
    """Read a placement such as 0.5,0.25.

    Raises:
        InvalidFile: If it is none.
    """
    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        place = np.empty(0)
    if place.shape != (2,) or not ((place >= 0.0) & (place <= 1.0)).all():
        raise InvalidFile(
            f"the placement is {text!r:.60}; give x,y in [0, 1], in table units, such "
            "as 0.5,0.25"
        )
    return place
