"""What a study can be told; light to import, so that the command line answers at once."""

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, cast, get_args

from tyro.conf import OmitArgPrefixes, arg

from tablesetting.experiments.config import (
    MOST,
    ArmConfig,
    LearningConfig,
    PresetName,
    RunConfig,
    StrategyName,
    TaskName,
    TeacherName,
    by_preset,
    refuse_without_effect,
)
from tablesetting.options import refuse_above, refuse_bad_resume, refuse_below


@dataclass(frozen=True)
class TrialsConfig(ABC):
    """What every study has: many trials of each task, by several processes."""

    tasks: tuple[TaskName, ...] = ("vase", "spoon")
    """What to place."""
    num_trials: int = 100
    """Trials of each task."""
    jobs: Annotated[
        int | None, arg(help_behavior_hint="(default: one for each core)")
    ] = None
    """Processes; the numbers are the same with any."""
    seed: int = 0
    """Seed of all randomness."""
    shard: Annotated[str | None, arg(metavar="I/N", help_behavior_hint="")] = None
    """Do the I-th of N parts, for N machines; put them together with --merge."""
    merge: Annotated[
        tuple[Path, ...] | None, arg(metavar="DIR [DIR ...]", help_behavior_hint="")
    ] = None
    """Put the parts in these folders together, instead of any work; other options than
    --out and --overwrite are theirs."""
    out: Annotated[
        Path | None, arg(help_behavior_hint="(default: runs/study/NAME-STAMP)")
    ] = None
    """Folder of the study."""
    resume: bool = False
    """Go on with the study in --out; start it if there is none."""
    overwrite: bool = False
    """Replace an earlier study in the folder."""

    name: ClassVar[str]
    """Of the study on the command line."""
    listed: ClassVar[str]
    """The option that lists what every trial compares."""
    column: ClassVar[str]
    """The column that names which of these a row is of."""
    texts: ClassVar[tuple[str, ...]] = ()
    """Other columns that are no numbers."""

    def __post_init__(self) -> None:
        refuse_below(
            self,
            num_trials=1,
            num_queries=0,
            num_candidates=1,
            num_layouts=1,
            jobs=1,
            seed=0,
        )
        refuse_above(self, **MOST)
        for name in ("tasks", self.listed):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                given = " ".join(values) or "none"
                raise ValueError(
                    f"--{name} must name one at least, and each once; got {given}"
                )
        refuse_bad_resume(self)
        if self.shard is not None:
            self._check_shard(self.shard)
        if self.merge is not None:
            self._check_merge(self.merge)

    def _check_shard(self, shard: str) -> None:
        match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", shard)
        if match is None or not 1 <= int(match[1]) <= int(match[2]):
            raise ValueError(
                f"--shard must be I/N with 1 <= I <= N, such as 2/4; got {shard}"
            )
        num_trials = len(self.tasks) * self.num_trials
        if int(match[2]) > num_trials:
            raise ValueError(
                f"--shard must be of {num_trials} parts at most, as many as there are "
                f"trials; got {shard}"
            )

    def _check_merge(self, parts: tuple[Path, ...]) -> None:
        """Refuse options beside --merge, which would be of no effect."""
        if not parts:
            raise ValueError("--merge must name the folders of the parts; got none")
        if self.out and self.out.resolve() in [part.resolve() for part in parts]:
            raise ValueError(f"--out must be none of the parts; got {self.out}")
        for name in _changed(self) - {"merge", "out", "overwrite"}:
            option = name.replace("_", "-")
            raise ValueError(
                f"--{option} has no effect beside --merge, which takes the settings "
                "of the parts; leave it out"
            )

    @property
    @abstractmethod
    def compared(self) -> tuple[str, ...]:
        """What every trial compares, by name."""
        ...

    @abstractmethod
    def row_keys(self, task: TaskName) -> list[dict[str, str]]:
        """Return the cells by which each row of a whole trial is known, in order."""
        ...

    def may_be_empty(self, column: str, row: Mapping[str, str]) -> bool:
        """Tell whether a row may lack a number."""
        return False

    @property
    def shard_of(self) -> tuple[int, int]:
        """Which part this is, counted from 0, and of how many."""
        if self.shard is None:
            return 0, 1
        index, num_shards = map(int, self.shard.split("/"))
        return index - 1, num_shards


