"""Real time on a fixed tick: a slow machine slows the world down evenly and never skips a tick."""

import time
from collections import deque
from collections.abc import Callable

from carlaloc_env.core.clock import TICK_S

MOST_TICKS = 10
"""Most ticks between two images: beyond it the world runs slower than real time."""
_WINDOW_S = 2.0
SLOW = 0.9
"""World over real time below which a driver feels it and is warned."""


class Pacer:
    """Counts the ticks that are due, and measures how fast the world runs.

    Args:
        clock: Monotonic time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._last_s = clock()
        self._owed_s = 0.0
        self._history: deque[tuple[float, int]] = deque()

    def due(self) -> int:
        """Ticks to run now, 0 to `MOST_TICKS`; what a slow machine cannot do in time is let go."""
        now = self._clock()
        self._owed_s += now - self._last_s
        self._last_s = now
        count = min(int(self._owed_s / TICK_S + 1e-9), MOST_TICKS)
        left_s = self._owed_s - count * TICK_S
        self._owed_s = min(left_s, TICK_S) if count == MOST_TICKS else left_s
        self._history.append((now, count))
        while now - self._history[0][0] > _WINDOW_S:
            self._history.popleft()
        return count

    def restart(self) -> None:
        """Forget the time that went by, e.g. after a pause."""
        self._last_s, self._owed_s = self._clock(), 0.0
        self._history.clear()

    @property
    def speed(self) -> float:
        """Simulated over real time in the last two seconds; 1 in real time."""
        if len(self._history) < 2:
            return 1.0
        spent = self._history[-1][0] - self._history[0][0]
        done = sum(count for _, count in list(self._history)[1:])
        return done * TICK_S / spent if spent > 0.5 else 1.0

    @property
    def is_slow(self) -> bool:
        """Whether the world runs noticeably slower than real time."""
        return self.speed < SLOW
