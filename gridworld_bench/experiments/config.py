"""The options of each command; light to import, so that --help is answered at once."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from tyro.conf import Fixed, Suppress, arg

from tablesetting.options import refuse_above, refuse_bad_resume, refuse_below

ActionStrategy = Literal[
    "active-var", "random", "active-sampling", "cvar", "information-gain", "max-regret"
]
CritiqueStrategy = Literal[
    "active-var", "random", "arc", "path-var", "cvar", "information-gain", "max-regret"
]
DrivingStrategy = Literal["drive", ActionStrategy]
Driver = Literal["safe", "right-lane", "reckless"]
TimedStrategy = Literal[CritiqueStrategy, "arc-faithful"]

COLUMNS = (
    *("world", "strategy", "trial", "num_queries", "policy_loss", "max_policy_loss"),
    *("var", "query", "query_seconds", "inference_seconds"),
)
"""Columns of rounds.csv."""

LEAST = {
    "num_trials": 1,
    "num_queries": 0,
    "size": 3,
    "num_features": 2,
    "num_colors": 1,
    "num_starts": 1,
    "num_samples": 20,
    "length": 2,
    "num_sampled_states": 10,
    "jobs": 1,
    "seed": 0,
}
MOST = {
    "num_trials": 100_000,
    "num_queries": 10_000,
    "size": 128,
    "num_features": 1024,
    "num_colors": 1024,
    "num_samples": 100_000,
    "length": 60,
    "num_sampled_states": 100_000,
    "jobs": 1000,
}


@dataclass(frozen=True)
class StudyConfig:
    """What every study has."""

    num_trials: int = 100
    """Worlds, in each of which every strategy learns."""
    num_queries: int = 25
    """Queries after the first demonstration."""
    preset: Literal["paper", "default"] = "paper"
    """The paper's chain of 10 000 samples, or the sound one, which is slower."""
    jobs: Annotated[int | None, arg(help_behavior_hint="(default: the cores)")] = None
    """Processes; the rows do not depend on it."""
    seed: int = 0
    """Seed of all randomness."""
    out: Annotated[
        Path | None, arg(help_behavior_hint="(default: runs/grid/NAME-STAMP)")
    ] = None
    """Folder for the results."""
    resume: bool = False
    """Go on with the study in --out; start it if there is none."""
    overwrite: bool = False
    """Replace an earlier study in the folder."""

    name: ClassVar[str]
    """Of the command."""
    columns: ClassVar[tuple[str, ...]] = COLUMNS
    """Of rounds.csv."""
    num_shown: ClassVar[int] = 2
    """Best actions that are known at first."""
    strategies: ClassVar[tuple[str, ...]]
    """Who asks."""

    def __post_init__(self) -> None:
        refuse_below(self, **LEAST)
        refuse_above(self, **MOST)
        for name in ("level", "epsilon", "loss_epsilon"):
            if not 0.0 < getattr(self, name, 1.0) < math.inf:
                option = name.replace("_", "-")
                raise ValueError(
                    f"--{option} must be positive; got {getattr(self, name)}"
                )
        refuse_bad_resume(self)
        if len(set(self.strategies)) < max(len(self.strategies), 1):
            given = " ".join(self.strategies) or "none"
            raise ValueError(
                f"--strategies must name one at least, and each once; got {given}"
            )


@dataclass(frozen=True)
class ActionQueriesConfig(StudyConfig):
    """Ask for the best action in a state: Figure 2 of the paper."""

    strategies: tuple[ActionStrategy, ...] = (  # type: ignore[misc]
        "active-var",
        "active-sampling",
        "random",
    )
    """Who asks."""
    size: int = 8
    """Cells on each side."""
    num_features: int = 48
    """Features of each cell."""

    name: ClassVar[str] = "action-queries"


@dataclass(frozen=True)
class CritiqueQueriesConfig(StudyConfig):
    """Have paths of 8 steps judged: Figure 3a of the paper."""

    num_trials: int = 50
    """Worlds, in each of which every strategy learns."""
    num_queries: int = 12
    """Queries after the first demonstration."""
    strategies: tuple[CritiqueStrategy, ...] = (  # type: ignore[misc]
        "active-var",
        "arc",
        "random",
        "path-var",
    )
    """Who asks."""
    size: int = 8
    """Cells on each side."""
    num_features: int = 48
    """Features of each cell."""

    name: ClassVar[str] = "critique-queries"
    columns: ClassVar[tuple[str, ...]] = (*COLUMNS, "distinct_pairs", "new_pairs")


