"""Text of the window."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from recorder.window.hud import WHITE, Lettering

pygame = pytest.importorskip("pygame")
LARGER = 16
SHARES = np.linspace(0.02, 0.98, 97)


def ink_px(surface: Any) -> NDArray[np.float64]:
    """Columns left of which given shares of the ink lie [px]."""
    ink = np.cumsum(pygame.surfarray.array_alpha(surface).astype(np.float64).sum(axis=1))
    return np.interp(SHARES, ink / ink[-1], np.arange(1, len(ink) + 1))


@pytest.mark.parametrize("text", ["steering", "view: seat, 20 pictures/s   faults: 0", "719 m to the light"])
def test_letters_stand_where_the_type_has_them(text: str) -> None:
    """Within half a pixel of letters drawn sixteen times as large, where rounding does not show."""
    lettering = Lettering(pygame, 540)
    font = pygame.font.Font(None, LARGER * round(1.15 * lettering.unit))
    large = font.render(text, True, WHITE)
    surface = pygame.Surface((large.get_width() // LARGER + 20, 40), pygame.SRCALPHA)
    lettering.write(surface, text, "small", (0, 0), WHITE, "topleft")
    away_px = ink_px(surface) - ink_px(large) / LARGER
    assert np.abs(away_px).mean() < 0.5
