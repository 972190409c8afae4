"""From the options of `learn` to what is learned from, and over which layouts."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tablesetting.errors import InvalidFile
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
    """

    demos: tuple[Demonstration, ...]

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
            InvalidFile: If a file of layouts cannot be used.
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
        )

    def following(self, num_demos: int) -> tuple[Array, Array] | tuple[None, None]:
        """Return layout and placement of the demonstration after so many, if any."""
        if num_demos == len(self.demos):
            return None, None
        demo = self.demos[num_demos]
        return demo.layout, demo.placement


def given_files(config: LearnConfig) -> list[Path]:
    """List the files of layouts that the options name."""
    words = (None, "any", "one-moved", "valid", "uniform")
    return [
        Path(named)
        for named in (config.candidates, config.layouts)
        if named not in words
    ]


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
    if config.candidates in (None, "any", "one-moved"):
        return None
    return read_layouts(Path(str(config.candidates)), task.objects)


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
