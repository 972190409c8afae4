"""The files of a run folder, kept complete after every round."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from tablesetting.experiments.arm import Attempt
from tablesetting.experiments.audit import audit_rows
from tablesetting.experiments.certificate import certificate_to_json
from tablesetting.experiments.config import RunConfig
from tablesetting.experiments.posterior_files import save_posterior
from tablesetting.experiments.rounds import RunRound, round_row
from tablesetting.experiments.setup import RunSetup
from tablesetting.irl.arrays import Array
from tablesetting.irl.netcdf import save_netcdf
from tablesetting.options import to_options
from tablesetting.plotting import plot_learning, plot_query
from tablesetting.results import (
    CERTIFICATE,
    CONFIG_FORMAT,
    ROUNDS,
    RunFolder,
    package_versions,
    read_rows,
)
from tablesetting.reward.files import (
    DEMONSTRATIONS,
    demonstrations_to_json,
    layout_to_json,
    weights_to_json,
)
from tablesetting.reward.problem import PlacementProblem

_MAP_SIZE = 96
_OF_ONE_CALL = ("out", "resume", "overwrite")


def run_settings(config: RunConfig, setup: RunSetup) -> dict[str, Any]:
    """Return the content of config.json: the options, and what they resolve to."""
    task = setup.problem.task
    resolved = {
        "problem": asdict(setup.problem.config),
        "first_layout": layout_to_json(setup.first_layout, task.objects),
        "num_layouts": len(setup.validation.layouts),
        "epsilon": setup.epsilon,
        "num_executions": setup.num_executions,
    }
    return {
        "format": CONFIG_FORMAT,
        "command": "run",
        "options": to_options(config, _OF_ONE_CALL),
        "resolved": json.loads(json.dumps(resolved)),
        "versions": package_versions(),
    }


class RunFiles:
    """Writes one run into its folder, round by round."""

    def __init__(self, folder: RunFolder, config: RunConfig, setup: RunSetup):
        self._folder = folder
        self._config = config
        self._setup = setup
        self._rounds: list[RunRound] = []
        self._audit: list[dict[str, object]] = []
        self._started = perf_counter()

    def add(self, latest: RunRound) -> None:
        """Add a round to the table and bring all other files up to date."""
        self._rounds.append(latest)
        problem, posterior = self._setup.problem, latest.learning.posterior
        self._folder.append_rows([round_row(latest)])
        self._folder.write_json(
            DEMONSTRATIONS,
            demonstrations_to_json(latest.learning.demos, problem.task),
        )
        widths = problem.config.widths
        self._folder.write_json(
            "weights.json",
            weights_to_json(posterior.guessed_weights, problem.task, widths),
        )
        self._folder.write(
            "posterior.npz", lambda path: save_posterior(path, posterior)
        )
        self._draw_query(latest)
        if self._config.audit:
            self._audit += audit_rows(latest.state, self._config.strategy)
            self._folder.write_rows(self._audit, "audit.csv")
        if self._config.netcdf:
            self._folder.write(
                "posterior.nc", lambda path: _save_netcdf(path, latest, problem)
            )

    def summarize(self, stopped: str) -> dict[str, Any]:
        """Write certificate and curves; return the final figures."""
        last = self._rounds[-1]
        certificate = certificate_to_json(last.state)
        self._folder.write_json(CERTIFICATE, certificate)
        summary = {
            "task": self._config.task,
            "strategy": self._config.strategy,
            "preset": self._config.preset,
            "seed": self._config.seed,
            "num_demos": last.num_demos,
            "stopped": stopped,
            "mean_placement_error": float(last.errors.mean()),
            "max_placement_error": float(last.errors.max()),
            "var_bound": last.learning.var_bound,
            "epsilon": self._setup.epsilon,
            "deployment_bound": certificate["bound"],
            "share_within_epsilon": last.state.share_within_epsilon,
            "certified": certificate["certified"],
            "doubts": certificate["doubts"],
            "executions": summarize_attempts(
                [each.attempt for each in self._rounds if each.attempt is not None]
            ),
            "seconds": self._seconds(),
        }
        figure = plot_learning(read_rows(self._folder.path / ROUNDS), self._title)
        self._folder.write("figures/learning.png", figure.savefig)
        return summary

    def _seconds(self) -> Mapping[str, float]:
        learning = [each.learning for each in self._rounds]
        attempts = [each.attempt for each in self._rounds if each.attempt]
        seconds = {
            "inference": sum(each.inference_seconds for each in learning),
            "queries": sum(each.query_seconds for each in learning),
            "simulation": sum(attempt.seconds for attempt in attempts),
            "total": perf_counter() - self._started,
        }
        return {name: round(value, 3) for name, value in seconds.items()}

    @property
    def _title(self) -> str:
        return f"place {self._setup.problem.task.item}, {self._config.strategy}"

    def _draw_query(self, latest: RunRound) -> None:
        problem, query = self._setup.problem, latest.learning.query
        demos = f"{latest.num_demos} demonstration{'s' * (latest.num_demos > 1)}"
        weights = latest.learning.posterior.guessed_weights
        figure = plot_query(
            problem.reward_map(weights, query, _MAP_SIZE),
            problem.space.outlines(query),
            self._marked(latest),
            f"{self._title}: after {demos}",
        )
        name = f"figures/query_{latest.num_demos:02d}.png"
        self._folder.write(name, figure.savefig)

    def _marked(self, latest: RunRound) -> dict[str, Array]:
        """Name the places that a query is about."""
        marked = {"robot's wish": latest.placement}
        if latest.stopped is None:
            marked["person's wish"] = latest.truth
        if latest.attempt is not None:
            marked["commanded, as it fits"] = latest.attempt.commanded
        return marked


def summarize_attempts(attempts: list[Attempt]) -> dict[str, float | int | None]:
    """Count successes and give the spread of the errors of what was carried out."""
    made = [attempt for attempt in attempts if not attempt.is_refused]
    errors = [attempt.error_mm for attempt in made]
    shifts = [attempt.max_bystander_shift_mm for attempt in made]
    tilts = [attempt.tilt_deg for attempt in made if attempt.receptacle is None]
    return {
        "attempted": len(made),
        "succeeded": sum(attempt.failure is None for attempt in made),
        "refused": len(attempts) - len(made),
        "median_error_mm": _statistic(np.median, errors),
        "p95_error_mm": _statistic(lambda values: np.quantile(values, 0.95), errors),
        "max_error_mm": _statistic(np.max, errors),
        "max_bystander_shift_mm": _statistic(np.max, shifts),
        "max_tilt_deg": _statistic(np.max, tilts),
    }


def _statistic(statistic: Any, values: list[float | None]) -> float | None:
    """Apply a statistic, rounded to a micrometre or less; None without values."""
    return round(float(statistic(values)), 4) if values else None


def _save_netcdf(path: Path, latest: RunRound, problem: PlacementProblem) -> None:
    posterior = latest.learning.posterior
    shape = (posterior.num_chains, -1)
    variables = {"weights": posterior.weights.reshape(*shape, len(problem.widths))}
    if posterior.scales is not None:
        variables["scale"] = posterior.scales.reshape(shape)
    save_netcdf(
        path,
        variables,
        {"lp": posterior.log_posts.reshape(shape)},
        {"task": problem.task.name, "num_demos": latest.num_demos},
    )
