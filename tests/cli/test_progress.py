"""Progress as people and log files see it."""

import fcntl
import io
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from recorder.cli import progress as progress_module
from recorder.cli.progress import Progress

LINE = r"replaying: (\d+) of 60 s, ([\d.]+) s/s, 00:(\d\d) left, fog"


class Clock:
    """Time that the test sets, read by the progress and by its bar."""

    now_s = 1e9

    def time(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(progress_module, "time", clock)
    monkeypatch.setattr("tqdm.std.time", clock.time)
    return clock


def work(stream: io.TextIOBase, clock: Clock, *, total_s: float | None, kept_s: float = 0.0) -> None:
    """Two seconds of work that builds for a while, and then makes ten seconds of a drive in each second."""
    with Progress("replaying", stream=stream) as progress:  # type: ignore[arg-type]
        for step in range(200):
            progress.update(kept_s + 10.0 * max(step / 100 - 0.8, 0.0), total_s, "fog")
            clock.now_s += 0.01


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:  # Linux's way to report the end.
        return b""


@pytest.mark.parametrize("kept_s", [0.0, 40.0])
def test_a_log_gets_lines_with_the_rate_of_this_run(
    kept_s: float, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither the time before the first progress nor what an earlier run did counts for the rate."""
    monkeypatch.setattr(progress_module, "LINE_S", 0.4)
    stream = io.StringIO()
    work(stream, clock, total_s=60.0, kept_s=kept_s)
    lines = stream.getvalue().splitlines()
    assert 3 <= len(lines) <= 5
    found = re.fullmatch(LINE, lines[-1])
    assert found is not None
    done_s, rate, left_s = (float(text) for text in found.groups())
    assert done_s > kept_s
    assert rate == pytest.approx(10.0, abs=1.0)
    assert left_s == pytest.approx((60.0 - done_s) / 10.0, abs=1.5)


def test_a_short_run_writes_no_line_and_one_without_an_end_no_time_left(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.StringIO()
    work(stream, clock, total_s=60.0)
    assert stream.getvalue() == ""
    monkeypatch.setattr(progress_module, "LINE_S", 0.4)
    work(stream, clock, total_s=None)
    assert re.fullmatch(r"replaying: \d+ s, [\d.]+ s/s, fog", stream.getvalue().splitlines()[-1])


def test_a_terminal_has_one_bar_that_goes(clock: Clock) -> None:
    """A real terminal, of 80 columns."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
    with os.fdopen(slave, "w") as stream:
        work(stream, clock, total_s=60.0)
    drawn = b"".join(iter(lambda: _read(master), b"")).decode()
    os.close(master)
    assert "\n" not in drawn
    looks = [look for look in drawn.split("\r") if look.strip()]
    assert 4 <= len(looks) <= 11
    assert max(len(look) for look in looks) <= 80
    assert re.match(r"replaying:  1\d%\|\S+ +\| \d+ of 60 s, [\d.]+ s/s, 00:0\d left, fog", looks[-1])
    assert re.search(r"\r {60,}\r$", drawn), "the line is empty in the end"


def test_a_log_file_tells_more_than_the_terminal(tmp_path: Path) -> None:
    """Logging as `main` sets it up, in a process of its own."""
    script = """
import logging, sys
from pathlib import Path
from recorder.cli.output import logged_to
from recorder.cli.main import main
main(["list", "traffic", "--json"])
log = logging.getLogger("recorder.factory")
with logged_to(Path(sys.argv[1]), "recorder"):
    log.info("driving")
    log.warning("going on")
log.warning("afterwards")
"""
    words = [sys.executable, "-c", script, str(tmp_path / "log")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [line.split(": ")[-1] for line in done.stderr.splitlines()] == ["going on", "afterwards"]
    lines = (tmp_path / "log").read_text().splitlines()
    assert [line.split(" ", 2)[2] for line in lines] == ["INFO driving", "WARNING going on"]