@dataclass(frozen=True)
class LearningStudyConfig(TrialsConfig):
    """What studies of learning have in common: a trial has runs without the arm."""

    num_queries: int = 10
    """Queries asked after the first demonstration."""
    num_layouts: int = 200
    """Test layouts drawn in each trial."""

    @abstractmethod
    def run_config(self, task: TaskName, compared: str) -> RunConfig:
        """Return the options of the run that a part of a trial is."""
        ...

    def row_keys(self, task: TaskName) -> list[dict[str, str]]:
        """Return a key for every number of demonstrations, one compared after another."""
        return [
            {self.column: compared, "num_demos": str(num_demos)}
            for compared in self.compared
            for num_demos in range(1, self.num_queries + 2)
        ]


@dataclass(frozen=True)
class PlacementStudyConfig(LearningStudyConfig):
    """Repeat the paper's table experiment: tasks x strategies x trials, no arm.

    In a trial all strategies share the first demonstration and the test layouts. The
    rows, a summary, the figure and a comparison with the published curves are written.
    """

    strategies: tuple[StrategyName | Literal["all"], ...] = ("active-var", "random")
    """How the layout to ask about is chosen; `all` compares all there are."""
    preset: PresetName = "paper"
    """`paper` reproduces the published curves, with objects that are points; `default`
    is statistically sound and physical, and takes some seconds for each trial."""
    candidates: Annotated[
        Literal["any", "one-moved"] | None, by_preset("any", "one-moved")
    ] = None
    """Layouts to choose from: drawn anew, or the last one with one object moved."""
    num_candidates: int = 50
    """Layouts to choose from in each round."""
    learning: OmitArgPrefixes[LearningConfig] = field(default_factory=LearningConfig)
    """How the robot learns, and from whom."""
    layouts: Annotated[
        Literal["valid", "uniform"] | None, by_preset("valid", "uniform")
    ] = None
    """Test layouts: physically `valid` or `uniform` points."""
    test_bound: bool = False
    """Give the bound over the test layouts as well; about twice the work."""

    name: ClassVar[str] = "placement"
    listed: ClassVar[str] = "strategies"
    column: ClassVar[str] = "strategy"

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_without_effect(self.preset, self.learning)
        if "all" in self.strategies and len(self.strategies) > 1:
            raise ValueError(
                f"--strategies all stands alone; got {' '.join(self.strategies)}"
            )

    @property
    def compared(self) -> tuple[StrategyName, ...]:
        """The strategies by name."""
        if "all" in self.strategies:
            return get_args(StrategyName)
        return cast(tuple[StrategyName, ...], self.strategies)

    @property
    def is_as_published(self) -> bool:
        """Whether only trials, queries and the choice of tasks may differ from the paper."""
        return (
            self.preset == "paper"
            and self.candidates in (None, "one-moved")
            and self.num_candidates == 50
            and self.layouts in (None, "uniform")
            and replace(self.learning, points=False) == LearningConfig()
        )

    def run_config(self, task: TaskName, compared: str) -> RunConfig:
        """Return the options of the run that a trial of one strategy is."""
        return RunConfig(
            task=task,
            strategy=cast(StrategyName, compared),
            num_queries=self.num_queries,
            preset=self.preset,
            candidates=self.candidates,
            num_candidates=self.num_candidates,
            learning=self.learning,
            layouts=self.layouts,
            num_layouts=self.num_layouts,
            execute=0,
            seed=self.seed,
        )


