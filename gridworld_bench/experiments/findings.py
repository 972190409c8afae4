"""What each study writes once it is complete."""

from collections.abc import Callable, Mapping, Sequence

from gridworld_bench.experiments.barrier import count_demonstrations
from gridworld_bench.experiments.driving_study import tell_driving
from gridworld_bench.experiments.example import tell_queries
from gridworld_bench.experiments.results import FIGURE, compare
from gridworld_bench.experiments.stopping import tell_stops
from gridworld_bench.experiments.study import Study
from gridworld_bench.experiments.timing import tell_seconds
from tablesetting.results import ROUNDS, Row, read_rows

TABLE = "comparison.md"

FINDINGS: Mapping[str, Callable[[Study, Sequence[Row]], list[str]]] = {
    "action-queries": compare,
    "critique-queries": compare,
    "sparse-barrier": count_demonstrations,
    "example": tell_queries,
    "normalised-stop": tell_stops,
    "timing": tell_seconds,
    "driving-study": tell_driving,
}
"""Writes summary and figure of a study, and returns its table, line by line."""


def finish(study: Study) -> list[str]:
    """Write what a complete study found; return it in words, line by line."""
    folder = study.folder
    folder.write_rows(study.ordered_rows)
    lines = FINDINGS[study.config.name](study, read_rows(folder.path / ROUNDS))
    text = "\n".join(lines) + "\n"
    folder.write(TABLE, lambda path: path.write_text(text, encoding="utf-8"))
    places = (("table", TABLE), ("figure", FIGURE))
    return [*lines, "", *(f"{kind}: {folder.path / name}" for kind, name in places)]
