"""The run card: what was run with which settings, and what came of it."""

from collections.abc import Mapping, Sequence
from typing import Any

import rerun as rr

from tablesetting.recording.entities import RUN_CARD
from tablesetting.recording.views import RunCard

FIGURES_TITLE = "## Final figures"
"""Heads what only a finished run has."""

_LEGEND = (
    "On the table lies the reward of the best guess, yellow where it is high. "
    "Magenta marks where the person wants the item, white where the robot thinks so, "
    "blue dots where samples of the posterior put it, among them the rival, whose distance "
    "from the guess is the value at risk."
)
_LEGEND_OF_ARM = (
    "Orange marks the commanded placement, red the place where the item settled."
)


def log_card(stream: rr.RecordingStream, card: RunCard) -> None:
    """Log the card as a text, and as properties that programs can query."""
    versions: dict[str, Any] = {
        f"version_{name}": version for name, version in card.versions.items()
    }
    properties = rr.AnyValues(
        task=card.task, strategy=card.strategy, seed=card.seed, **versions
    )
    stream.send_property("run", properties)
    log_summary(stream, card, {}, [])


def log_summary(
    stream: rr.RecordingStream,
    card: RunCard,
    summary: Mapping[str, object],
    rounds: Sequence[Mapping[str, float | None]],
) -> None:
    """Log the card anew, with the final figures and a row for each round."""
    document = rr.TextDocument(
        card_markdown(card, summary, rounds), media_type=rr.MediaType.MARKDOWN
    )
    stream.log(RUN_CARD, document, static=True)


def card_markdown(
    card: RunCard,
    summary: Mapping[str, object],
    rounds: Sequence[Mapping[str, float | None]] = (),
) -> str:
    """Write the run card: settings, versions and, at the end, the final figures."""
    settings = {
        "strategy": card.strategy,
        "seed": card.seed,
        "item": card.item,
        "objects": ", ".join(card.objects),
    }
    legend = f"{_LEGEND} {_LEGEND_OF_ARM}" if card.acts else _LEGEND
    sections = [f"# Task {card.task}", _table("setting", settings), legend]
    if summary:
        sections += [FIGURES_TITLE, _table("figure", summary)]
    if rounds:
        sections += ["## Errors", _table_of_rounds(rounds)]
    sections += ["## Versions", _table("package", card.versions)]
    return "\n\n".join(sections)


def _table(header: str, rows: Mapping[str, object]) -> str:
    lines = [f"| {header} | |", "|---|---|"]
    cells = _flatten(rows)
    return "\n".join(lines + [f"| {key} | {_cell(v)} |" for key, v in cells.items()])


def _table_of_rounds(rounds: Sequence[Mapping[str, float | None]]) -> str:
    """Write a row for each round; columns that no round fills are left out."""
    columns = [name for name in rounds[0] if any(r[name] is not None for r in rounds)]
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for each in rounds:
        cells = ("" if each[name] is None else _cell(each[name]) for name in columns)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _flatten(rows: Mapping[str, object]) -> dict[str, object]:
    """Give the figures of a group a row each."""
    flat: dict[str, object] = {}
    for key, value in rows.items():
        if isinstance(value, Mapping):
            flat |= {f"{key}: {name}": inner for name, inner in value.items()}
        else:
            flat[key] = value
    return flat


def _cell(value: object) -> str:
    if isinstance(value, list):
        return "; ".join(map(str, value)) or "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
