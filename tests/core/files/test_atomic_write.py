"""Files and folders that are whole under their name, or not there."""

from contextlib import suppress
from itertools import repeat
from pathlib import Path

import pytest
from shared_fixtures.processes.small_disks import small_disk

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.files.atomic_files import atomic_write, part_path


def _broken_off(path: Path, fault: BaseException) -> None:
    with atomic_write(path, MapError, "free some") as part:
        part.mkdir()
        (part / "half").write_text("half")
        raise fault


def test_what_is_under_a_name_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "made" / "a.txt"
    for text in ("first", "second"):
        part_path(path).parent.mkdir(exist_ok=True)
        part_path(path).write_text("what a killed process left")
        with atomic_write(path) as part:
            assert not part.exists()
            part.write_text(text)
            assert path.exists() == (text == "second")
        assert path.read_text() == text
    with pytest.raises(KeyboardInterrupt):
        _broken_off(path, KeyboardInterrupt())
    with pytest.raises(MapError, match=r"^cannot write .*a\.txt: No space left; free some$"):
        _broken_off(path, OSError(28, "No space left"))
    assert [(file.name, file.read_text()) for file in path.parent.iterdir()] == [("a.txt", "second")]


def _cut(path: Path) -> None:
    writing = atomic_write(path, MapError, "free some")
    with writing as part, suppress(OSError), part.open("wb", buffering=0) as file:
        file.writelines(repeat(bytes(4096)))


def test_a_file_that_a_library_cut_without_a_word_does_not_take_its_name(tmp_path: Path) -> None:
    """The disk is full, and the writer reports success."""
    with small_disk(tmp_path / "disk", 64 << 10) as disk:
        with pytest.raises(MapError, match=r"^cannot write .*a\.txt: No space left on device; free some$"):
            _cut(disk / "a.txt")
        assert not list(disk.iterdir())


def test_folders_take_their_name_too(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "folder") as part:
        (part / "below").mkdir(parents=True)
    assert [found.name for found in tmp_path.rglob("*")] == ["folder", "below"]
