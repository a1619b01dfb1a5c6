"""Size of the live images: as large as the machine can draw in time, at most every pixel of the window."""

SIZES_PX = tuple((16 * k, 9 * k) for k in (60, 54, 48, 44, 40, 36, 33, 30, 27, 25))
"""Width and height of live images before they are scaled to the window, largest first [px].

Smaller ones would be too coarse to read, and drawn hardly sooner.
"""
FIRST_PX = (480, 270)
"""Size of the first images."""
BUDGET_S = 0.044
"""Time for one image; twenty a second leave 6 ms for what the drive itself needs [s]."""
_SETTLE = 8
"""Images between two changes: the first ones of a size are slower."""
_MOST_PATIENCE = 256
"""Most images before the size grows again; each time it had to shrink they double, against flicker."""
_SMOOTHING = 0.25


class LiveResolution:
    """Chooses among `SIZES_PX` by the time that images took.

    Args:
        budget_s: Time that an image may take [s].
    """

    def __init__(self, budget_s: float = BUDGET_S) -> None:
        self._budget_s = budget_s
        self._index = SIZES_PX.index(FIRST_PX)
        self._drawn = 0
        self._patience = _SETTLE
        self._smooth_s = 0.0

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the next image [px]."""
        return SIZES_PX[self._index]

    def took(self, seconds: float) -> None:
        """Take note of how long the last image took [s]."""
        self._drawn += 1
        if self._drawn <= _SETTLE // 2:
            self._smooth_s = seconds
            return
        self._smooth_s += _SMOOTHING * (seconds - self._smooth_s)
        if self._drawn < _SETTLE:
            return
        if self._smooth_s > self._budget_s and self.size_px != SIZES_PX[-1]:
            self._patience = min(2 * self._patience, _MOST_PATIENCE)
            self._choose(self._largest(self._budget_s))
        elif self._drawn >= self._patience:
            self._choose(min(self._index, self._largest(0.9 * self._budget_s)))

    def _largest(self, budget_s: float) -> int:
        """The largest size that is in time when an image takes as long as it has pixels.

        A part of that time is fixed: a larger one takes less than that, a smaller one may take more.
        """
        w, h = self.size_px
        per_pixel_s = self._smooth_s / (w * h)
        in_time = (k for k, (w, h) in enumerate(SIZES_PX) if per_pixel_s * w * h <= budget_s)
        return next(in_time, len(SIZES_PX) - 1)

    def _choose(self, index: int) -> None:
        if index != self._index:
            self._index, self._drawn = index, 0
