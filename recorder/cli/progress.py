"""Progress of long work: a bar on a terminal, elsewhere a line every ten seconds."""

import sys
import threading
import time
from contextlib import AbstractContextManager
from typing import TextIO

from recorder.cli.interrupts import raise_again

REDRAW_S, LINE_S = 0.2, 10.0
"""Time between two looks of the bar on a terminal, and between two lines elsewhere [s]."""
_BAR = "{desc}: {percentage:3.0f}%|{bar}| "
_OPEN = "{n:.0f} {unit}, {rate_noinv:.3g} {unit}/s{postfix}"
_LEFT = "{n:.0f} of {total:.0f} {unit}, {rate_noinv:.3g} {unit}/s, {remaining} left{postfix}"


class Progress(AbstractContextManager["Progress"]):
    """Shows how much is done, the rate and the time left, both by what this run has done so far.

    As a context manager it leaves a terminal's line empty at the end.

    Args:
        what: The work in hand.
        unit: Unit of the count; seconds are those of a drive.
        stream: Where to; stderr when left out.
    """

    def __init__(self, what: str, *, unit: str = "s", stream: TextIO | None = None) -> None:
        # Imported by long work only: it takes a while.
        from tqdm import tqdm

        tqdm.monitor_interval = 0
        tqdm.set_lock(threading.RLock())
        self._stream = stream or sys.stderr
        self._what, self._is_terminal = what, self._stream.isatty()
        self._first: float | None = None
        self._is_under_way = False
        self._bar = tqdm(
            desc=what,
            unit=unit,
            file=self._stream if self._is_terminal else _Lines(self._stream),
            dynamic_ncols=self._is_terminal,
            mininterval=REDRAW_S if self._is_terminal else LINE_S,
            miniters=0,
            delay=1e-9,  # nothing is drawn before the first update
            smoothing=0,
            leave=False,
        )

    def __exit__(self, *_: object) -> None:
        self._bar.last_print_t = time.time()
        self._bar.close()

    def update(self, done: float, total: float | None = None, note: str = "") -> None:
        """Take note of the progress, and show it when it is time.

        Args:
            done: How much is done, what an earlier run did included.
            total: How much it is in all; None: not known.
            note: A text to show, too.

        Raises:
            KeyboardInterrupt: the command was asked to end.
        """
        raise_again()
        bar = self._bar
        if self._first is None:
            self._first = bar.n = done
        if not self._is_under_way:
            # What is built and compiled before the first progress is no part of the rate.
            bar.initial, bar.start_t = done, time.time() - 1e-3
            self._is_under_way = done != self._first
        bar.total = None if total is None else max(total, done)
        shown = _OPEN if not bar.total else _LEFT
        bar.bar_format = (_BAR if bar.total and self._is_terminal else "{desc}: ") + shown
        bar.set_postfix_str(note, refresh=False)
        bar.update(done - bar.n)

    def pieces(self, done: float, total: int, ended: str | None) -> None:
        """Take note of pieces of work, and write of one that has ended in a line of its own.

        Args:
            done: Pieces done, parts of those under way included.
            total: Pieces in all.
            ended: Text about the one that has ended; None: none has.

        Raises:
            KeyboardInterrupt: the command was asked to end.
        """
        raise_again()
        if ended is None or self._is_terminal:
            self.update(done, total)
        if ended is not None:
            self._bar.write(f"{self._what}: {done:.0f} of {total}, {ended}", file=self._stream)


class _Lines:
    """Gives a stream what a bar draws over itself as lines one below the other."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> None:
        if line := text.strip("\r "):
            self._stream.write(f"{line}\n")

    def flush(self) -> None:
        self._stream.flush()
