"""A window that shows pictures as they come, for `render_mode` human."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import RenderError


class HumanWindow:
    """One window; shows at most its rate of pictures a second, as people watch."""

    def __init__(self, size_px: tuple[int, int], rate_hz: float) -> None:
        """Open it.

        Args:
            size_px: Width and height.
            rate_hz: Pictures a second.

        Raises:
            RenderError: there is no display.
        """
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pygame: Any = pygame
        self._rate_hz = rate_hz
        pygame.display.init()
        if pygame.display.get_driver() in ("offscreen", "dummy") and "SDL_VIDEODRIVER" not in os.environ:
            pygame.display.quit()
            raise RenderError("render_mode 'human' needs a display; set DISPLAY, or use 'rgb_array'")
        self._screen = pygame.display.set_mode(size_px)
        pygame.display.set_caption("CarlaLoc")
        self._clock = pygame.time.Clock()

    def show(self, rgb: NDArray[np.uint8]) -> None:
        """Show a picture, sRGB, shape (H, W, 3)."""
        pygame = self._pygame
        pygame.event.pump()
        self._screen.blit(pygame.surfarray.make_surface(rgb.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._rate_hz)

    def close(self) -> None:
        """Close it."""
        self._pygame.display.quit()
