"""Kept arrays are believed only where they are the user's own."""

import logging
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.files.array_cache import cached


def fetch(folder: Path, value: float) -> float:
    """The kept number, or `value` where it is made anew."""
    return cached(
        "number",
        "test",
        module="carlaloc_env.core.clock",
        make=lambda: value,
        to_arrays=lambda made: {"value": np.array([made])},
        from_arrays=lambda arrays: float(arrays["value"][0]),
        kept_files=2,
        folder=folder,
    )


def test_own_folder_is_believed(tmp_path: Path) -> None:
    assert fetch(tmp_path / "cache", 1.0) == 1.0
    assert fetch(tmp_path / "cache", 2.0) == 1.0


def open_to_all(path: Path) -> None:
    path.chmod(0o777)


def given_away(path: Path) -> None:
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("giving files away needs root")
    os.chown(path, 12345, 12345)


@pytest.mark.parametrize("what", ["folder", "file"])
@pytest.mark.parametrize(
    ("change", "why"),
    [(open_to_all, "is writable by all users"), (given_away, "belongs to another user")],
)
def test_what_others_can_write_or_own_is_not_believed(
    what: str, change: Callable[[Path], None], why: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "cache"
    fetch(folder, 1.0)
    (file,) = folder.glob("*.test")
    change(folder if what == "folder" else file)
    with caplog.at_level(logging.WARNING):
        assert fetch(folder, 2.0) == 2.0
    assert why in caplog.text
    assert len(caplog.records) == 1
