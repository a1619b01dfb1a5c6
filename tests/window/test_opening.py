"""From the command to the first image: refused at once where nobody would see, else shown from the start."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from carlaloc_env.core.errors import DeviceError, MapError
from recorder.window.opening import Opening

pygame = pytest.importorskip("pygame")

HEAVY = ("numba", "pybullet", "scipy", "shapely", "moderngl", "open3d", "carlaloc_env.traffic")


@pytest.fixture
def opening(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Opening:
    """An opening on SDL's dummy display, with an empty cache."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("CARLALOC_CACHE", str(tmp_path))
    return Opening("Town03")


@pytest.mark.parametrize("device", ["keyboard", "wheel", "gamepad"])
@pytest.mark.parametrize("options", [(), ("--no-window",)])
def test_nobody_drives_unseen(device: str, options: tuple[str, ...], tmp_path: Path) -> None:
    """One line, before anything is built; SDL alone would draw the drive where nobody looks."""
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    command = [sys.executable, "-X", "importtime", "-m", "recorder.cli.main", "record", "--device", device]
    command += ["--out", str(tmp_path / "drive.mcap"), *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    lines = done.stderr.splitlines()
    said = [line for line in lines if not line.startswith("import time:")]
    assert (done.returncode, done.stdout, len(said)) == (1, "", 1), said
    assert ("--no-window" if options else "no display") in said[0]
    loaded = {line.rpartition("|")[2].strip() for line in lines if line.startswith("import time:")}
    assert not loaded.intersection(HEAVY)
    assert not list(tmp_path.iterdir())


def test_the_window_opens_before_the_rest_is_loaded() -> None:
    """All that it needs is loaded in a fraction of a second."""
    code = f"import sys, recorder.window.start_screen; print(*set({HEAVY!r}) & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_it_shows_what_is_done_and_the_time_left(opening: Opening, tmp_path: Path) -> None:
    """The second time it knows how long the first one took; other towns' times are kept."""
    with opening:
        assert opening.run("building Town03", lambda: 7) == 7
        assert "the first time" in opening.text("building Town03")
        with pytest.raises(MapError, match="no such"):
            opening.run("building Town03", _fail)
        opening.finish()
    (tmp_path / "opening_times.json").write_text('{"Town03": 12.4, "my_town": 3.0}')
    with Opening("Town03") as again:
        assert again.text("building Town03") == "building Town03, 12 s left"
        again.finish()
    assert '"my_town": 3.0' in (tmp_path / "opening_times.json").read_text()
    (tmp_path / "opening_times.json").write_text("[half a fi")
    with Opening("Town03") as damaged:
        assert "the first time" in damaged.text("starting")


def _fail() -> None:
    raise MapError("no such town")


def test_bar_and_text_are_on_the_screen_while_work_is_done(opening: Opening, tmp_path: Path) -> None:
    def picture() -> np.ndarray:
        opening.window.save(tmp_path / "look.png")
        return np.asarray(pygame.surfarray.array3d(pygame.image.load(str(tmp_path / "look.png"))))

    def work() -> np.ndarray:
        while not (picture() == (80, 165, 255)).all(axis=2).any():
            time.sleep(0.1)
        return picture()

    with opening:
        middle = np.array_split(opening.run("building Town03", work), 3, axis=1)[1]
    assert (middle.max(axis=2) > 200).sum() > 300


@pytest.mark.parametrize("event", ["QUIT", "KEYDOWN"])
def test_closing_it_ends_the_command(opening: Opening, event: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The work is not cut off; then one line says that there is no drive."""
    done, ending = [], threading.Event()
    monkeypatch.setattr(opening, "show", lambda what: ending.set() if what == "ending" else None)

    def work() -> None:
        pygame.event.post(pygame.event.Event(getattr(pygame, event), key=pygame.K_ESCAPE))
        done.append(ending.wait(600.0))

    with opening, pytest.raises(DeviceError, match="closed before the drive began"):
        opening.run("building Town03", work)
    assert done == [True]


@pytest.mark.parametrize("usual_s", [None, 12.0])
def test_the_bar_never_stands_and_the_text_never_promises_time_that_is_up(
    usual_s: float | None, opening: Opening
) -> None:
    shares = []
    with opening:
        opening._last_s = usual_s
        for passed_s in (0.0, 1.0, 11.0, 12.0, 13.0, 60.0, 119.0, 120.0, 121.0, 150.0, 600.0):
            opening._began_s = time.monotonic() - passed_s
            shares.append(opening.share())
            text = opening.text("building")
            assert ("so far" in text) == (usual_s is None or passed_s >= usual_s)
    assert np.all(np.diff(shares) > 0.0)
    assert 0.0 <= shares[0] < shares[-1] < 1.0
