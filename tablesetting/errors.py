"""Every error that a program may want to catch."""


class TableSettingError(Exception):
    """Base of all errors of this package; its message names the remedy."""


class InvalidLayout(TableSettingError):
    """Objects stand off the table, overlap, or leave the item no room."""


class InvalidFile(TableSettingError):
    """A file is unreadable, of another format, or holds a bad value."""


class OutputError(TableSettingError):
    """A run folder exists already or cannot be written."""


class WorkerDied(TableSettingError):
    """A process was killed or crashed at every try of the same piece of work."""


def is_interruption(error: BaseException | None) -> bool:
    """Tell whether Ctrl-C is behind an error: compiled code turns it into others."""
    if error is None or isinstance(error, KeyboardInterrupt):
        return error is not None
    return is_interruption(error.__cause__ or error.__context__)