@dataclass(frozen=True)
class SparseBarrierConfig(StudyConfig):
    """Learn where few states tell anything: appendix A of the paper."""

    num_trials: int = 50
    """Worlds, in each of which every strategy learns."""
    num_queries: int = 80
    """Queries after the first demonstration."""
    strategies: tuple[ActionStrategy, ...] = (  # type: ignore[misc]
        "active-var",
        "random",
    )
    """Who asks."""
    size: int = 8
    """Cells on each side."""
    num_colors: int = 6
    """Colors of the barrier."""
    num_starts: Annotated[int | None, arg(help_behavior_hint="(default: all)")] = None
    """Initial states, in the bottom row, as in the figure of the appendix; its ratio of
    demonstrations is for all states."""
    level: float = 0.01
    """Worst-case loss that is to be reached."""

    name: ClassVar[str] = "sparse-barrier"
    num_shown: ClassVar[int] = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.num_starts is not None and self.num_starts > self.size:
            raise ValueError(
                f"--num-starts must be at most --size, {self.size}; got {self.num_starts}"
            )


@dataclass(frozen=True)
class ExampleConfig(StudyConfig):
    """See what is asked in a small world, and why: Figure 1 of the paper."""

    num_trials: int = 50
    """Seeds."""
    num_queries: int = 1
    """Queries that are answered; one more is chosen."""
    strategies: tuple[ActionStrategy, ...] = (  # type: ignore[misc]
        "active-var",
        "active-sampling",
    )
    """Who asks."""

    name: ClassVar[str] = "example"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.num_queries < 1:
            raise ValueError(
                f"--num-queries must be at least 1; got {self.num_queries}"
            )


@dataclass(frozen=True)
class NormalisedStopConfig(StudyConfig):
    """Stop once the value at risk, normalised or not, is small: appendix B of the paper."""

    num_trials: int = 50
    """Worlds, in each of which every strategy learns."""
    num_queries: int = 40
    """Queries after the first demonstration."""
    strategies: tuple[ActionStrategy, ...] = ("active-var",)  # type: ignore[misc]
    """Who asks."""
    epsilon: float = 0.05
    """The normalised loss is wanted below this."""
    loss_epsilon: float = 0.05
    """The loss itself is wanted below this, in units of return."""
    size: int = 8
    """Cells on each side."""
    num_features: int = 48
    """Features of each cell."""

    name: ClassVar[str] = "normalised-stop"
    columns: ClassVar[tuple[str, ...]] = (
        *COLUMNS,
        *("normalized_var", "normalized_loss"),
        *("random_normalized_var", "random_normalized_loss"),
    )


@dataclass(frozen=True)
class TimingConfig(StudyConfig):
    """Measure how long a critique query takes: Figure 3b of the paper."""

    num_trials: int = 5
    """Worlds, in each of which every strategy learns."""
    num_queries: int = 2
    """Queries that are answered; one more is chosen."""
    strategies: tuple[TimedStrategy, ...] = (  # type: ignore[misc]
        "active-var",
        "random",
        "path-var",
        "arc",
        "arc-faithful",
    )
    """Who asks."""
    num_samples: int = 300
    """Samples of each fresh chain of arc-faithful; the paper's 10 000 take minutes."""
    size: int = 8
    """Cells on each side."""
    num_features: int = 48
    """Features of each cell."""

    name: ClassVar[str] = "timing"
    columns: ClassVar[tuple[str, ...]] = (*COLUMNS, "agreement")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.preset != "paper":
            raise ValueError(
                f"--preset must be paper, whose chain ARC is made for; got {self.preset}"
            )


@dataclass(frozen=True)
class DrivingStudyConfig(StudyConfig):
    """See what driving on, and what questions, teach of a highway."""

    num_trials: int = 20
    """Drives, from each of which every strategy goes on."""
    num_queries: int = 15
    """Steps, or answers, after the first five steps."""
    strategies: tuple[DrivingStrategy, ...] = (  # type: ignore[misc]
        "drive",
        "active-var",
        "random",
    )
    """Who goes on; `drive` asks nothing and is driven on."""
    driver: Driver = "safe"
    """Who drives and answers."""
    length: int = 10
    """Steps ahead that the road is seen."""
    num_samples: int = 500
    """Samples of the paper's chain, of five proposals each."""
    num_sampled_states: int = 200
    """States that are drawn as candidates before each query."""
    preset: Annotated[Literal["paper"], Fixed, Suppress] = "paper"

    name: ClassVar[str] = "driving-study"
    num_shown: ClassVar[int] = 5
    columns: ClassVar[tuple[str, ...]] = (
        *COLUMNS,
        *("collisions", "off_road", "riskiest_probability"),
    )


CONFIGS = {
    config.name: config
    for config in (
        ActionQueriesConfig,
        CritiqueQueriesConfig,
        SparseBarrierConfig,
        ExampleConfig,
        NormalisedStopConfig,
        TimingConfig,
        DrivingStudyConfig,
    )
}
"""The options of each command, by its name."""
