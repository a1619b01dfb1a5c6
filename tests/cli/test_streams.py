"""Streams as shells, daemons and terminals give them: closed, full, and of any encoding."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs a shell and /dev/full")


def carlaloc(words: str, *options: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A command as a shell runs it, redirections included."""
    start = shlex.join([sys.executable, *options, "-m", "recorder.cli.main"])
    return subprocess.run(
        f"{start} {words}", shell=True, capture_output=True, check=False, env=os.environ | environment,
        encoding=environment.get("PYTHONIOENCODING", "utf-8"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("stream", "reason"), [(">&-", "Bad file descriptor"), (">/dev/full", "No space left on device")]
)
@pytest.mark.parametrize("words", ["list weathers", "--help", "list weathers --json"])
def test_output_that_cannot_be_written_is_one_line(words: str, stream: str, reason: str) -> None:
    done = carlaloc(f"{words} {stream}")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == f"carlaloc: cannot write to stdout: {reason}\n"


def test_all_streams_may_be_closed() -> None:
    assert carlaloc("list weathers <&- >&- 2>&-").returncode == 1
    assert carlaloc("list weathers <&- 2>&-").stdout == carlaloc("list weathers").stdout


def test_a_file_does_not_take_the_place_of_a_closed_stream(straight_map: Path, tmp_path: Path) -> None:
    """The first file that is opened would get the number of stdout, and all that libraries print."""
    check = f"maps check {straight_map} --waypoints 2 --csv"
    assert carlaloc(f"{check} {tmp_path / 'whole.csv'}").returncode == 0
    assert carlaloc(f"{check} {tmp_path / 'closed.csv'} >&-").returncode == 1
    assert (tmp_path / "closed.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


@pytest.mark.parametrize("encoding", ["latin-1", "ascii", "cp437"])
@pytest.mark.long
def test_characters_that_a_terminal_lacks_are_replaced(encoding: str, straight_map: Path) -> None:
    whole = carlaloc(f"maps check {straight_map}")
    done = carlaloc(f"maps check {straight_map}", PYTHONIOENCODING=encoding)
    assert done.returncode == whole.returncode == 0
    assert done.stdout == whole.stdout.encode(encoding, "replace").decode(encoding)
    assert "\u2026" not in done.stdout
    helped = carlaloc("sweep --help", PYTHONIOENCODING=encoding)
    assert (helped.returncode, helped.stderr) == (0, "")


def test_commands_run_without_docstrings() -> None:
    assert "weathers" in carlaloc("list --help", "-OO").stdout
    assert carlaloc("list weathers", "-OO").stdout == carlaloc("list weathers").stdout
