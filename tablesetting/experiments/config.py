"""What a run can be told; light to import, so that the command line answers at once."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

TaskName = Literal["vase", "spoon"]
StrategyName = Literal["active-var", "random"]
PresetName = Literal["default", "paper"]


def by_preset(default: str, paper: str) -> Any:
    """Say in the help what an option is by default, under either preset."""
    return arg(help_behavior_hint=f"(default: {default}; paper preset: {paper})")


def refuse_below(config: object, **least: int) -> None:
    """Refuse options that are below the least that has a meaning."""
    for name, bound in least.items():
        value = getattr(config, name)
        if value is not None and value < bound:
            option = name.replace("_", "-")
            raise ValueError(f"--{option} must be at least {bound}; got {value}")


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
    first_layout: Annotated[
        str | None, by_preset("random", "paper where the task has one")
    ] = None
    """Where the first demonstration is given: `random`, `paper` or a file."""
    layouts: Annotated[str | None, by_preset("valid", "uniform")] = None
    """Test layouts: physically `valid`, `uniform` points, or a file."""
    num_layouts: int = 200
    """Test layouts drawn."""
    epsilon: Annotated[float | None, by_preset("0.05", "0, never")] = None
    """Stop once the value at risk of every candidate is below this, in table units."""
    execute: Annotated[int | None, by_preset("all", "0")] = None
    """Queried layouts in which the arm acts."""
    seed: int = 0
    """Seed of all randomness."""
    out: Annotated[
        Path | None, arg(help_behavior_hint="(default: runs/run/TASK-STAMP)")
    ] = None
    """Run folder."""
    overwrite: bool = False
    """Replace an earlier run in the folder."""

    def __post_init__(self) -> None:
        refuse_below(
            self, num_queries=0, num_candidates=1, num_layouts=1, execute=0, seed=0
        )
        if self.epsilon is not None and not 0.0 <= self.epsilon < math.inf:
            raise ValueError(f"--epsilon must be 0 or more; got {self.epsilon}")
        if self.preset == "paper" and self.execute:
            raise ValueError(
                f"--execute must be 0 with the paper preset, whose objects are points; "
                f"got {self.execute}"
            )


@dataclass(frozen=True)
class InspectConfig:
    """Open the recording of a run in the Rerun viewer, or tell it in words."""

    run: Positional[Path]
    """A run folder, or a recording."""
    text: bool = False
    """Print the story of the run; needs no viewer."""
    web: bool = False
    """Serve the viewer on this machine, for a browser."""
    screenshot: Annotated[Path | None, arg(help_behavior_hint="")] = None
    """Render the recording without a display and write a PNG."""
    at: Annotated[float | None, arg(help_behavior_hint="(default: its end)")] = None
    """Time on the recording's clock that the screenshot shows, in seconds."""

    def __post_init__(self) -> None:
        chosen = [self.text, self.web, self.screenshot is not None]
        if sum(chosen) > 1:
            raise ValueError("choose one of --text, --web and --screenshot")
        if self.at is not None and not 0.0 <= self.at < math.inf:
            raise ValueError(f"--at must be 0 or more; got {self.at}")


@dataclass(frozen=True)
class DoctorConfig:
    """Check that everything that the commands need is there and works."""

    out: Path = Path("runs")
    """Folder that results go to."""
