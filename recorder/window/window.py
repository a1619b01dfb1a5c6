"""The window itself: opened once, shows one image with instruments after another."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import DeviceError, MissingDependencyError
from recorder.window.hud import Hud, HudState

WINDOW_PX = (960, 540)
"""Size of the window [px]."""


class Window:
    """A pygame window.

    Raises:
        MissingDependencyError: pygame is not installed.
        DeviceError: there is no display.
    """

    def __init__(self, title: str, size_px: tuple[int, int] = WINDOW_PX) -> None:
        # SDL would show images through an OpenGL context of its own, which breaks the renderer's.
        os.environ.setdefault("SDL_FRAMEBUFFER_ACCELERATION", "0")
        try:
            import pygame
        except ImportError as error:
            raise MissingDependencyError(f"the window needs pygame ({error}); pip install pygame") from error
        self._pygame = pygame
        self.size_px = size_px
        try:
            pygame.display.init()
            self._surface = pygame.display.set_mode(size_px)
        except pygame.error as error:
            raise DeviceError(f"no window can be opened ({error}); add --no-window") from error
        pygame.display.set_caption(title)
        self._hud = Hud(pygame, size_px)

    def show(
        self, image: NDArray[np.uint8], state: HudState, map_image: NDArray[np.uint8] | None = None
    ) -> None:
        """Show an image (H, W, 3), scaled to the window, with its instruments."""
        if image.shape[1::-1] != self.size_px:
            image = np.asarray(cv2.resize(image, self.size_px, interpolation=cv2.INTER_LINEAR), np.uint8)
        self._surface.blit(self._surface_of(image), (0, 0))
        small = None if map_image is None else self._surface_of(map_image)
        self._hud.draw(self._surface, state, small)
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
