"""The files of a session with recorded demonstrations."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tablesetting.errors import InvalidFile
from tablesetting.experiments.certificate import certificate_to_json
from tablesetting.experiments.config import LearnConfig
from tablesetting.experiments.learn_setup import LearnSetup
from tablesetting.experiments.learning import LearningRound
from tablesetting.experiments.posterior_files import save_posterior
from tablesetting.experiments.rows import posterior_cells, rounded, seconds_cells
from tablesetting.irl.arrays import Array
from tablesetting.irl.risk import value_at_risk, var_upper_bound
from tablesetting.plotting import plot_learning, plot_query
from tablesetting.results import (
    CERTIFICATE,
    RECORDING,
    ROUNDS,
    SUMMARY,
    Row,
    RunFolder,
    finite_or_none,
    numbers,
    read_rows,
    read_table,
)
from tablesetting.reward.files import (
    LAYOUTS_FORMAT,
    layout_to_json,
    weights_to_json,
)

NEXT_LAYOUT = "next_layout.json"

_BOUNDS = "bounds.csv"
_MAP_SIZE = 96


class LearnFiles:
    """Writes a session into its folder, most of it at the end."""

    def __init__(self, folder: RunFolder, config: LearnConfig, setup: LearnSetup):
        self._folder = folder
        self._config = config
        self._setup = setup
        self._earlier = _read_earlier(folder.path / ROUNDS, setup.first)
        self._rounds: list[LearningRound] = []
        self._errors: list[float | None] = []

    @property
    def known_p_values(self) -> tuple[float, ...]:
        """How well demonstrations were foretold, as far as that is known already."""
        cells = [row.get("foretold", "") for row in self._earlier]
        is_known = bool(
            cells and cells[-1]
        )  # Up to the first that is learned from now.
        return tuple(float(cell) for cell in cells if cell) if is_known else ()

    def add(self, latest: LearningRound) -> None:
        """Take a round in, and draw it if it is one of the last two or all are asked."""
        self._rounds.append(latest)
        self._errors.append(self._foretold_error(latest))
        if self._config.curve or latest.num_demos >= len(self._setup.demos) - 1:
            self._draw(latest)

    def finish(self) -> None:
        """Write what was learned; the summary, which says of how many, comes last."""
        folder, last = self._folder, self._rounds[-1]
        problem, posterior = self._setup.problem, last.learning.posterior
        rows = [self._row(index) for index in range(len(self._rounds))]
        before = [
            row
            for row in self._earlier
            if list(row) == list(rows[0]) and int(row["num_demos"]) < self._setup.first
        ]
        folder.write_rows([*before, *rows])
        folder.write("posterior.npz", lambda path: save_posterior(path, posterior))
        weights = posterior.guessed_weights
        widths = problem.config.widths
        folder.write_json(
            "weights.json", weights_to_json(weights, problem.task, widths)
        )
        folder.write_rows(list(self._bounds()), _BOUNDS)
        table = read_rows(folder.path / ROUNDS)
        figure = plot_learning(table, self._title)
        folder.write("figures/learning.png", figure.savefig)
        summary = self._summary(numbers(table, "prediction_error"))
        self._record(summary)
        asked = layout_to_json(last.learning.query, problem.task.objects)
        folder.write_json(NEXT_LAYOUT, {"format": LAYOUTS_FORMAT, "layouts": [asked]})
        folder.write_json(CERTIFICATE, certificate_to_json(last))
        folder.write_json(SUMMARY, summary)

    def _record(self, summary: Mapping[str, object]) -> None:
        # The simulator takes seconds to import, while nothing else here needs it.
        from tablesetting.experiments.learn_recording import record_session

        self._folder.write(
            RECORDING,
            lambda path: record_session(
                path, self._setup, self._config, self._rounds, summary
            ),
        )

    @property
    def _title(self) -> str:
        return f"place {self._setup.problem.task.item}"

    def _shown(self, latest: LearningRound) -> tuple[Array, Array | None]:
        """Return the layout that comes next, and what was demonstrated there."""
        layout, shown = self._setup.following(latest.num_demos)
        return (latest.learning.query if layout is None else layout), shown

    def _guess(self, latest: LearningRound, layout: Array) -> Array:
        weights = latest.learning.posterior.guessed_weights
        return self._setup.problem.best_placements(weights[None], layout[None])[0, 0]

    def _foretold_error(self, latest: LearningRound) -> float | None:
        """Return how far the guess is from the next demonstration; None at the end."""
        layout, shown = self._shown(latest)
        if shown is None:
            return None
        return float(np.linalg.norm(self._guess(latest, layout) - shown))

    def _row(self, index: int) -> dict[str, object]:
        latest = self._rounds[index]
        row = {
            "num_demos": latest.num_demos,
            "prediction_error": self._errors[index],
            **posterior_cells(latest),
            "deployment_bound": latest.bound.value,
            "foretold": latest.fit.foretold[-1] if latest.fit.foretold else None,
            "fit": latest.fit.p_value,
            **seconds_cells(latest.learning),
        }
        return rounded(row)

    def _bounds(self) -> Iterator[dict[str, object]]:
        """Yield a row for each layout that the robot will meet."""
        last, problem = self._rounds[-1], self._setup.problem
        posterior, risk = last.learning.posterior, problem.config.risk
        losses = problem.policy_losses(list(self._setup.deployment), posterior)
        var = value_at_risk(losses, risk.alpha)
        ess = max(posterior.kept_ess, 1.0)
        bounds = var_upper_bound(losses, risk.alpha, last.bound.delta, ess=ess)
        for index, layout in enumerate(self._setup.deployment):
            places = layout_to_json(layout, problem.task.objects)
            robot = self._guess(last, layout)
            row = {
                "layout": index,
                **{
                    f"{name}_{axis}": value
                    for name, place in (*places.items(), ("robot", robot.tolist()))
                    for axis, value in zip("xy", place, strict=True)
                },
                "var": float(var[index]),
                "bound": float(bounds[index]),
            }
            yield rounded(row)

    def _summary(self, errors: Sequence[float]) -> dict[str, Any]:
        last, errors = self._rounds[-1], [e for e in errors if not math.isnan(e)]
        learning = [each.learning for each in self._rounds]
        return {
            "task": self._setup.problem.task.name,
            "strategy": self._config.strategy,
            "preset": self._config.preset,
            "seed": self._config.seed,
            "num_demos": last.num_demos,
            "mean_prediction_error": float(np.mean(errors)) if errors else None,
            "var_bound": last.learning.var_bound,
            "deployment_bound": finite_or_none(last.bound.value),
            "epsilon": self._setup.epsilon,
            "certified": not last.doubts,
            "doubts": last.doubts,
            "seconds": {
                "inference": round(sum(each.inference_seconds for each in learning), 3),
                "queries": round(sum(each.query_seconds for each in learning), 3),
            },
        }

    def _draw(self, latest: LearningRound) -> None:
        problem = self._setup.problem
        layout, shown = self._shown(latest)
        marked = {"robot's wish": self._guess(latest, layout)}
        if shown is not None:
            marked["demonstrated next"] = shown
        after = f"after {latest.num_demos} demonstration{'s' * (latest.num_demos > 1)}"
        figure = plot_query(
            problem.reward_map(
                latest.learning.posterior.guessed_weights, layout, _MAP_SIZE
            ),
            problem.space.outlines(layout),
            marked,
            f"{after}: ask here next" if shown is None else f"{self._title}: {after}",
        )
        name = f"figures/query_{latest.num_demos:02d}.png"
        self._folder.write(name, figure.savefig)


def _read_earlier(path: Path, first: int) -> list[Row]:
    """Read the rows of up to so many demonstrations.

    Raises:
        InvalidFile: If the table is damaged.
    """
    rows = read_table(path) if path.exists() else []
    try:
        rows = [row for row in rows if int(row["num_demos"]) <= first]
        for column in rows[0] if rows else ():
            numbers(rows, column)
    except (KeyError, ValueError) as error:
        raise InvalidFile(
            f"'{path}' is damaged ({error}); remove it, to go on without earlier figures"
        ) from error
    return sorted(rows, key=lambda row: int(row["num_demos"]))
