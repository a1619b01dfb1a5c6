"""Text of the window: three sizes of pygame's own font, at the full resolution of the window."""

from functools import lru_cache
from typing import Any

DARK, WHITE, AMBER, BLUE = (18, 22, 26), (245, 245, 245), (250, 180, 40), (80, 165, 255)
"""Colours behind text, of text, of warnings and of what is chosen, sRGB."""
_SIZES = {"small": 1.15, "medium": 1.7, "big": 3.2}
_FINER = 4
"""Letters are drawn so much larger and then made smaller: on whole pixels their gaps would differ."""
_KEPT_TEXTS = 128


class Lettering:
    """Writes on surfaces.

    Args:
        pygame: The module, initialised.
        height_px: Height of the window, after which the fonts are sized [px].
    """

    def __init__(self, pygame: Any, height_px: int) -> None:
        self._pygame = pygame
        pygame.font.init()
        self.unit = max(12, round(height_px / 30))
        """Size on which all others depend [px]."""
        self._fonts = {
            name: pygame.font.Font(None, _FINER * round(self.unit * k)) for name, k in _SIZES.items()
        }
        self._text = lru_cache(_KEPT_TEXTS)(self._drawn)

    def write(
        self,
        surface: Any,
        text: str,
        size: str,
        position: tuple[float, float],
        colour: tuple[int, int, int],
        anchor: str = "bottomleft",
        *,
        shadow: bool = False,
    ) -> None:
        """Write a line.

        Args:
            surface: Where.
            text: What.
            size: ``small``, ``medium`` or ``big``.
            position: Pixel at which the anchor lies.
            colour: Its colour, sRGB.
            anchor: Point of the text's box, e.g. ``midleft``.
            shadow: Whether a dark box lies behind it.
        """
        drawn = self._text(text, size, colour)
        box = drawn.get_rect(**{anchor: (round(position[0]), round(position[1]))})
        if shadow:
            back = self._pygame.Surface((box.width + 8, box.height + 4), self._pygame.SRCALPHA)
            back.fill((*DARK, 150))
            surface.blit(back, (box.left - 4, box.top - 2))
        surface.blit(drawn, box)

    def _drawn(self, text: str, size: str, colour: tuple[int, int, int]) -> Any:
        large = self._fonts[size].render(text, True, colour)
        width, height = large.get_size()
        small = -(-width // _FINER), -(-height // _FINER)
        return self._pygame.transform.smoothscale(large, small)
