"""How far long work is: on a terminal one line that is written over, elsewhere a line every ten seconds."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable
from typing import TextIO

from recorder.cli.interrupts import raise_again

REDRAW_S, LINE_S = 0.2, 10.0
"""Time between two looks of the line on a terminal, and between two lines elsewhere [s]."""
WINDOW_S = 30.0
"""Time over which the rate is taken [s]: what is compiled at the beginning says nothing about the rest."""


class Progress:
    """Tells seconds of the drive, the rate as a multiple of real time, and the time left.

    As a context manager it leaves a terminal's line empty at the end.

    Args:
        what: What is being done.
        stream: Where to; stderr when left out.
        clock: Tells the time [s].
    """

    def __init__(
        self, what: str, *, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._what, self._clock = what, clock
        self._stream = stream or sys.stderr
        self._is_terminal = self._stream.isatty()
        self._shown_s = clock() - (REDRAW_S if self._is_terminal else 0.0)
        self._history: deque[tuple[float, float]] = deque()
        self._width = 0

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self._width:
            self._write("\r" + " " * self._width + "\r")

    def update(self, done_s: float, total_s: float | None = None, note: str = "") -> None:
        """Take note of the progress, and show it when it is time.

        Args:
            done_s: Seconds of the drive that are done [s].
            total_s: Seconds in all [s]; None: nobody knows.
            note: What else is told.

        Raises:
            KeyboardInterrupt: the command was asked to end.
        """
        raise_again()
        now_s = self._clock()
        self._history.append((now_s, done_s))
        while now_s - self._history[0][0] > WINDOW_S:
            self._history.popleft()
        if now_s - self._shown_s < (REDRAW_S if self._is_terminal else LINE_S):
            return
        self._shown_s = now_s
        line = self._line(done_s, total_s, note)
        if self._is_terminal:
            self._write(f"\r{line:<{self._width}}")
            self._width = len(line)
        else:
            self._write(f"{line}\n")

    def note(self, done: int, total: int, told: str) -> None:
        """Tell of one of several pieces of work that has ended, in a line of its own.

        Args:
            done: Pieces done.
            total: Pieces in all.
            told: What is told of this one.

        Raises:
            KeyboardInterrupt: the command was asked to end.
        """
        raise_again()
        self._write(f"{self._what}: {done} of {total}, {told}\n")

    def _line(self, done_s: float, total_s: float | None, note: str) -> str:
        parts = [f"{self._what}: {done_s:.1f} s" if total_s is None else
                 f"{self._what}: {done_s:.1f} of {total_s:.1f} s"]  # fmt: skip
        (since_s, before_s), (now_s, _) = self._history[0], self._history[-1]
        rate = (done_s - before_s) / (now_s - since_s) if now_s > since_s else 0.0
        if rate > 0.0:
            parts.append(f"{rate:.2f}x real time")
            if total_s is not None:
                parts.append(f"{_clock_text((total_s - done_s) / rate)} left")
        return ", ".join([*parts, note] if note else parts)

    def _write(self, text: str) -> None:
        self._stream.write(text)
        self._stream.flush()


def _clock_text(seconds: float) -> str:
    """A time as h:mm:ss, without hours where there are none."""
    minutes, rest = divmod(round(max(seconds, 0.0)), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
