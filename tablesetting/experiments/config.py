"""What a run can be told; light to import, so that the command line answers at once."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from tablesetting.options import (
    changed_options,
    refuse_above,
    refuse_bad_resume,
    refuse_below,
    refuse_changed,
)

TaskName = Literal["vase", "spoon"]
StrategyName = Literal[
    "active-var",
    "var-bound",
    "cvar",
    "random",
    "entropy",
    "information-gain",
    "volume-removal",
    "max-regret",
    "disagreement",
    "bayes-regret",
    "placement-equivalence",
    "var-reduction",
]
LikelihoodName = Literal["boltzmann", "placement", "auto"]
TeacherName = Literal["exact", "boltzmann", "noisy", "blundering", "biased", "offset"]
PresetName = Literal["default", "paper"]

MOST = {
    "num_trials": 1_000_000,
    "num_queries": 10_000,
    "num_candidates": 1_000_000,
    "num_layouts": 1_000_000,
    "jobs": 1_000,
}
"""Larger numbers are slips, and would fill the memory."""


def by_preset(default: str, paper: str) -> Any:
    """Say in the help what an option is by default, under either preset."""
    return arg(help_behavior_hint=f"(default: {default}; paper preset: {paper})")


def _refuse_number_of_given(config: Any) -> None:
    """Refuse to say how many layouts are drawn where they are given."""
    if config.layouts not in (None, "valid", "uniform"):
        refuse_changed(config, ("num_layouts",), f"with --layouts {config.layouts}")


@dataclass(frozen=True)
class ModelConfig:
    """What the robot takes people for, and how long it thinks."""

    likelihood: Annotated[
        LikelihoodName | None, by_preset("placement", "boltzmann")
    ] = None
    """Model of the person: near the best placement, noisily rational, or both, weighed
    by their evidence."""
    guess: Annotated[
        Literal["map", "mean"] | None,
        arg(help_behavior_hint="(default: mean for placement, map for boltzmann)"),
    ] = None
    """What the robot acts on: the most probable weights or their mean."""
    noise: float = 0.01
    """Standard deviation of a person's placements that `placement` assumes, in table
    units of 0.5 m."""
    noise_spread: float = 0.0
    """Prior standard deviation of its logarithm, to learn the noise; 0 fixes it."""
    beta: float = 100.0
    """Rationality of a person that `boltzmann` assumes."""
    beta_spread: float = 0.0
    """Prior standard deviation of its logarithm, to learn it; 0 fixes it."""
    target_ess: float = 400.0
    """Effective sample size, of bulk and tails, at which the chains may end."""
    max_rhat: float = 1.01
    """R-hat that they must reach as well."""
    num_steps: int = 50_000
    """Most steps of each chain; a posterior that needs more is not certified."""
    points: Annotated[bool, arg(help_behavior_hint="(always in the paper preset)")] = (
        False
    )
    """Take objects for points that may overlap; the arm does not act."""

    def __post_init__(self) -> None:
        for name, least, most in (("noise", 0.001, 1.0), ("beta", 0.01, 10_000.0)):
            if not least <= getattr(self, name) <= most:
                raise ValueError(
                    f"--{name} must be in [{least:g}, {most:.0f}]; got "
                    f"{getattr(self, name)}"
                )
        if not 1.0 <= self.target_ess <= 1e5:
            raise ValueError(
                f"--target-ess must be in [1, 100000]; got {self.target_ess}"
            )
        if not 1.0 < self.max_rhat < math.inf:
            raise ValueError(f"--max-rhat must be over 1; got {self.max_rhat}")
        if not 2_000 <= self.num_steps <= 10_000_000:
            raise ValueError(
                f"--num-steps must be in [2000, 10000000]; got {self.num_steps}"
            )
        for name in ("noise_spread", "beta_spread"):
            option = name.replace("_", "-")
            if not 0.0 <= getattr(self, name) <= 2.0:
                raise ValueError(
                    f"--{option} must be in [0, 2]; got {getattr(self, name)}"
                )
            if self.likelihood == "auto" and getattr(self, name) > 0.0:
                raise ValueError(
                    f"--{option} must be 0 with --likelihood auto, which weighs models "
                    f"of fixed noise and rationality; got {getattr(self, name)}"
                )


@dataclass(frozen=True)
class LearningConfig(ModelConfig):
    """What runs and studies have in common: how the robot learns, and from whom."""

    teacher: TeacherName = "exact"
    """The simulated person: exact; boltzmann, of rationality 100; noisy by 0.02;
    blundering in 10 % of the answers; biased by 0.05 in x; or one who wants the item
    0.15 to the right of an object."""
    truth: Literal["task", "prior"] = "task"
    """What that person wants: what the task says, or weights drawn from the prior."""


@dataclass(frozen=True)
class ArmConfig:
    """How strong the arm is, and how well it knows its world; perfectly unless told."""

    servos: Literal["stiff", "real"] = "stiff"
    """`stiff` position servos are accurate and fast; `real` ones are the Jaco's own, with
    its torques, speeds and weight, and take three times as long."""
    fast: bool = False
    """Simulate in steps of 4 ms instead of 2: faster, half as accurate."""
    item_noise_mm: float = 0.0
    """Standard deviation of the item's seen position, along x and y each."""
    item_noise_deg: float = 0.0
    """Standard deviation of its seen heading."""
    layout_noise_mm: float = 0.0
    """Standard deviation of the seen position of every other object."""
    mass_spread: float = 0.0
    """Mass of every prop up to this much heavier or lighter: 0.5 is from 1/1.5 to 1.5
    times the model's."""
    friction_spread: float = 0.0
    """The same of the friction of props and finger pads."""

    def __post_init__(self) -> None:
        for name, most in (
            ("item_noise_mm", 100.0),
            ("item_noise_deg", 90.0),
            ("layout_noise_mm", 100.0),
            ("mass_spread", 10.0),
            ("friction_spread", 10.0),
        ):
            if not 0.0 <= getattr(self, name) <= most:
                option = name.replace("_", "-")
                raise ValueError(
                    f"--{option} must be in [0, {most:g}]; got {getattr(self, name)}"
                )


