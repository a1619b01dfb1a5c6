"""Kept arrays are believed only where they are the user's own."""

import logging
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.files.array_cache import cached, default_cache_dir
from recorder.cli.main import main


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


def test_the_cache_follows_xdg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`$CARLALOC_CACHE` first, then an absolute `$XDG_CACHE_HOME`, then the home folder."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path / "mine"))
    assert default_cache_dir() == tmp_path / "mine"
    monkeypatch.delenv("CARLALOC_CACHE")
    assert default_cache_dir() == tmp_path / "xdg" / "carlaloc"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert default_cache_dir() == tmp_path / "home" / ".cache" / "carlaloc"


def test_the_cache_keeps_to_its_bound_and_is_cleared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was used longest ago goes, never what was made just now, and no file of another's."""
    cache = tmp_path / "cache"
    cache.mkdir()
    old, new = (cache / f"Town0{k}-{k * 32}.town" for k in "12")
    foreign = [cache / "photo-cafe.jpg", cache / "notes.txt"]
    for age, path in enumerate([new, old, *foreign]):
        path.write_bytes(b"x" * 400_000)
        os.utime(path, (1e9 - age, 1e9 - age))
    monkeypatch.setenv("CARLALOC_CACHE_GB", "0.0005")
    fetch(cache, 1.0)
    assert sorted(cache.glob("Town*")) == [new]
    assert len(list(cache.glob("number-*.test"))) == 1
    monkeypatch.setenv("CARLALOC_CACHE", str(cache))
    assert main(["doctor", "--clear-cache"]) == 0
    assert "deleted 0.00 GB in" in capsys.readouterr().out
    assert not [*cache.glob("*.town"), *cache.glob("number-*")]
    assert all(path.exists() for path in foreign)


def test_files_of_earlier_versions_are_dropped(tmp_path: Path) -> None:
    for number in range(5):
        (tmp_path / f"number-{number:032x}.test").write_bytes(b"")
    fetch(tmp_path, 1.0)
    assert len(list(tmp_path.glob("*.test"))) == 2
    assert fetch(tmp_path, 2.0) == 1.0


def test_a_cache_that_cannot_be_written_is_done_without(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    with caplog.at_level(logging.WARNING):
        assert [fetch(tmp_path / "file" / "cache", value) for value in (1.0, 2.0)] == [1.0, 2.0]
    assert "cannot be cached" in caplog.text
