"""A drive by a person in a window, or by a script."""

import sys

import numpy as np

from gridworld_bench.drives import DRIVE_FORMAT, Drive, save_drive
from gridworld_bench.driving import drive as drive_by_script
from gridworld_bench.driving import road_starts
from gridworld_bench.experiments.driving_config import DriveConfig
from gridworld_bench.highway import ACTIONS, STAY, Highway
from gridworld_bench.queries import step
from gridworld_bench.window import Window, open_window
from tablesetting.errors import OutputError, TableSettingError
from tablesetting.results import format_of

_KEYS = (
    "arrows drive, up stays in the lane",
    "backspace undoes, p pauses, s saves, q ends",
)


class NothingDriven(TableSettingError):
    """A drive ended before its first step."""


def record_drive(config: DriveConfig) -> list[str]:
    """Record a drive; return what became of it in words, line by line.

    Raises:
        OutputError: If the file is there already, or cannot be written.
        NoWindow: If a person is to drive, but no window can be opened.
        NothingDriven: If the person ended it before the first step.
    """
    out = config.out
    if out.is_dir() or (out.exists() and format_of(out) != DRIVE_FORMAT):
        raise OutputError(
            f"'{out}' exists already and is no drive; choose another --out"
        )
    if out.exists() and not config.overwrite:
        raise OutputError(
            f"'{out}' exists already; replace it by --overwrite, or choose another --out"
        )
    highway, rng = Highway(config.length), np.random.default_rng(config.seed)
    if config.driver != "person":
        driven = drive_by_script(highway, config.driver, config.steps, rng=rng)
        save_drive(out, driven)
    else:
        remedy = "let --driver safe drive"
        with open_window(config.length, _KEYS, remedy=remedy) as window:
            driven = _drive_by_person(config, highway, window, rng=rng)
    num_steps = len(driven.states)
    if not num_steps:
        raise NothingDriven("no step was driven, so that nothing is saved; try again")
    if num_steps < config.steps:
        print(
            f"ended after {num_steps} of {config.steps} steps, which are saved",
            file=sys.stderr,
        )
    collided = sum(highway.is_collision[state] for state in driven.states)
    return [
        f"{num_steps} steps by {driven.driver}, {collided} of them in a collision",
        f"drive: {out}",
    ]


def _drive_by_person(
    config: DriveConfig, highway: Highway, window: Window, *, rng: np.random.Generator
) -> Drive:
    """Follow the keys; what was driven is on the disk after every step."""
    states, actions = [int(rng.choice(road_starts(highway)))], list[int]()

    def driven() -> Drive:
        return Drive(highway, tuple(states[: len(actions)]), tuple(actions))

    words, is_paused = "", False
    while len(actions) < config.steps:
        notice = "paused; p goes on" if is_paused else ""
        progress = f"step {len(actions) + 1} of {config.steps}  {words}  {notice}"
        window.show(highway.situations[states[-1]], len(actions), (progress,))
        command = window.wait_for_key(None if is_paused else config.period)
        words = ""
        if command == "end":
            break
        if command == "pause":
            is_paused = not is_paused
            continue
        if command == "undo" and actions:
            states.pop()
            actions.pop()
            words = "undone"
            if not actions:
                config.out.unlink(missing_ok=True)
        elif command == "save":
            words = f"saved to {config.out.name}" if actions else "nothing to save yet"
        elif command is None or command in ACTIONS:
            is_paused = False
            actions.append(STAY if command is None else ACTIONS.index(command))
            states.append(step(highway.mdp, states[-1], actions[-1], rng=rng))
        if actions:
            save_drive(config.out, driven())
    return driven()