def refuse_without_effect(preset: PresetName, learning: ModelConfig) -> None:
    """Refuse options of a model that is not used, and what the paper's sampler has not."""
    likelihood = learning.likelihood or (
        "boltzmann" if preset == "paper" else "placement"
    )
    unused = {
        "boltzmann": ("noise", "noise_spread"),
        "placement": ("beta", "beta_spread"),
        "auto": (),
    }
    refuse_changed(
        learning,
        unused[likelihood],
        f"with the likelihood {likelihood}; leave it out, or choose another --likelihood",
    )
    if preset != "paper":
        return
    if learning.likelihood not in (None, "boltzmann"):
        raise ValueError(
            "--likelihood must be boltzmann with the paper preset, whose chain is made "
            f"for it; got {learning.likelihood}. Use --preset default --points"
        )
    refuse_changed(
        learning,
        ("target_ess", "max_rhat", "num_steps"),
        "in the paper preset, which has its own model and sampler; leave it out",
    )
    if learning.beta_spread > 0.0:
        raise ValueError(
            "--beta-spread must be 0 with the paper preset, whose chain samples weights "
            f"alone; got {learning.beta_spread}"
        )


@dataclass(frozen=True)
class RunConfig:
    """Learn TASK from a simulated person by active queries, then validate.

    The arm carries out the current best guess in every layout that is asked about.
    """

    task: Positional[TaskName]
    """What to place."""
    num_queries: int = 5
    """Queries asked after the first demonstration."""
    strategy: StrategyName = "active-var"
    """How the layout to ask about is chosen."""
    preset: PresetName = "default"
    """`default` is statistically sound and physical; `paper` reproduces the published
    curves, with objects that are points."""
    candidates: Annotated[
        Literal["any", "one-moved"] | None, by_preset("any", "one-moved")
    ] = None
    """Layouts to choose from: drawn anew, or the last one with one object moved."""
    num_candidates: int = 50
    """Layouts to choose from in each round."""
    learning: OmitArgPrefixes[LearningConfig] = field(default_factory=LearningConfig)
    """How the robot learns, and from whom."""
    first_layout: Annotated[
        str | None, by_preset("random", "paper where the task has one")
    ] = None
    """Where the first demonstration is given: `random`, `paper` or a file."""
    layouts: Annotated[str | None, by_preset("valid", "uniform")] = None
    """Test layouts: physically `valid`, `uniform` points, or a file."""
    num_layouts: int = 200
    """Test layouts drawn."""
    epsilon: Annotated[float | None, by_preset("0.05", "0, never")] = None
    """Stop once the bound on the loss is below this, in table units. By default it is
    the confidence bound over layouts such as the robot will meet, in the paper preset
    the largest value at risk of a candidate."""
    delta: float = 0.05
    """Probability that the bound may miss its quantile by Monte Carlo error."""
    require_certificate: bool = False
    """Ask on until the loss is certified to be below epsilon; exit with 1 unless it is."""
    audit: bool = False
    """Log in audit.csv what every strategy would have asked in each round."""
    netcdf: bool = False
    """Write the last posterior for ArviZ as well; needs the extra `arviz`."""
    execute: Annotated[int | None, by_preset("all", "0")] = None
    """Queried layouts in which the arm acts."""
    arm: OmitArgPrefixes[ArmConfig] = field(default_factory=ArmConfig)
    """How strong the arm is, and how well it knows its world."""
    seed: int = 0
    """Seed of all randomness."""
    out: Annotated[
        Path | None, arg(help_behavior_hint="(default: runs/run/TASK-STAMP)")
    ] = None
    """Run folder."""
    resume: bool = False
    """Do the same run in the folder again unless it is finished."""
    overwrite: bool = False
    """Replace an earlier run in the folder."""

    def __post_init__(self) -> None:
        refuse_bad_resume(self)
        refuse_below(
            self, num_queries=0, num_candidates=1, num_layouts=1, execute=0, seed=0
        )
        refuse_above(self, **MOST)
        if self.epsilon is not None and not 0.0 <= self.epsilon < math.inf:
            raise ValueError(f"--epsilon must be 0 or more; got {self.epsilon}")
        refuse_without_effect(self.preset, self.learning)
        if self.require_certificate and (self.preset == "paper" or self.epsilon == 0.0):
            cause = "the paper preset" if self.preset == "paper" else "--epsilon 0"
            raise ValueError(
                f"--require-certificate cannot be met with {cause}; leave one of them out"
            )
        if self.netcdf and self.learning.likelihood == "auto":
            raise ValueError(
                "--netcdf takes one likelihood: a mixture of both has no chains; got "
                "--likelihood auto"
            )
        if not 0.0 < self.delta < 1.0:
            raise ValueError(f"--delta must be in (0, 1); got {self.delta}")
        if (self.preset == "paper" or self.learning.points) and self.execute:
            cause = "the paper preset" if self.preset == "paper" else "--points"
            raise ValueError(
                f"--execute must be 0 with {cause}, where objects are points; "
                f"got {self.execute}"
            )


