"""Progress as people and log files see it."""

from __future__ import annotations

import io
import re

from recorder.cli.progress import Progress


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def work(stream: io.StringIO, *, total_s: float | None, rate: float, seconds: float) -> list[str]:
    """Work that makes `rate` seconds of a drive each second, told ten times a second; lines shown."""
    now_s = 100.0
    with Progress("replaying", stream=stream, clock=lambda: now_s) as progress:
        for k in range(round(10 * seconds) + 1):
            now_s = 100.0 + 0.1 * k
            progress.update(0.1 * k * rate, total_s)
    return [line for line in re.split(r"[\r\n]+", stream.getvalue()) if line.strip()]


def test_a_log_gets_a_line_every_ten_seconds() -> None:
    lines = work(io.StringIO(), total_s=30.0, rate=0.5, seconds=60.0)
    assert lines == [
        "replaying: 5.0 of 30.0 s, 0.50x real time, 0:50 left",
        "replaying: 10.0 of 30.0 s, 0.50x real time, 0:40 left",
        "replaying: 15.0 of 30.0 s, 0.50x real time, 0:30 left",
        "replaying: 20.0 of 30.0 s, 0.50x real time, 0:20 left",
        "replaying: 25.0 of 30.0 s, 0.50x real time, 0:10 left",
        "replaying: 30.0 of 30.0 s, 0.50x real time, 0:00 left",
    ]
    assert work(io.StringIO(), total_s=30.0, rate=0.5, seconds=9.0) == []


def test_a_terminal_has_one_line_that_goes() -> None:
    stream = Terminal()
    lines = work(stream, total_s=7200.0, rate=1.25, seconds=4.0)
    assert 15 <= len(lines) <= 25
    last = r"replaying: (4\.\d|5\.0) of 7200\.0 s, 1\.25x real time, 1:35:56 left"
    assert re.fullmatch(last, lines[-1].strip())
    assert "\n" not in stream.getvalue()
    assert stream.getvalue().endswith(" \r")
    longest = max(len(line) for line in lines)
    assert stream.getvalue().split("\r")[-2].count(" ") <= longest


def test_without_an_end_there_is_no_time_left() -> None:
    lines = work(io.StringIO(), total_s=None, rate=4.0, seconds=10.0)
    assert lines == ["replaying: 40.0 s, 4.00x real time"]
