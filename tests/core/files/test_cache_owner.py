"""Kept arrays are believed only where they are the user's own."""

from __future__ import annotations

import logging
import os
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


@pytest.mark.parametrize("what", ["folder", "file"])
def test_what_everybody_can_write_is_not_believed(
    what: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "cache"
    fetch(folder, 1.0)
    (file,) = folder.glob("*.test")
    (folder if what == "folder" else file).chmod(0o777)
    with caplog.at_level(logging.WARNING):
        assert fetch(folder, 2.0) == 2.0
    assert "is writable by all users" in caplog.text
    assert len(caplog.records) == 1


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="giving files away needs root")
@pytest.mark.parametrize("what", ["folder", "file"])
def test_what_belongs_to_others_is_not_believed(
    what: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "cache"
    fetch(folder, 1.0)
    (file,) = folder.glob("*.test")
    os.chown(folder if what == "folder" else file, 12345, 12345)
    with caplog.at_level(logging.WARNING):
        assert fetch(folder, 2.0) == 2.0
    assert "belongs to another user" in caplog.text