@dataclass(frozen=True)
class LearnConfig:
    """Learn from recorded demonstrations, and say what is worth asking next.

    Writes a run folder; `learn RUN --append LAYOUT PLACEMENT` goes on with one.
    """

    demos: Positional[Path]
    """A demonstrations file (JSON, or CSV with a row each); with --append, the folder."""
    append: Annotated[
        tuple[str, str] | None, arg(metavar="LAYOUT X,Y", help_behavior_hint="")
    ] = None
    """Learn from one more: its layout, `next` for the one that was asked or a file with
    one, and the placement, as x,y in table units."""
    strategy: StrategyName = "active-var"
    """How the layout to ask about is chosen."""
    preset: PresetName = "default"
    """`default` is statistically sound and physical; `paper` follows the paper, with
    objects that are points."""
    candidates: Annotated[str | None, by_preset("any", "one-moved")] = None
    """Layouts that can be asked about: `any`, the last one with one object moved
    (`one-moved`), or a file of those that can be set up."""
    num_candidates: int = 50
    """Layouts to choose from, unless they are given."""
    learning: OmitArgPrefixes[ModelConfig] = field(default_factory=ModelConfig)
    """How the robot learns."""
    layouts: Annotated[str | None, by_preset("valid", "uniform")] = None
    """Layouts that the robot will meet, over which the bound is: physically `valid`,
    `uniform` points, or a file."""
    num_layouts: int = 200
    """How many of them are drawn."""
    curve: Annotated[bool, arg(help_behavior_hint="(always in the paper preset)")] = (
        False
    )
    """Learn from one demonstration, from two and so on as well, for curves over their
    number."""
    epsilon: float = 0.05
    """The bound on the loss is wanted below this, in table units."""
    delta: float = 0.05
    """Probability that the bound may miss its quantile by Monte Carlo error."""
    seed: int = 0
    """Seed of all randomness."""
    out: Annotated[
        Path | None, arg(help_behavior_hint="(default: runs/learn/NAME-STAMP)")
    ] = None
    """Run folder."""
    resume: bool = False
    """Go on where the same command was cut short."""
    overwrite: bool = False
    """Replace an earlier run in the folder."""

    def __post_init__(self) -> None:
        refuse_below(self, num_candidates=1, num_layouts=1, seed=0)
        refuse_above(self, **MOST)
        if not 0.0 <= self.epsilon < math.inf:
            raise ValueError(f"--epsilon must be 0 or more; got {self.epsilon}")
        if not 0.0 < self.delta < 1.0:
            raise ValueError(f"--delta must be in (0, 1); got {self.delta}")
        refuse_without_effect(self.preset, self.learning)
        _refuse_number_of_given(self)
        if self.candidates not in (None, "any", "one-moved"):
            refuse_changed(
                self, ("num_candidates",), f"with --candidates {self.candidates}"
            )
        if self.append is None:
            refuse_bad_resume(self)
            return
        others = changed_options(self, LearnConfig(self.demos))
        others = [name for name in others if name not in ("--append", "--resume")]
        if others:
            raise ValueError(
                "--append goes on with the settings of its folder; leave out "
                f"{', '.join(others)}"
            )


