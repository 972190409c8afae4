"""What is learned of driving, written as soon as it is known."""

from dataclasses import replace

from gridworld_bench.drives import Drive, describe, save_drive
from gridworld_bench.experiments.driving_figure import draw_riskiest
from gridworld_bench.experiments.driving_recording import record_driving
from gridworld_bench.experiments.driving_view import View
from tablesetting.results import RECORDING, SUMMARY, RunFolder

DEMOS = "demos.json"
FIGURE = "figures/riskiest.png"
RISKIEST = "riskiest.json"
_RISKIEST_FORMAT = "gridworld-riskiest/1"


class DrivingLog:
    """The views so far, and the folder that has them.

    Attributes:
        driven: The steps that are learned from.
        answers_by: Who answers.
        views: What was known after some steps and answers.
    """

    def __init__(self, folder: RunFolder, driven: Drive, answers_by: str):
        self._folder = folder
        self.driven = driven
        self.answers_by = answers_by
        self.views = list[View]()

    @property
    def num_answers(self) -> int:
        """How many questions were answered."""
        return sum(view.answer is not None for view in self.views)

    def add(self, view: View) -> None:
        """Add what is known now."""
        self.views.append(view)
        self._write()

    def add_answer(self, action: int) -> None:
        """Answer the question of the last view."""
        self.views[-1] = replace(self.views[-1], answer=action)
        self._write()

    def finish(self) -> None:
        """Draw, record and sum up what there is."""
        if not self.views:
            return
        highway, views = self.driven.highway, self.views
        self._folder.write(FIGURE, draw_riskiest(highway, views).savefig)
        self._folder.write(
            RECORDING, lambda path: record_driving(path, self.driven, views)
        )
        summary = {"driver": self.driven.driver, "answers_by": self.answers_by}
        self._folder.write_json(SUMMARY, summary | {"last": views[-1].row})

    def paths(self) -> list[str]:
        """Say where everything is."""
        names = {"figure": FIGURE, "recording": RECORDING, "demonstrations": DEMOS}
        return [f"{what}: {self._folder.path / name}" for what, name in names.items()]

    def _write(self) -> None:
        self._folder.write_rows([each.row for each in self.views])
        self._folder.write_json(
            RISKIEST,
            {
                "format": _RISKIEST_FORMAT,
                "length": self.driven.highway.length,
                "rounds": [self._describe(view) for view in self.views],
            },
        )
        save_drive(self._folder.path / DEMOS, self._answered())

    def _describe(self, view: View) -> dict[str, object]:
        situations = self.driven.highway.situations
        return {
            "num_steps": view.num_steps,
            "num_queries": view.num_queries,
            "riskiest": [
                describe(situations[state]) | {"var": var}
                for state, var in zip(
                    view.riskiest.states.tolist(),
                    view.riskiest.var.tolist(),
                    strict=True,
                )
            ],
        }

    def _answered(self) -> Drive:
        """Return the steps, and each answer as one more."""
        states, actions = list(self.driven.states), list(self.driven.actions)
        for view in self.views:
            if view.asked is not None and view.answer is not None:
                states.append(view.asked)
                actions.append(view.answer)
        driver = self.driven.driver
        if driver != self.answers_by and self.num_answers:
            driver = f"{driver}, then {self.answers_by}"
        return Drive(self.driven.highway, tuple(states), tuple(actions), driver)
