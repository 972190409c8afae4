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
