"""The story of a recording, told without a viewer."""

from collections.abc import Collection
from itertools import pairwise
from pathlib import Path

from tablesetting.errors import InvalidFile
from tablesetting.recording import entities
from tablesetting.recording.card import FIGURES_TITLE
from tablesetting.recording.reading import Recording, Row

_TEXT = "TextDocument:text"
_STATE = "StateChange:state"
_INTERRUPTED = "The run was interrupted: it ends here."


def tell(recording: Path, num_demos: int | None = None) -> str:
    """Tell what happened in a run.

    Args:
        recording: File that :class:`~tablesetting.recording.recorder.RunRecorder` wrote.
        num_demos: Tell the round after so many demonstrations alone; all if None.

    Returns:
        Markdown: the run card, then each round with its query, errors, outcome and
        how long each phase of the arm took.

    Raises:
        InvalidFile: If the file is missing, damaged, or records something else or no
            such round.
    """
    source = Recording(recording)
    cards = source.rows(entities.RUN_CARD, _TEXT)
    if not cards:
        raise InvalidFile(f"{recording} does not record a run of this package")
    phases = _durations(source.rows(entities.PHASE, _STATE))
    rounds = {
        count: f"{row.value}\n\nPhases: {', '.join(phases[count])}"
        if count in phases
        else str(row.value)
        for count, row in _last_texts(source).items()
    }
    if num_demos is not None:
        _check_round(recording, rounds, num_demos)
        return rounds[num_demos]
    sections = [cards[-1].value, *rounds.values()]
    if not source.is_complete or FIGURES_TITLE not in cards[-1].value:
        sections.append(_INTERRUPTED)
    return "\n\n".join(sections)


def end_of_round(recording: Path, num_demos: int) -> float:
    """Find when a round was over, on the clock of the run, in [s].

    Raises:
        InvalidFile: If the file cannot be read, or records no such round.
    """
    rounds = _last_texts(Recording(recording))
    _check_round(recording, rounds, num_demos)
    return rounds[num_demos].sim_time


def _check_round(recording: Path, rounds: Collection[int], num_demos: int) -> None:
    if num_demos not in rounds:
        known = ", ".join(map(str, sorted(rounds))) or "none"
        raise InvalidFile(
            f"'{recording}' has no round after {num_demos} demonstrations; it has those "
            f"after {known}"
        )


def _last_texts(source: Recording) -> dict[int, Row]:
    """Take the last word on each round, by its number of demonstrations."""
    return {row.num_demos: row for row in source.rows(entities.ROUND_TEXT, _TEXT)}


def _durations(changes: list[Row]) -> dict[int, list[str]]:
    """Say how long each phase lasted, by number of demonstrations."""
    phases: dict[int, list[str]] = {}
    for change, following in pairwise(changes):
        if change.value is not None:
            lasted = following.sim_time - change.sim_time
            words = phases.setdefault(change.num_demos, [])
            words.append(f"{change.value} {lasted:.2f} s")
    return phases