@dataclass(frozen=True)
class ValidateConfig:
    """Measure how far learned weights put the item from where it is wanted."""

    weights: Positional[tuple[Path, ...]]
    """A weights.json; two of them are compared, layout by layout."""
    against: str = "truth"
    """What is wanted: the task's `truth`, another weights.json, or the placements of a
    demonstrations file, in whose layouts the test then takes place."""
    layouts: Annotated[str | None, arg(help_behavior_hint="(default: valid)")] = None
    """Test layouts: physically `valid`, `uniform` points, or a file."""
    num_layouts: int = 200
    """Test layouts drawn."""
    execute: int = 0
    """Test layouts in which the arm carries out the placement."""
    arm: OmitArgPrefixes[ArmConfig] = field(default_factory=ArmConfig)
    """How strong the arm is, and how well it knows its world."""
    jobs: Annotated[int | None, arg(help_behavior_hint="(default: the cores)")] = None
    """Processes in which arms act at once; results do not depend on it."""
    seed: int = 0
    """Seed of all randomness."""
    out: Annotated[
        Path | None, arg(help_behavior_hint="(default: runs/validate/TASK-STAMP)")
    ] = None
    """Folder for the results."""
    resume: bool = False
    """Go on with the same validation in the folder."""
    overwrite: bool = False
    """Replace an earlier one in the folder."""

    def __post_init__(self) -> None:
        if len(self.weights) not in (1, 2):
            raise ValueError(
                f"give one or two files of weights; got {len(self.weights)}"
            )
        refuse_below(self, num_layouts=1, execute=0, jobs=1, seed=0)
        refuse_above(self, **MOST)
        _refuse_number_of_given(self)
        refuse_bad_resume(self)
        if self.execute and self.layouts == "uniform":
            raise ValueError(
                "--execute must be 0 with --layouts uniform, where objects are points "
                f"that may overlap; got {self.execute}"
            )


@dataclass(frozen=True)
class InspectConfig:
    """Open the recording of a run in the Rerun viewer, or tell it in words.

    Of a folder with runs in it, lists them.
    """

    run: Positional[Path]
    """A run folder, a recording, or a folder with runs in it."""
    text: bool = False
    """Print the story of the run; needs no viewer."""
    web: bool = False
    """Serve the viewer on this machine, for a browser."""
    screenshot: Annotated[Path | None, arg(help_behavior_hint="")] = None
    """Render the recording without a display and write a PNG."""
    at: Annotated[float | None, arg(help_behavior_hint="(default: its end)")] = None
    """Time on the recording's clock that the screenshot shows, in seconds."""
    query: Annotated[int | None, arg(help_behavior_hint="(default: all)")] = None
    """Number of demonstrations: tells the round after them alone; --screenshot shows its
    end."""

    def __post_init__(self) -> None:
        chosen = [self.text, self.web, self.screenshot is not None]
        if sum(chosen) > 1:
            raise ValueError("choose one of --text, --web and --screenshot")
        if self.query is not None and self.web:
            raise ValueError("--query goes with --text or --screenshot, not with --web")
        if self.query is not None and self.at is not None:
            raise ValueError("choose one of --at and --query")
        if self.at is not None and not 0.0 <= self.at < math.inf:
            raise ValueError(f"--at must be 0 or more; got {self.at}")


@dataclass(frozen=True)
class ReplayConfig:
    """Repeat an executed episode of a run, and say whether it is the same bit for bit."""

    run: Positional[Path]
    """A run folder."""
    query: Annotated[int | None, arg(help_behavior_hint="(default: the last)")] = None
    """After how many demonstrations the episode was."""


@dataclass(frozen=True)
class ExportConfig:
    """Write a run in a format that other programs read."""

    run: Positional[Path]
    """A run folder."""
    to: Literal["lerobot", "csv", "npz"]
    """Executed episodes as a LeRobot v3 dataset, rounds and demonstrations as tables, or
    the posterior with the demonstrations as arrays."""
    out: Annotated[Path | None, arg(help_behavior_hint="(default: RUN-FORMAT)")] = None
    """New folder."""
    overwrite: bool = False
    """Replace an earlier export in the folder."""


@dataclass(frozen=True)
class DoctorConfig:
    """Check that everything that the commands need is there and works."""

    out: Path = Path("runs")
    """Folder that results go to."""
