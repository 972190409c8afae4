"""What is known of driving at some moment."""

from dataclasses import dataclass
from typing import Any

from gridworld_bench.driving import Record, Riskiest
from gridworld_bench.highway import ACTIONS


@dataclass(frozen=True)
class View:
    """What is known after some steps and answers.

    Attributes:
        num_steps: Driven steps that are known.
        num_queries: Answers that are.
        riskiest: The riskiest of the sampled states.
        record: What happens to the robot's policy on the road.
        asked: The state that is asked about next, if one is.
        answer: What the driver does there.
    """

    num_steps: int
    num_queries: int
    riskiest: Riskiest
    record: Record
    asked: int | None = None
    answer: int | None = None

    @property
    def row(self) -> dict[str, Any]:
        """The same as a row of rounds.csv."""
        return {
            "num_steps": self.num_steps,
            "num_queries": self.num_queries,
            "var": round(float(self.riskiest.var[0]), 9),
            "collisions": self.record.collisions,
            "off_road": self.record.off_road,
            "query": self.asked,
            "answer": None if self.answer is None else ACTIONS[self.answer],
        }
