"""Files and folders that are whole under their name, or not there."""

from pathlib import Path

import pytest

from carlaloc_env.core.errors import MapError
from carlaloc_env.core.files.output_paths import atomic_write, part_path


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


def test_folders_take_their_name_too(tmp_path: Path) -> None:
    with atomic_write(tmp_path / "folder") as part:
        (part / "below").mkdir(parents=True)
    assert [found.name for found in tmp_path.rglob("*")] == ["folder", "below"]
