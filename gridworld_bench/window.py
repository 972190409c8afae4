"""A window on the road, with a person at the keyboard; needs `tablesetting[drive]`."""

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from gridworld_bench.highway import ACTIONS, Situation
from gridworld_bench.road_picture import draw_road
from tablesetting.errors import TableSettingError

KEYS = (
    "arrows drive, up stays in the lane",
    "backspace undoes, p pauses, s saves, q ends",
)
_UNSEEN = ("dummy", "offscreen")  # What SDL may take where there is no display.
_SCALE = 2
_BAR = 84  # Pixels for words below the road.
_WAIT = 20  # Milliseconds between two looks at the keyboard.


class NoWindow(TableSettingError):
    """No window can be opened."""


class Window:
    """Shows situations, and reads keys.

    Attributes:
        length: How many steps ahead the road is seen.
    """

    def __init__(self, pygame: ModuleType, length: int):
        self._pygame: Any = pygame
        self.length = length
        height, width, _ = draw_road(Situation(2, ()), length).shape
        size = (max(_SCALE * width, 380), _SCALE * height + _BAR)
        self._screen = self._pygame.display.set_mode(size)
        self._pygame.display.set_caption("gridworld-bench drive")
        self._font = self._pygame.font.Font(None, 20)

    def show(
        self, situation: Situation, num_steps: int, words: tuple[str, ...] = ()
    ) -> None:
        """Draw a situation, with lines of words below."""
        image = draw_road(situation, self.length, num_steps)
        image = image.repeat(_SCALE, axis=0).repeat(_SCALE, axis=1)
        surface = self._pygame.surfarray.make_surface(np.swapaxes(image, 0, 1))
        self._screen.fill((20, 20, 22))
        left = (self._screen.get_width() - surface.get_width()) // 2
        self._screen.blit(surface, (left, 0))
        for row, line in enumerate((*words, *KEYS)):
            text = self._font.render(line, True, (225, 225, 225))
            self._screen.blit(text, (8, image.shape[0] + 6 + 19 * row))
        self._pygame.display.flip()
        self._pygame.event.pump()

    def wait_for_key(self, seconds: float | None = None) -> str | None:
        """Return what the person wants: an action, or undo, pause, save or end.

        Args:
            seconds: How long to wait; forever if None. All of it is waited, and the last
                action that was asked for in the meantime counts.

        Returns:
            The command; None if time is up without one. A window that is closed ends.
        """
        pygame = self._pygame
        commands = {
            pygame.K_LEFT: "left",
            pygame.K_RIGHT: "right",
            pygame.K_UP: "stay",
            pygame.K_BACKSPACE: "undo",
            pygame.K_p: "pause",
            pygame.K_s: "save",
            pygame.K_q: "end",
            pygame.K_ESCAPE: "end",
        }
        chosen = None
        started = pygame.time.get_ticks()
        while seconds is None or pygame.time.get_ticks() - started < 1000 * seconds:
            for event in pygame.event.get():
                if event.type == pygame.QUIT:
                    return "end"
                command = (
                    commands.get(event.key) if event.type == pygame.KEYDOWN else None
                )
                if command in ACTIONS and seconds is not None:
                    chosen = command
                elif command is not None:
                    return command
            pygame.time.wait(_WAIT)
        return chosen


@contextmanager
def open_window(length: int) -> Iterator[Window]:
    """Open a window on a road.

    Raises:
        NoWindow: If pygame is not installed, or there is no display.
    """
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # It loads a package that is going away.
            import pygame
    except ModuleNotFoundError as error:
        raise NoWindow(
            "a window needs pygame; install it by `pip install 'tablesetting[drive]'`, "
            "or let --driver safe drive"
        ) from error
    try:
        pygame.display.init()
        if (
            pygame.display.get_driver() in _UNSEEN
            and "SDL_VIDEODRIVER" not in os.environ
        ):
            raise pygame.error("there is no display")
        pygame.font.init()
        window = Window(pygame, length)
    except pygame.error as error:
        pygame.quit()
        raise NoWindow(
            f"no window can be opened: {error}; set DISPLAY, or let --driver safe drive"
        ) from error
    try:
        yield window
    finally:
        pygame.quit()