@dataclass(frozen=True)
class CalibrationStudyConfig(LearningStudyConfig):
    """Ask how often the bound holds: simulated people of many kinds and preferences.

    In a trial a true reward is drawn from the prior, and people of each kind, who all
    have it, answer the same random layouts. Each kind is learned from with the likelihood
    that is made for it, or the default.
    """

    num_trials: int = 84
    """Trials of each task: 84 of both make 1008 people of 6 kinds."""
    num_queries: int = 9
    """Queries asked after the first demonstration."""
    num_layouts: int = 100
    """Test layouts drawn in each trial."""
    teachers: tuple[TeacherName, ...] = get_args(TeacherName)
    """Kinds of people."""
    target_ess: float = 200.0
    """Effective sample size at which the chains may end; 150 is the least that bounds
    the loss at the tenth look. Runs have 400."""
    max_rhat: float = 1.05
    """R-hat that they must reach as well; runs have 1.01."""
    num_steps: int = 15_000
    """Most steps of each chain; runs have 50 000."""

    name: ClassVar[str] = "calibration"
    listed: ClassVar[str] = "teachers"
    column: ClassVar[str] = "teacher"

    def __post_init__(self) -> None:
        super().__post_init__()
        LearningConfig(
            target_ess=self.target_ess,
            max_rhat=self.max_rhat,
            num_steps=self.num_steps,
        )  # May refuse.

    @property
    def compared(self) -> tuple[str, ...]:
        """The kinds of people."""
        return self.teachers

    def run_config(self, task: TaskName, compared: str) -> RunConfig:
        """Return the options of the run that learns from one kind of person."""
        teacher = cast(TeacherName, compared)
        return RunConfig(
            task=task,
            strategy="random",
            num_queries=self.num_queries,
            num_candidates=1,
            learning=LearningConfig(
                likelihood="boltzmann" if teacher == "boltzmann" else "placement",
                noise=0.02 if teacher == "noisy" else 0.01,
                target_ess=self.target_ess,
                max_rhat=self.max_rhat,
                num_steps=self.num_steps,
                teacher=teacher,
                truth="prior",
                points=True,
            ),
            num_layouts=self.num_layouts,
            execute=0,
            seed=self.seed,
        )


GoalName = Literal["table", "bowl", "infeasible"]
_ITEMS_FOR_BOWLS = ("spoon",)


@dataclass(frozen=True)
class ExecutionStudyConfig(TrialsConfig):
    """Let the arm place things in random layouts, and measure how well it does.

    In a trial it puts the item at a random place on the table where it fits, with a random
    heading; the spoon into the bowl as well; and is asked for something impossible.
    """

    num_trials: int = 400
    """Trials of each task."""
    goals: tuple[GoalName, ...] = ("table", "bowl", "infeasible")
    """Where to: free places on the table; into the bowl, where the item goes there; and
    requests that are to be refused."""
    arm: OmitArgPrefixes[ArmConfig] = field(default_factory=ArmConfig)
    """How strong the arm is, and how well it knows its world."""

    name: ClassVar[str] = "execution"
    listed: ClassVar[str] = "goals"
    column: ClassVar[str] = "goal"
    texts: ClassVar[tuple[str, ...]] = ("request", "refusal", "fault", "state")

    @property
    def compared(self) -> tuple[str, ...]:
        """The kinds of goals."""
        return self.goals

    def __post_init__(self) -> None:
        super().__post_init__()
        for task in self.tasks:
            if not self.goals_of(task):
                raise ValueError(
                    f"--goals must name one for the {task} as well, or --tasks leave it "
                    f"out; got {' '.join(self.goals)}"
                )

    def may_be_empty(self, column: str, row: Mapping[str, str]) -> bool:
        """Tell whether a row may lack a number: a refused one what was not measured."""
        is_measured = column not in ("x", "y", "success", "moved")
        return column == "yaw_deg" or bool(row["refusal"] and is_measured)

    def goals_of(self, task: TaskName) -> tuple[GoalName, ...]:
        """Return the kinds of goals that there are for the item of a task."""
        goes_into_bowls = task in _ITEMS_FOR_BOWLS
        return tuple(goal for goal in self.goals if goal != "bowl" or goes_into_bowls)

    def row_keys(self, task: TaskName) -> list[dict[str, str]]:
        """Return a key for each goal."""
        return [{self.column: goal} for goal in self.goals_of(task)]


def _changed(config: object) -> set[str]:
    """Name the options that are not what they are unless told."""
    found = set()
    for described in fields(cast(Any, config)):
        value = getattr(config, described.name)
        if isinstance(value, LearningConfig | ArmConfig):
            found |= _changed(value)
        elif value != described.default:
            found.add(described.name)
    return found


STUDIES: dict[str, type[TrialsConfig]] = {
    study.name: study
    for study in (PlacementStudyConfig, CalibrationStudyConfig, ExecutionStudyConfig)
}
"""Studies by name."""


@dataclass(frozen=True)
class StudyConfig:
    """Repeat an experiment many times.

    `study placement` is the paper's on the table, `study calibration` asks how often the
    bound holds, `study execution` how well the arm does what it is told.
    """
