"""Size of the live images: as large as the machine can draw in time."""

from __future__ import annotations

SIZES_PX = ((480, 270), (400, 225), (320, 180), (256, 144))
"""Width and height of live images before they are scaled to the window, largest first [px]."""
BUDGET_S = 0.044
"""Time for one image; twenty a second leave 6 ms for what the drive itself needs [s]."""
_SETTLE = 8
"""Images between two changes: the first ones of a size are slower."""
_SMOOTHING = 0.25


class LiveResolution:
    """Chooses among `SIZES_PX` by the time that images took.

    Args:
        budget_s: Time that an image may take [s].
    """

    def __init__(self, budget_s: float = BUDGET_S) -> None:
        self._budget_s = budget_s
        self._index = 0
        self._drawn = 0
        self._smooth_s = 0.0

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the next image [px]."""
        return SIZES_PX[self._index]

    def took(self, seconds: float) -> None:
        """Tell how long the last image took [s]."""
        self._drawn += 1
        if self._drawn <= _SETTLE // 2:
            self._smooth_s = seconds
            return
        self._smooth_s += _SMOOTHING * (seconds - self._smooth_s)
        if self._drawn < _SETTLE:
            return
        if self._smooth_s > self._budget_s and self._index < len(SIZES_PX) - 1:
            self._choose(self._index + 1)
        elif self._index > 0 and self._smooth_s * self._growth() < 0.9 * self._budget_s:
            self._choose(self._index - 1)

    def _growth(self) -> float:
        """Pixels of the next larger size over those of this one: no image grows slower than that."""
        (w, h), (larger_w, larger_h) = SIZES_PX[self._index], SIZES_PX[self._index - 1]
        return (larger_w * larger_h) / (w * h)

    def _choose(self, index: int) -> None:
        self._index, self._drawn = index, 0
