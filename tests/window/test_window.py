"""The window as a person uses it: a display of its own, keys from outside, pictures looked at."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder.episode.episode import Episode, open_episode

NEEDED = ("Xvfb", "xdotool", "import")
ROOT = Path(__file__).parents[2]


@pytest.fixture
def display() -> Iterator[str]:
    """A virtual display."""
    missing = [tool for tool in NEEDED if shutil.which(tool) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} missing: apt-get install xvfb xdotool imagemagick")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1100x700x24"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as answer:
        number = answer.readline().strip()
    yield f":{number}"
    server.terminate()
    server.wait()


def keys(display: str, *words: str) -> None:
    """Send something with xdotool."""
    subprocess.run(["xdotool", *words], check=True, env={**os.environ, "DISPLAY": display})


def screenshot(display: str, path: Path) -> np.ndarray:
    """What the display shows, (H, W, 3)."""
    command = ["import", "-window", "root", str(path)]
    subprocess.run(command, check=True, env={**os.environ, "DISPLAY": display})
    picture = cv2.imread(str(path))
    assert picture is not None
    return np.asarray(picture)


def wait_for(done: Callable[[], bool]) -> None:
    """Wait until a function says so, within the limit of the test."""
    while not done():
        time.sleep(0.1)


def test_keyboard_drive_on_a_display(display: str, tmp_path: Path) -> None:
    out = tmp_path / "drive.mcap"
    part = out.with_name(out.name + ".recording")
    command = [sys.executable, "-m", "recorder.cli.main", "record", "--device", "keyboard", "--out", str(out)]
    environment = {**os.environ, "DISPLAY": display}
    environment.pop("SDL_VIDEODRIVER", None)
    child = subprocess.Popen([*command, "--traffic", "0.1"], cwd=ROOT, env=environment)
    try:
        wait_for(lambda: child.poll() is not None or (part.exists() and part.stat().st_size > 30_000))
        # The recording may be ahead of the first picture of the street.
        wait_for(lambda: screenshot(display, tmp_path / "seat.png").std() > 25.0)
        seat = screenshot(display, tmp_path / "seat.png")
        keys(display, "keydown", "Up")
        wait_for(lambda: open_episode(out).ego["speed_mps"].max() > 0.5)
        keys(display, "keyup", "Up", "key", "c")
        wait_for(lambda: np.abs(screenshot(display, tmp_path / "chase.png") - 1.0 * seat).mean() > 8.0)
        keys(display, "key", "h")
        wait_for(lambda: _help_is_shown(screenshot(display, tmp_path / "help.png")))
        keys(display, "key", "h", "key", "p")
        wait_for(lambda: _stands_still(part))
        keys(display, "key", "Escape")
        assert child.wait(timeout=600) == 0
    finally:
        if child.poll() is None:
            child.kill()
    episode = Episode.load(out)
    assert episode.complete
    assert episode.ego["raw_throttle"].max() == 1.0
    assert episode.ego["speed_mps"].max() > 0.5
    assert np.abs(np.diff(episode.ego["throttle"])).max() < 0.02, "a key press is no step for the car"


def _help_is_shown(picture: np.ndarray) -> bool:
    """The help panel is dark in the middle of the window."""
    height, width = picture.shape[:2]
    middle = picture[height // 2 - 120 : height // 2 + 120, width // 2 - 150 : width // 2 + 150]
    return float(np.median(middle)) < 45.0


def _stands_still(path: Path) -> bool:
    """Whether a paused recording has stopped growing."""
    before = path.stat().st_size
    time.sleep(2.0)
    return path.stat().st_size == before
