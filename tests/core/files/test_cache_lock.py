"""Processes that want the same kept thing at once: one makes it, the others wait."""

import logging
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.files import array_cache
from carlaloc_env.core.files.array_cache import cached


def fetch(folder: Path, made_s: float) -> float:
    """A kept number, which takes a while to make; each making leaves a letter in a file."""

    def make() -> float:
        with (folder.parent / "made").open("a") as file:
            file.write("m")
        time.sleep(made_s)
        return 4.0

    return cached(
        "number",
        "test",
        module="carlaloc_env.core.clock",
        make=make,
        to_arrays=lambda made: {"value": np.array([made])},
        from_arrays=lambda arrays: float(arrays["value"][0]),
        kept_files=2,
        folder=folder,
    )


def started(folder: Path, made_s: float) -> subprocess.Popen[str]:
    """A process that fetches the number and prints it."""
    command = [sys.executable, __file__, str(folder), str(made_s)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def makings(folder: Path) -> int:
    """How often the number was made."""
    file = folder.parent / "made"
    return len(file.read_text()) if file.exists() else 0


def test_processes_that_start_together_make_it_once(tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    processes = [started(folder, 1.0) for _ in range(4)]
    assert [process.communicate(timeout=600)[0] for process in processes] == ["4.0\n"] * 4
    assert makings(folder) == 1
    assert {path.suffix for path in folder.iterdir()} == {".test", ".lock"}


def test_who_is_killed_while_making_holds_nobody_up(tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    with started(folder, 600.0) as process:
        while not makings(folder):
            assert process.poll() is None
            time.sleep(0.01)
        process.kill()
    assert fetch(folder, 0.0) == 4.0
    assert makings(folder) == 2
    assert {path.suffix for path in folder.iterdir()} == {".test", ".lock"}


def test_a_file_made_between_a_look_and_the_lock_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, read = tmp_path / "cache", array_cache._read

    def overtaken(*arguments: Any) -> Any:
        monkeypatch.undo()
        found = read(*arguments)
        assert fetch(folder, 0.0) == 4.0
        return found

    monkeypatch.setattr(array_cache, "_read", overtaken)
    assert fetch(folder, 0.0) == 4.0
    assert makings(folder) == 1


def test_a_folder_without_locks_is_used_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("carlaloc_env.core.files.file_locks.fcntl", None)
    with caplog.at_level(logging.WARNING):
        assert fetch(tmp_path / "cache", 0.0) == fetch(tmp_path / "cache", 0.0) == 4.0
    assert not caplog.records
    assert makings(tmp_path / "cache") == 1


if __name__ == "__main__":
    sys.stdout.write(f"{fetch(Path(sys.argv[1]), float(sys.argv[2]))}\n")
