"""Progress of a dataset on a terminal: a bar for the whole, and one for the stage in hand."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, TextIO

from recorder.cli.interrupts import raise_again

if TYPE_CHECKING:
    from recorder.factory.time_left import DatasetProgress

REDRAW_S = 0.2
"""Time between two looks of the bars [s]."""
_BAR = 24


class DatasetBars:
    """Draws two lines over themselves; where nobody watches, nothing.

    As a context manager it leaves a terminal as it was.

    Args:
        stream: Where to; stderr when left out.
        clock: Tells the time [s].
    """

    def __init__(self, *, stream: TextIO | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream or sys.stderr
        self._clock = clock
        self._shown_s = float("-inf")
        self._is_drawn = False

    def __enter__(self) -> DatasetBars:
        return self

    def __exit__(self, *_: object) -> None:
        if self._is_drawn:
            self._stream.write("\r\x1b[A\x1b[J")
            self._stream.flush()

    def update(self, progress: DatasetProgress) -> None:
        """Take note of the progress, and show it when it is time.

        Raises:
            KeyboardInterrupt: the command was asked to end.
        """
        raise_again()
        now_s = self._clock()
        if not self._stream.isatty() or now_s - self._shown_s < REDRAW_S:
            return
        self._shown_s = now_s
        width = shutil.get_terminal_size().columns - 1
        lines = [line[:width] for line in (whole_line(progress), stage_line(progress))]
        back = "\r\x1b[A" if self._is_drawn else ""
        self._stream.write(back + f"{lines[0]}\x1b[K\n{lines[1]}\x1b[K")
        self._stream.flush()
        self._is_drawn = True


def whole_line(progress: DatasetProgress) -> str:
    """The bar of the whole."""
    from recorder.factory.quantities import duration_text

    return f"{'all':<8}{_bar(progress.share)} {progress.share:4.0%}  {duration_text(progress.left_s)} left"


def stage_line(progress: DatasetProgress) -> str:
    """The bar of the town in hand: what is being done, its rate, size and time left."""
    from recorder.factory.quantities import duration_text, size_text

    share = min(progress.done_s / progress.total_s, 1.0)
    parts = [
        f"{progress.activity} {progress.number} of {progress.towns}",
        f"{progress.done_s:.0f} of {progress.total_s:.0f} s",
    ]
    if progress.rate is not None:
        parts.append(f"{progress.rate:.2f} s/s")
    parts += [size_text(progress.size), f"{duration_text(progress.stage_left_s)} left"]
    return f"{progress.town:<8}{_bar(share)} {share:4.0%}  {', '.join(parts)}"


def _bar(share: float) -> str:
    full = round(_BAR * min(max(share, 0.0), 1.0))
    return f"[{'#' * full}{'-' * (_BAR - full)}]"
