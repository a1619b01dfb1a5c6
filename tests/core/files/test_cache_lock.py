"""Processes that want the same kept thing at once: one makes it, the others wait."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.files.array_cache import cached

SPAWN = multiprocessing.get_context("spawn")


def fetch(folder: Path, made_s: float = 0.0) -> float:
    """A kept number, which takes a while to make; each making leaves a line in a file."""

    def make() -> float:
        with (folder.parent / "made").open("a") as file:
            file.write(f"{os.getpid()}\n")
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


def makers(folder: Path) -> list[str]:
    """Process numbers of those that made the number."""
    file = folder.parent / "made"
    return file.read_text().split() if file.exists() else []


def test_processes_that_start_together_make_it_once(tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    with SPAWN.Pool(4) as pool:
        assert pool.starmap(fetch, [(folder, 1.0)] * 4, chunksize=1) == [4.0] * 4
    assert len(makers(folder)) == 1
    assert [path.suffix for path in folder.iterdir()] == [".test"]


def test_who_is_killed_while_making_holds_nobody_up(tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    process = SPAWN.Process(target=fetch, args=(folder, 600.0))
    process.start()
    while not makers(folder):
        time.sleep(0.01)
    os.kill(process.pid or 0, signal.SIGKILL)
    process.join()
    assert fetch(folder) == 4.0
    assert len(makers(folder)) == 2
    assert [path.suffix for path in folder.iterdir()] == [".test"]


def test_a_folder_without_locks_is_used_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("carlaloc_env.core.files.file_lock.fcntl", None)
    with caplog.at_level(logging.WARNING):
        assert fetch(tmp_path / "cache") == fetch(tmp_path / "cache") == 4.0
    assert not caplog.records
    assert len(makers(tmp_path / "cache")) == 1
