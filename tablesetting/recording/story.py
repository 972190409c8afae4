"""The story of a recording, told without a viewer."""

from itertools import pairwise
from pathlib import Path

from tablesetting.errors import InvalidFile
from tablesetting.recording import entities
from tablesetting.recording.card import FIGURES_TITLE
from tablesetting.recording.reading import Recording, Row

_TEXT = "TextDocument:text"
_STATE = "StateChange:state"
_INTERRUPTED = "The run was interrupted: it ends here."


def tell(recording: Path) -> str:
    """Tell what happened in a run.

    Args:
        recording: File that :class:`~tablesetting.recording.recorder.RunRecorder` wrote.

    Returns:
        Markdown: the run card, then each round with its query, errors, outcome and
        how long each phase of the arm took.

    Raises:
        InvalidFile: If the file is missing, damaged, or records something else.
    """
    source = Recording(recording)
    cards = source.rows(entities.RUN_CARD, _TEXT)
    if not cards:
        raise InvalidFile(f"{recording} does not record a run of this package")
    sections = [cards[-1].value]
    phases = _durations(source.rows(entities.PHASE, _STATE))
    for num_demos, text in _last_texts(source).items():
        sections.append(text)
        if num_demos in phases:
            sections.append(f"Phases: {', '.join(phases[num_demos])}")
    if not source.is_complete or FIGURES_TITLE not in cards[-1].value:
        sections.append(_INTERRUPTED)
    return "\n\n".join(sections)


def _last_texts(source: Recording) -> dict[int, str]:
    """Take the last word on each round, by its number of demonstrations."""
    rows = source.rows(entities.ROUND_TEXT, _TEXT)
    return {row.num_demos: row.value for row in rows}


def _durations(changes: list[Row]) -> dict[int, list[str]]:
    """Say how long each phase lasted, by number of demonstrations."""
    phases: dict[int, list[str]] = {}
    for change, following in pairwise(changes):
        if change.value is not None:
            lasted = following.sim_time - change.sim_time
            words = phases.setdefault(change.num_demos, [])
            words.append(f"{change.value} {lasted:.2f} s")
    return phases
