"""A window on the road, with a person at the keyboard; needs `tablesetting[drive]`."""

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np

from gridworld_bench.highway import ACTIONS, Situation
from gridworld_bench.road_picture import draw_road
from tablesetting.errors import TableSettingError

_UNSEEN = ("dummy", "offscreen")  # What SDL may take where there is no display.
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
_LARGEST = 2.0  # Pixels of the window for each of the picture, where there is room.
_BAR = 84  # Pixels for words below the road.
_AROUND = 100  # Pixels of a display that bars and frames take.
_BACKGROUND = (20, 20, 22)
_WAIT = 20  # Milliseconds between two looks at the keyboard.


class NoWindow(TableSettingError):
    """No window can be opened."""


class WindowClosed(Exception):
    """The person closed the window, or ended by a key."""


class Window:
    """Shows situations, and reads keys.

    Attributes:
        length: How many steps ahead the road is seen.
    """

    def __init__(self, pygame: ModuleType, length: int, keys: tuple[str, ...]):
        self._pygame: Any = pygame
        self.length = length
        self._keys = keys
        height, width, _ = draw_road(Situation(2, ()), length).shape
        room = pygame.display.get_desktop_sizes()[0][1] - _AROUND - _BAR
        scale = min(_LARGEST, max(room, 1) / height)
        self._road_size = (round(scale * width), round(scale * height))
        size = (max(self._road_size[0], 380), self._road_size[1] + _BAR)
        self._screen = self._pygame.display.set_mode(size)
        self._pygame.display.set_caption("gridworld-bench")
        self._font = self._pygame.font.Font(None, 20)
        self._clock = self._pygame.time.Clock()

    @property
    def is_closed(self) -> bool:
        """Whether the person has closed the window."""
        return bool(self._pygame.event.peek(self._pygame.QUIT))

    def show(
        self, situation: Situation, num_steps: int, words: tuple[str, ...] = ()
    ) -> None:
        """Draw a situation, with lines of words below."""
        image = draw_road(situation, self.length, num_steps)
        surface = self._pygame.surfarray.make_surface(np.swapaxes(image, 0, 1))
        surface = self._pygame.transform.smoothscale(surface, self._road_size)
        self._screen.fill(_BACKGROUND)
        left = (self._screen.get_width() - surface.get_width()) // 2
        self._screen.blit(surface, (left, 0))
        self._write((*words, *self._keys))

    def say(self, words: str) -> None:
        """Show words, and no road, while nothing is asked."""
        self._screen.fill(_BACKGROUND)
        self._write((words,))

    def wait_for_frame(self, per_second: float) -> None:
        """Wait, so that no more than some pictures are shown per second."""
        self._clock.tick(per_second)

    def forget_keys(self) -> None:
        """Drop the keys that were pressed so far, before what they would answer is seen."""
        self._pygame.event.clear(self._pygame.KEYDOWN)

    def _write(self, lines: tuple[str, ...]) -> None:
        for row, line in enumerate(lines):
            text = self._font.render(line, True, (225, 225, 225))
            self._screen.blit(text, (8, self._road_size[1] + 6 + 19 * row))
        self._pygame.display.flip()
        self._pygame.event.pump()

    def wait_for_key(self, seconds: float | None = None) -> str | None:
        """Return what the person wants: an action, or undo, pause, save or end.

        Args:
            seconds: How long to wait; forever if None. All of it is waited, and the last
                action that was asked for in the meantime counts; another command ends
                the wait, and comes after that action.

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
            # One by one: what follows a key waits for the next call.
            while (event := pygame.event.poll()).type != pygame.NOEVENT:
                if event.type == pygame.QUIT:
                    return "end"
                command = (
                    commands.get(event.key) if event.type == pygame.KEYDOWN else None
                )
                if command in ACTIONS and seconds is not None:
                    chosen = command
                elif command is not None:
                    if chosen is not None:
                        pygame.event.post(event)  # For the next call.
                        return chosen
                    return command
            pygame.time.wait(_WAIT)
        return chosen


@contextmanager
def open_window(length: int, keys: tuple[str, ...], *, remedy: str) -> Iterator[Window]:
    """Open a window on a road, as high as the display has room for.

    Args:
        length: How many steps ahead the road is seen.
        keys: What the keys do, in lines of words.
        remedy: What works without a window.

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
            "a window needs pygame; install it by `pip install 'tablesetting[drive]'`, or "
            f"{remedy}"
        ) from error
    try:
        if sys.platform == "linux" and not any(map(os.environ.get, _DISPLAYS)):
            # SDL would find out by itself, but print lines of its own.
            raise pygame.error("there is no display")
        pygame.display.init()
        if (
            pygame.display.get_driver() in _UNSEEN
            and "SDL_VIDEODRIVER" not in os.environ
        ):
            raise pygame.error("there is no display")
        pygame.font.init()
        window = Window(pygame, length, keys)
    except pygame.error as error:
        pygame.quit()
        raise NoWindow(
            f"no window can be opened: {error}; set DISPLAY, or {remedy}"
        ) from error
    try:
        yield window
    finally:
        pygame.quit()
