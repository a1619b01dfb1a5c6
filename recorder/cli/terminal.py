"""The terminal: progress, the end of a command on request, log files, results as JSON.

How far long work is: a bar on a terminal, elsewhere a line every ten seconds.

The end of a command on request: Ctrl-C, SIGTERM and a closed terminal are one and the same.

A log file beside what a command shows.

Results as JSON that every parser takes: no NaN, no objects of our own.

Streams that are closed, or take no letters but those of a small alphabet.
"""

import json
import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from io import TextIOWrapper
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TextIO

import numpy as np


def make_streams_safe() -> None:
    """Give closed streams a place, and let "?" stand for characters that a stream does not take.

    The next file that is opened would else get the number of a closed stream, and all that is printed. Output
    of a closed stdout fails, so that its loss is reported; that of a closed stderr is dropped.
    """
    for number, mode in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")


class InterruptHandler:
    """A signal handler that raises KeyboardInterrupt and remembers that it did.

    Python drops an exception that rises in a finaliser or in a callback from C. Long work therefore
    asks from time to time (`raise_again`) whether it has to end.
    """

    def __init__(self) -> None:
        self.was_called = False

    def __call__(self, number: int, frame: FrameType | None) -> NoReturn:
        """Take a signal.

        Raises:
            KeyboardInterrupt: always.
        """
        self.was_called = True
        raise KeyboardInterrupt


@contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """Let SIGTERM and a closed terminal end a command as Ctrl-C does, so that it cleans up."""
    handler = InterruptHandler()
    before: dict[int, Any] = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        # Under nohup a closed terminal is ignored, and stays so.
        wanted = (signal.SIG_DFL, signal.default_int_handler)
        if number is not None and signal.getsignal(number) in wanted and _in_main_thread():
            before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)


def raise_again() -> None:
    """Raise an interrupt that came and was dropped on its way.

    Raises:
        KeyboardInterrupt: a signal has asked the command to end.
    """
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, InterruptHandler) and handler.was_called and _in_main_thread():
        raise KeyboardInterrupt


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


def announced(cost: object) -> None:
    """Write size and time of long work before it begins."""
    print(cost, file=sys.stderr, flush=True)


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


@contextmanager
def logged_to(path: Path, name: str) -> Iterator[None]:
    """Append a logger's messages, from INFO on, to a file.

    Args:
        path: The file.
        name: Name of the logger.
    """
    logger = logging.getLogger(name)
    file = logging.FileHandler(path, encoding="utf-8")
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    file.setLevel(logging.INFO)
    logger.addHandler(file)
    try:
        yield
    finally:
        logger.removeHandler(file)
        file.close()


def to_json(result: Mapping[str, Any]) -> str:
    """JSON text of a result; numbers that are not finite become null."""
    return json.dumps(_plain(result), indent=2, allow_nan=False, ensure_ascii=True)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int, str)) else str(value)
