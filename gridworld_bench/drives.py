"""Drives as JSON: what was done in which situation on the highway."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from gridworld_bench.highway import ACTIONS, DRIVERS, Highway, Situation
from gridworld_bench.likelihood import Evidence
from tablesetting.errors import InvalidFile
from tablesetting.results import RunFolder, read_json

DRIVE_FORMAT = "gridworld-drive/1"
LONGEST = 60
"""Most steps ahead that a road is seen."""


@dataclass(frozen=True)
class Drive:
    """Steps on a road; what was said in single situations counts as such too.

    Attributes:
        highway: The road.
        states: Where everyone was before each step, T of them.
        actions: What the driver did, T of them.
        driver: Who drove.
    """

    highway: Highway
    states: tuple[int, ...]
    actions: tuple[int, ...]
    driver: str = "person"

    def first(self, num_steps: int) -> "Drive":
        """Return the first steps."""
        states, actions = self.states[:num_steps], self.actions[:num_steps]
        return replace(self, states=states, actions=actions)

    @property
    def evidence(self) -> Evidence:
        """The steps as judgments that each action is a best one."""
        return Evidence.of_pairs(list(zip(self.states, self.actions, strict=True)))


def save_drive(path: Path, drive: Drive) -> None:
    """Write a drive.

    Raises:
        OutputError: If it cannot be written; no half of it remains.
    """
    situations = [drive.highway.situations[state] for state in drive.states]
    content = {
        "format": DRIVE_FORMAT,
        "length": drive.highway.length,
        "driver": drive.driver,
        "steps": [
            describe(each) | {"action": ACTIONS[action]}
            for each, action in zip(situations, drive.actions, strict=True)
        ],
    }
    RunFolder.make(path.parent).write_json(path.name, content)


def describe(situation: Situation) -> dict[str, Any]:
    """Return a situation as JSON has it."""
    cars = [list(car) for car in situation.cars]
    return {"position": situation.agent, "cars": cars}


def read_drive(path: Path) -> Drive:
    """Read a drive.

    Raises:
        InvalidFile: If it cannot be read, has no step, or one in a situation or of an
            action that cannot be. That a step leads to the next is not asked for.
    """
    content = read_json(path, DRIVE_FORMAT)
    length, steps = content.get("length"), content.get("steps")
    if type(length) is not int or not 2 <= length <= LONGEST:
        raise InvalidFile(
            f"'{path}': `length` must be a whole number in [2, {LONGEST}]; got "
            f"{length!r:.60}"
        )
    if not isinstance(steps, list) or not steps:
        raise InvalidFile(f"'{path}': `steps` must be a list of at least one")
    highway, states, actions = Highway(length), list[int](), list[int]()
    for number, step in enumerate(steps):
        try:
            states.append(highway.state_of(_situation(step)))
            actions.append(ACTIONS.index(step["action"]))
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidFile(
                f"'{path}': step {number} must have a `position` from 0 to 4, at most two "
                f"`cars` in different places as [lane, distance], with lanes from 1 to 3 "
                f"and distances below {length}, and an `action` of {', '.join(ACTIONS)}; "
                f"got {step!r:.80}"
            ) from error
    driver = content.get("driver", "person")
    if not isinstance(driver, str) or not driver.isprintable() or len(driver) > 80:
        raise InvalidFile(
            f"'{path}': `driver` must be a printable name of 80 characters at most; got "
            f"{driver!r:.80}"
        )
    return Drive(highway, tuple(states), tuple(actions), driver)


def shipped_drive(driver: str) -> Drive:
    """Return a recorded drive of twenty steps of a scripted driver.

    Raises:
        KeyError: If there is no such driver.
    """
    if driver not in DRIVERS:
        raise KeyError(driver)
    name = f"drive_{driver}.json"
    with as_file(files("gridworld_bench").joinpath("data", name)) as path:
        return read_drive(path)


def _situation(step: Mapping[str, Any]) -> Situation:
    """Return the situation of a step; whatever is wrong raises."""
    cars = [tuple(car) for car in step["cars"]]
    numbers = [step["position"], *(number for car in cars for number in car)]
    if any(type(number) is not int for number in numbers):
        raise TypeError
    return Situation(step["position"], tuple(sorted(cars)))
