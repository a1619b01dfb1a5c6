"""The same command resumes an unfinished demo in its folder; another demo takes the next number."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from recorder.cli.commands.demo import UNFINISHED, _folder


def interrupted(out: Path, error: BaseException, files: Sequence[str] = ()) -> Path:
    """Folder of a demo that an error ends after it has written some files."""
    with suppress(type(error)), _folder(out, "20 s") as folder:
        for name in files:
            (folder / name).touch()
        raise error
    return folder


def test_an_interrupted_demo_is_taken_up_again(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    first = interrupted(out, KeyboardInterrupt(), files=("look.jpg",))
    with _folder(out, "5 s") as other:
        assert other == tmp_path / "demo-2"
        (other / "look.jpg").touch()
    with _folder(out, "20 s") as again:
        assert again == first == out
        with _folder(out, "20 s") as beside:
            assert beside == tmp_path / "demo-3", "one run at a time works in a folder"
    assert not list(tmp_path.rglob(UNFINISHED))
    with _folder(out, "20 s") as finished:
        assert finished not in (first, other), "a finished demo is kept"


def test_a_demo_that_made_nothing_leaves_nothing(tmp_path: Path) -> None:
    interrupted(tmp_path / "demo", OSError("full"))
    assert not list(tmp_path.iterdir())
