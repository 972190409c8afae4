"""What a robot learns from a drive, which situations are risky, and what answers add."""

from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from itertools import islice
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
from gridworld_bench.experiments.driving_figure import draw_riskiest
from gridworld_bench.experiments.driving_recording import record_driving
from gridworld_bench.experiments.driving_view import View
from gridworld_bench.highway import ACTIONS, Highway
from gridworld_bench.likelihood import Evidence
from gridworld_bench.mdp import best_policy
from gridworld_bench.posterior import CoordinateChain, MdpPosterior
from gridworld_bench.problem import MdpConfig
from gridworld_bench.queries import Query
from gridworld_bench.strategies import ACTION_METHODS
from gridworld_bench.window import Window, open_window
from tablesetting.errors import InvalidFile
from tablesetting.irl.active import Round, run_active
from tablesetting.irl.risk import RiskConfig
from tablesetting.opening import open_folder
from tablesetting.options import to_options
from tablesetting.results import CONFIG_FORMAT, SUMMARY, package_versions

FIGURE = "figures/riskiest.png"
RECORDING = "recording.rrd"


class WindowClosed(Exception):
    """The person ended the questions."""


def learn_driving(config: DrivingConfig, out: Path) -> list[str]:
    """Learn from a drive, and ask; return what was found in words, line by line.

    Raises:
        InvalidFile: If the drive cannot be read, or is too short.
        OutputError: If the folder is taken, or cannot be written.
        NoWindow: If a person is to answer, but no window can be opened.
    """
    driven = read_drive(config.demos) if config.demos else shipped_drive(config.driver)
    if len(driven.states) < config.steps[-1]:
        raise InvalidFile(
            f"'{config.demos or config.driver}' has {len(driven.states)} steps; ask for "
            f"no more by --steps, got {config.steps[-1]}"
        )
    settings = {
        "format": CONFIG_FORMAT,
        "command": "driving",
        "options": to_options(config, ("out", "overwrite")),
        "resolved": {"length": driven.highway.length},
        "versions": package_versions(),
    }
    asks_person = config.answers == "person"
    window = open_window(driven.highway.length) if asks_person else nullcontext()
    with (
        window as opened,
        open_folder(out, settings, resume=False, overwrite=config.overwrite) as folder,
    ):
        views = list[View]()
        for view in _learn(config, driven, opened):
            views.append(view)
            folder.write_rows([each.row for each in views])
        highway = driven.highway
        folder.write(FIGURE, draw_riskiest(highway, views).savefig)
        folder.write(RECORDING, lambda path: record_driving(path, driven, views))
        folder.write_json(SUMMARY, {"driver": driven.driver, "last": views[-1].row})
    return [
        *_tell(config, views),
        "",
        f"figure: {out / FIGURE}",
        f"recording: {out / RECORDING}",
    ]


def _learn(
    config: DrivingConfig, driven: Drive, window: Window | None
) -> Iterator[View]:
    highway = driven.highway
    answer = None if window is None else _asking(highway, window)
    problem = DrivingProblem(
        highway,
        config.driver,
        MdpConfig(CoordinateChain(num_samples=config.num_samples)),
        sample_states(config.num_sampled_states),
        answer,
    )
    score = ACTION_METHODS[config.strategy].score
    for num_steps in config.steps:
        seeds = np.random.SeedSequence(config.seed, spawn_key=(num_steps,))
        loop_rng, road_rng = map(np.random.default_rng, seeds.spawn(2))
        rounds = run_active(
            problem, [driven.first(num_steps)], score, RiskConfig(), rng=loop_rng
        )
        num_queries = config.num_queries if num_steps == config.steps[-1] else 0
        yield from _ask(config, problem, rounds, num_steps, num_queries, road_rng)


def _ask(
    config: DrivingConfig,
    problem: DrivingProblem,
    rounds: Iterator[Round[Query, Evidence]],
    num_steps: int,
    num_queries: int,
    rng: np.random.Generator,
) -> Iterator[View]:
    """View every round, and stop once nothing is risky any more."""
    previous: View | None = None
    try:
        for count, latest in enumerate(islice(rounds, num_queries + 1)):
            if previous is not None:
                answer = int(latest.demos[-1].actions[0])
                yield replace(previous, answer=answer)
            posterior = cast(MdpPosterior, latest.posterior)
            states = np.array([query.start for query in latest.candidates])
            policy = best_policy(problem.mdp, posterior.guessed_weights)
            previous = View(
                num_steps,
                count,
                find_riskiest(states, latest.var),
                try_out(problem.highway, policy, rng=rng),
                latest.query.start if count < num_queries else None,
            )
            if latest.var_bound < config.epsilon:
                break
    except WindowClosed:
        pass
    if previous is not None:
        yield replace(previous, asked=None)


def _asking(highway: Highway, window: Window) -> Answer:
    """Return who asks the person in the window."""

    def ask(state: int) -> int:
        while True:
            window.show(highway.situations[state], 0, ("What should be done here?",))
            command = window.wait_for_key()
            if command == "end":
                raise WindowClosed
            if command in ACTIONS:
                return ACTIONS.index(command)

    return ask


def _tell(config: DrivingConfig, views: list[View]) -> list[str]:
    lines = [
        f"# driving: seed {config.seed}, {config.num_sampled_states} sampled states; "
        "collisions and steps off the road of 1 000 steps of the robot's policy",
        "",
        "| driven steps | answers | largest 0.95-VaR | collisions | off the road |",
        "|---|---|---|---|---|",
    ]
    for view in views:
        lines.append(
            f"| {view.num_steps} | {view.num_queries} | {view.riskiest.var[0]:.4f} | "
            f"{view.record.collisions} | {view.record.off_road} |"
        )
    last = views[-1]
    if config.num_queries and last.riskiest.var[0] < config.epsilon:
        lines += ["", f"No more questions: the VaR is below {config.epsilon:g}."]
    return lines
