"""The options of the two commands about driving; light to import."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from gridworld_bench.experiments.config import LEAST, MOST, ActionStrategy, Driver
from tablesetting.options import refuse_above, refuse_below

_MOST = MOST | {"num_samples": 20_000, "num_queries": 1000}
_LONGEST = 100_000  # Steps of a drive.


@dataclass(frozen=True)
class DriveConfig:
    """Drive on the highway by the arrow keys, or let a script do it."""

    steps: int = 20
    """Steps to be driven."""
    driver: Literal["person", Driver] = "person"
    """Who drives: a person in a window, or a script."""
    period: Annotated[
        float | None, arg(help_behavior_hint="(default: step by step)")
    ] = None
    """Seconds for each step, in which no key means to stay; without, time waits for a
    key."""
    length: int = 10
    """Steps ahead that the road is seen."""
    seed: int = 0
    """Seed of where the drive starts and of the other cars."""
    out: Path = Path("demos.json")
    """File for the drive, written after every step."""
    overwrite: bool = False
    """Replace an earlier drive in the file."""

    def __post_init__(self) -> None:
        refuse_below(self, **LEAST, steps=1)
        refuse_above(self, **_MOST, steps=_LONGEST)
        if self.period is not None and not 0.0 < self.period < math.inf:
            raise ValueError(f"--period must be positive; got {self.period}")
        if self.period is not None and self.driver != "person":
            raise ValueError("--period has no effect unless --driver is person")


@dataclass(frozen=True)
class DrivingConfig:
    """Learn from a drive; see which situations are the riskiest, and ask about them."""

    demos: Annotated[
        Path | None, arg(help_behavior_hint="(default: a drive of --driver)")
    ] = None
    """The drive, as `drive` writes it."""
    driver: Annotated[
        Driver | None, arg(help_behavior_hint="(default: who drove, or safe)")
    ] = None
    """Who drives without --demos, and answers."""
    steps: tuple[int, ...] = (5, 10, 20)
    """After how many driven steps to look at the riskiest situations."""
    num_queries: Annotated[int, arg(aliases=("--queries",))] = 0
    """Questions after the last of these, at most."""
    strategy: ActionStrategy = "active-var"
    """Chooses the questions."""
    answers: Literal["driver", "person"] = "driver"
    """Who answers them: the scripted driver, or a person in a window."""
    epsilon: float = 0.05
    """No more questions once no sampled state has a larger 0.95-VaR."""
    num_sampled_states: int = 200
    """States that are drawn and evaluated, before each question anew."""
    num_samples: int = 1000
    """Samples of the paper's chain, of five proposals each."""
    seed: int = 0
    """Seed of all randomness."""
    out: Annotated[
        Path | None, arg(help_behavior_hint="(default: runs/grid/driving-STAMP)")
    ] = None
    """Folder for the results."""
    overwrite: bool = False
    """Replace an earlier run in the folder."""

    def __post_init__(self) -> None:
        refuse_below(self, **LEAST)
        refuse_above(self, **_MOST)
        if (
            not self.steps
            or min(self.steps) < 1
            or list(self.steps) != sorted(set(self.steps))
        ):
            given = " ".join(map(str, self.steps)) or "none"
            raise ValueError(
                f"--steps must be rising numbers of steps, at least 1; got {given}"
            )
        if not 0.0 < self.epsilon < math.inf:
            raise ValueError(f"--epsilon must be positive; got {self.epsilon}")
        if self.answers == "person" and not self.num_queries:
            raise ValueError("--answers person has no effect without --num-queries")


DRIVING_CONFIGS = {"drive": DriveConfig, "driving": DrivingConfig}
"""The options of each command, by its name."""
