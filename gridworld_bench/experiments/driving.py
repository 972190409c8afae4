"""What a robot learns from a drive, which situations are risky, and what answers add."""

import sys
from contextlib import nullcontext
from pathlib import Path
from typing import cast

import numpy as np

from gridworld_bench.drives import Drive, read_drive, shipped_drive
from gridworld_bench.driving import (
    Answer,
    DrivingProblem,
    find_riskiest,
    sample_states,
    try_out,
)
from gridworld_bench.experiments.driving_config import DrivingConfig
from gridworld_bench.experiments.driving_log import DrivingLog
from gridworld_bench.experiments.driving_view import View
from gridworld_bench.highway import ACTIONS, DRIVERS, Highway
from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import best_policy
from gridworld_bench.posterior import CoordinateChain, MdpPosterior
from gridworld_bench.problem import MdpConfig
from gridworld_bench.queries import Query
from gridworld_bench.strategies import ACTION_METHODS
from gridworld_bench.window import Window, WindowClosed, open_window
from tablesetting.command_line import telling_why_it_stops
from tablesetting.errors import InvalidFile
from tablesetting.irl.active import Round, run_active
from tablesetting.irl.risk import RiskConfig
from tablesetting.opening import open_folder
from tablesetting.options import to_options
from tablesetting.results import CONFIG_FORMAT, package_versions

_KEYS = ("arrows answer, up is to stay in the lane", "q ends")


def learn_driving(config: DrivingConfig, out: Path) -> list[str]:
    """Learn from a drive, and ask; return what was found in words, line by line.

    Raises:
        InvalidFile: If the drive cannot be read, or is too short.
        OutputError: If the folder is taken, or cannot be written.
        NoWindow: If a person is to answer, but no window can be opened.
    """
    driven = _find_drive(config)
    driver = config.driver or (driven.driver if driven.driver in DRIVERS else "safe")
    asks_person = config.answers == "person"
    settings = {
        "format": CONFIG_FORMAT,
        "command": "driving",
        "options": to_options(config, ("out", "overwrite")),
        "resolved": {"length": driven.highway.length, "driver": driver},
        "versions": package_versions(),
    }
    window = (
        open_window(driven.highway.length, _KEYS, remedy="use --answers driver")
        if asks_person
        else nullcontext()
    )
    is_closed = False
    with (
        window as opened,
        open_folder(out, settings, resume=None, overwrite=config.overwrite) as folder,
    ):
        log = DrivingLog(folder, driven, "person" if asks_person else driver)
        try:
            with telling_why_it_stops(lambda: f"what was learned is in '{out}'"):
                _learn(config, driven, driver, opened, log)
        except WindowClosed:
            is_closed = True
        finally:  # What was learned is drawn, whatever happened.
            log.finish()
    if is_closed:
        print(
            f"ended after {log.num_answers} of {config.num_queries} answers, which are "
            "saved",
            file=sys.stderr,
        )
    return [*_tell(config, log), "", *log.paths()]


def _find_drive(config: DrivingConfig) -> Drive:
    """Read the drive, cut to what is learned from."""
    name = config.driver or "safe"
    driven = read_drive(config.demos) if config.demos else shipped_drive(name)
    if len(driven.states) < config.steps[-1]:
        raise InvalidFile(
            f"'{config.demos or name}' has {len(driven.states)} steps; ask for no more by "
            f"--steps, got {config.steps[-1]}"
        )
    return driven.first(config.steps[-1])


def _learn(
    config: DrivingConfig,
    driven: Drive,
    driver: str,
    window: Window | None,
    log: DrivingLog,
) -> None:
    highway = driven.highway
    ask = None if window is None else _asking(highway, window)

    def answer(state: int) -> int:
        action = int(problem.policy[state]) if ask is None else ask(state)
        log.add_answer(action)
        return action

    problem = DrivingProblem(
        highway,
        driver,
        MdpConfig(CoordinateChain(num_samples=config.num_samples)),
        sample_states(config.num_sampled_states),
        answer,
    )
    score = ACTION_METHODS[config.strategy].score
    for num_steps in config.steps:
        if window is not None:
            if log.views and window.is_closed:
                raise WindowClosed
            window.say(f"learning from {num_steps} steps ...")
        seeds = np.random.SeedSequence(config.seed, spawn_key=(num_steps,))
        loop_rng, road_rng = map(np.random.default_rng, seeds.spawn(2))
        shown = driven.first(num_steps).evidence
        rounds = run_active(problem, [shown], score, RiskConfig(), rng=loop_rng)
        num_queries = config.num_queries if num_steps == config.steps[-1] else 0
        for count, latest in enumerate(rounds):
            is_last = count == num_queries or latest.var_bound < config.epsilon
            asked = None if is_last else latest.query.start
            log.add(_view(problem, latest, num_steps, asked, rng=road_rng))
            if is_last:
                break


def _view(
    problem: DrivingProblem,
    latest: Round[Query, Evidence],
    num_steps: int,
    asked: int | None,
    *,
    rng: np.random.Generator,
) -> View:
    """Try the robot's policy on the road, and find what is risky."""
    states = np.array([query.start for query in latest.candidates])
    posterior = cast(MdpPosterior, latest.posterior)
    policy = best_policy(problem.mdp, posterior.guessed_weights)
    return View(
        num_steps,
        len(latest.demos) - 1,
        find_riskiest(states, latest.var),
        try_out(problem.highway, policy, rng=rng),
        asked,
    )


def _asking(highway: Highway, window: Window) -> Answer:
    """Return who asks the person in the window."""

    def ask(state: int) -> int:
        window.forget_keys()
        while True:
            window.show(highway.situations[state], 0, ("What should be done here?",))
            command = window.wait_for_key()
            if command == "end":
                raise WindowClosed
            if command in ACTIONS:
                window.say("thinking ...")
                return ACTIONS.index(command)

    return ask


def _tell(config: DrivingConfig, log: DrivingLog) -> list[str]:
    views, num_states = log.views, log.driven.highway.mdp.num_states
    num_sampled = min(config.num_sampled_states, num_states)
    answers = f", answers by {log.answers_by}" if config.num_queries else ""
    lines = [
        f"# driving: driver {log.driven.driver}{answers}, seed {config.seed}, "
        f"{num_sampled} sampled states; collisions and steps off the road of 1 000 steps of "
        "the robot's policy",
        "",
        "| driven steps | answers | largest 0.95-VaR | collisions | off the road |",
        "|---|---|---|---|---|",
    ]
    for view in views:
        lines.append(
            f"| {view.num_steps} | {view.num_queries} | {view.riskiest.var[0]:.4f} | "
            f"{view.record.collisions} | {view.record.off_road} |"
        )
    if config.num_queries and views[-1].riskiest.var[0] < config.epsilon:
        lines += ["", f"No more questions: the VaR is below {config.epsilon:g}."]
    return lines
