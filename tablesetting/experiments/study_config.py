"""What a study can be told; light to import, so that the command line answers at once."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from tablesetting.experiments.config import (
    PresetName,
    RunConfig,
    StrategyName,
    TaskName,
    by_preset,
    refuse_below,
)

_MOST = {
    "num_trials": 1_000_000,
    "num_queries": 10_000,
    "num_candidates": 1_000_000,
    "num_layouts": 1_000_000,
    "jobs": 1_000,
}  # More is a slip, and would fill the memory.


@dataclass(frozen=True)
class PlacementStudyConfig:
    """Repeat the paper's table experiment: tasks x strategies x trials, no arm.

    In a trial all strategies share the first demonstration and the test layouts. The
    rows, a summary, the figure and a comparison with the published curves are written.
    """

    tasks: tuple[TaskName, ...] = ("vase", "spoon")
    """What to place."""
    strategies: tuple[StrategyName, ...] = ("active-var", "random")
    """How the layout to ask about is chosen."""
    num_trials: int = 100
    """Trials of each task."""
    num_queries: int = 10
    """Queries asked after the first demonstration."""
    preset: PresetName = "paper"
    """`paper` reproduces the published curves, with objects that are points; `default`
    is statistically sound and physical, and takes half a minute for each trial."""
    candidates: Annotated[
        Literal["any", "one-moved"] | None, by_preset("any", "one-moved")
    ] = None
    """Layouts to choose from: drawn anew, or the last one with one object moved."""
    num_candidates: int = 50
    """Layouts to choose from in each round."""
    layouts: Annotated[
        Literal["valid", "uniform"] | None, by_preset("valid", "uniform")
    ] = None
    """Test layouts: physically `valid` or `uniform` points."""
    num_layouts: int = 200
    """Test layouts drawn in each trial."""
    test_bound: bool = False
    """Give the bound over the test layouts as well; about twice the work."""
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
        Path | None, arg(help_behavior_hint="(default: runs/study/placement-STAMP)")
    ] = None
    """Folder of the study."""
    resume: bool = False
    """Go on with the study in --out; start it if there is none."""
    overwrite: bool = False
    """Replace an earlier study in the folder."""

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
        for name, most in _MOST.items():
            value = getattr(self, name)
            if value is not None and value > most:
                option = name.replace("_", "-")
                raise ValueError(f"--{option} must be at most {most}; got {value}")
        for name in ("tasks", "strategies"):
            values = getattr(self, name)
            if not values or len(set(values)) < len(values):
                given = " ".join(values) or "none"
                raise ValueError(f"--{name} must name each at most once; got {given}")
        if self.resume and (self.out is None or self.overwrite):
            raise ValueError("--resume goes with --out, and not with --overwrite")
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
        plain = PlacementStudyConfig.__dataclass_fields__
        for name in plain.keys() - {"merge", "out", "overwrite"}:
            if getattr(self, name) != plain[name].default:
                option = name.replace("_", "-")
                raise ValueError(
                    f"--{option} has no effect beside --merge, which takes the settings "
                    "of the parts; leave it out"
                )

    @property
    def shard_of(self) -> tuple[int, int]:
        """Which part this is, counted from 0, and of how many."""
        if self.shard is None:
            return 0, 1
        index, num_shards = map(int, self.shard.split("/"))
        return index - 1, num_shards

    @property
    def is_as_published(self) -> bool:
        """Whether only trials, queries and the choice of tasks may differ from the paper."""
        return (
            self.preset == "paper"
            and self.candidates in (None, "one-moved")
            and self.num_candidates == 50
            and self.layouts in (None, "uniform")
        )

    def run_config(self, task: TaskName, strategy: StrategyName) -> RunConfig:
        """Return the options of the run that a trial of one strategy is."""
        return RunConfig(
            task=task,
            strategy=strategy,
            num_queries=self.num_queries,
            preset=self.preset,
            candidates=self.candidates,
            num_candidates=self.num_candidates,
            layouts=self.layouts,
            num_layouts=self.num_layouts,
            execute=0,
            seed=self.seed,
        )


@dataclass(frozen=True)
class StudyConfig:
    """Repeat an experiment many times: `study placement` is the paper's on the table."""
