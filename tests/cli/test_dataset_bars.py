"""The bars of `carlaloc dataset`, and its log."""

from __future__ import annotations

import io
import logging
import re
from pathlib import Path

import pytest

from recorder.cli.dataset_bars import DatasetBars
from recorder.cli.log_file import logged_to
from recorder.factory.time_left import DatasetProgress

PROGRESS = DatasetProgress(
    town="Town03",
    number=2,
    towns=7,
    activity="replaying",
    done_s=97.2512345,
    total_s=194.0,
    rate=0.2123456789,
    stage_left_s=455.7,
    size=3_123_456_789,
    share=0.2709,
    left_s=19_212.3,
)


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_two_bars_that_fit_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    stream = Terminal()
    with DatasetBars(stream=stream, clock=iter((0.0, 0.1, 0.5)).__next__) as bars:
        for _ in range(3):
            bars.update(PROGRESS)
    drawn = stream.getvalue()
    assert drawn.count("left") == 4, "two looks: 0.1 s after the first is too soon"
    lines = re.sub(r"\x1b\[\w|\r", "", drawn).splitlines()
    assert lines[0] == "all     [#######-----------------]  27%  5 h 20 min left"
    assert lines[1].startswith(
        "Town03  [############------------]  50%  replaying 2 of 7, 97 of 194 s, 0.21 s/s, 3.1 GB, 8 min left"
    )
    assert drawn.endswith("\r\x1b[A\x1b[J")
    monkeypatch.setenv("COLUMNS", "60")
    narrow = Terminal()
    with DatasetBars(stream=narrow) as bars:
        bars.update(PROGRESS)
    assert max(len(re.sub(r"\x1b\[\w|\r", "", line)) for line in narrow.getvalue().splitlines()) < 60


def test_nothing_where_nobody_watches() -> None:
    stream = io.StringIO()
    with DatasetBars(stream=stream) as bars:
        bars.update(PROGRESS)
    assert stream.getvalue() == ""


def test_a_log_file_tells_more_than_the_terminal(tmp_path: Path) -> None:
    shown = io.StringIO()
    root, handler = logging.getLogger(), logging.StreamHandler(shown)
    root.addHandler(handler)
    try:
        with logged_to(tmp_path / "log", "recorder"):
            logging.getLogger("recorder.factory").info("driving")
            logging.getLogger("recorder.factory").warning("going on")
        logging.getLogger("recorder.factory").info("afterwards")
    finally:
        root.removeHandler(handler)
    assert shown.getvalue() == "going on\n"
    lines = (tmp_path / "log").read_text().splitlines()
    assert [line.split(" ", 2)[2] for line in lines] == ["INFO driving", "WARNING going on"]
    assert handler.level == logging.NOTSET
