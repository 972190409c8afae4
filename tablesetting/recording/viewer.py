"""Rerun's own viewer, in a window or in a browser; it listens on this machine alone."""

import os
import sys
from pathlib import Path
from typing import NoReturn

import rerun_cli

from tablesetting.errors import TableSettingError

# The console script would leave its child behind: start the binary itself.
VIEWER = Path(rerun_cli.__file__).with_name("rerun")
LOCAL_ONLY = ("--bind", "127.0.0.1")
"""By default the viewer would listen to the whole network."""


class NoViewer(TableSettingError):
    """Rerun's viewer does not start."""


def view(recording: Path, *, in_browser: bool) -> NoReturn:
    """Become the viewer of a recording; nothing of this process remains.

    Args:
        recording: File to show.
        in_browser: Whether to serve a page rather than open a window.

    Raises:
        NoViewer: If there is no display for a window.
    """
    has_display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform == "linux" and not in_browser and not has_display:
        raise NoViewer(
            "no display to open a window on; use --web, --text or --screenshot"
        )
    page = ("--web-viewer",) if in_browser else ()
    command = [str(VIEWER), *LOCAL_ONLY, *page, str(recording)]
    os.execv(VIEWER, command)
