"""The window itself: opened once, shows one image with instruments after another."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import DeviceError
from recorder.devices.inputs import import_pygame
from recorder.window.hud import Hud, HudState
from recorder.window.lettering import (
    BLUE,
    DARK,
    WHITE,
    Lettering,
)

WINDOW_PX = (960, 540)
"""Size of the window [px]."""
UNSEEN = ("offscreen", "dummy")
"""SDL's drivers without a picture; it takes them where there is no display."""
_NO_DISPLAY = "no window can be opened, since there is no display; drive at a desktop, or --device scripted"
_EMPTY = (60, 66, 72)
"""Colour of a bar that has to be filled yet."""


class Window:
    """A pygame window.

    Raises:
        MissingDependencyError: pygame is not installed.
        DeviceError: there is no display.
    """

    def __init__(self, title: str, size_px: tuple[int, int] = WINDOW_PX) -> None:
        chosen = os.environ.get("SDL_VIDEODRIVER")
        displays = os.environ.get("DISPLAY"), os.environ.get("WAYLAND_DISPLAY")
        if chosen is None and sys.platform.startswith("linux") and not any(displays):
            # SDL would look for one, print errors of its own, and draw unseen.
            raise DeviceError(_NO_DISPLAY)
        self._pygame = pygame = import_pygame("the window needs")
        self.size_px = size_px
        try:
            pygame.display.init()
            if chosen is None and pygame.display.get_driver() in UNSEEN:
                pygame.display.quit()
                raise DeviceError(_NO_DISPLAY)
            self._surface = pygame.display.set_mode(size_px)
        except pygame.error as error:
            raise DeviceError(f"{_NO_DISPLAY} ({error})") from error
        pygame.display.set_caption(title)
        self.lettering = Lettering(pygame, size_px[1])
        """Writes in the window."""
        self._hud = Hud(pygame, size_px, self.lettering)

    def show_progress(self, text: str, done: float) -> None:
        """Show a line of text over a bar.

        Args:
            text: What is being done.
            done: How much of it is done, 0–1.
        """
        pygame, (width, height) = self._pygame, self.size_px
        self._surface.fill(DARK)
        self.lettering.write(self._surface, text, "medium", (width / 2, height / 2), WHITE, "center")
        bar = pygame.Rect(width // 4, height // 2 + height // 12, width // 2, max(height // 60, 2))
        pygame.draw.rect(self._surface, _EMPTY, bar)
        pygame.draw.rect(self._surface, BLUE, (*bar.topleft, round(done * bar.width), bar.height))
        pygame.display.flip()

    def closed(self) -> bool:
        """Whether the window was closed or Escape pressed; call it before anything else reads events."""
        pygame = self._pygame
        pygame.event.pump()
        events = pygame.event.get((pygame.QUIT, pygame.KEYDOWN, pygame.KEYUP, pygame.MOUSEMOTION))
        return any(
            event.type == pygame.QUIT or (event.type == pygame.KEYDOWN and event.key == pygame.K_ESCAPE)
            for event in events
        )

    def show(
        self, image: NDArray[np.uint8], state: HudState, map_image: NDArray[np.uint8] | None = None
    ) -> None:
        """Show an image (H, W, 3), scaled to the window, with its instruments."""
        if image.shape[1::-1] != self.size_px:
            image = np.asarray(cv2.resize(image, self.size_px, interpolation=cv2.INTER_CUBIC), np.uint8)
        self._surface.blit(self._surface_of(image), (0, 0))
        small = None if map_image is None else self._surface_of(map_image)
        self._hud.draw(self._surface, state, small)
        self._pygame.display.flip()

    def paint(self, painter: Callable[[Any, Any], None]) -> None:
        """Show what a function draws, which gets pygame and the window's surface."""
        painter(self._pygame, self._surface)
        self._pygame.display.flip()

    def save(self, path: Path) -> None:
        """Write what is shown to a PNG."""
        self._pygame.image.save(self._surface, str(path))

    def close(self) -> None:
        """Close the window; may be called twice."""
        self._pygame.display.quit()

    def _surface_of(self, image: NDArray[np.uint8]) -> Any:
        height, width = image.shape[:2]
        data = np.ascontiguousarray(image)
        return self._pygame.image.frombuffer(data.data, (width, height), "RGB")
