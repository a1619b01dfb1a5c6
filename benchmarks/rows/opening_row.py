"""Times from the command to the open window and to the start of the drive."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench import Bench, Row
from scenario import TOWN

from carlaloc_env.core.files.array_cache import default_cache_dir

PATIENCE_S = 300.0


def opening(bench: Bench) -> Row:
    """`carlaloc record --device keyboard` with the town in the cache, on a virtual display."""
    what = f"driver's window of {TOWN} from the cache: command to drive"
    missing = [tool for tool in ("Xvfb", "xwininfo") if shutil.which(tool) is None]
    if missing:
        note = f"needs {' and '.join(missing)} (Debian: xvfb, x11-utils)"
        return Row(name="opening", what=what, value=None, unit="s", note=note)
    assert bench.town.name == TOWN  # now it is in the cache
    with _display() as display:
        seen = [_open(display) for _ in range(2)]
    # The first one reads libraries from the disk.
    window_s, drivable_s = seen[-1]
    return Row(
        name="opening",
        what=what,
        value=drivable_s,
        unit="s",
        target=15.0,
        at_least=False,
        note=f"the window stands after {window_s:.1f} s (≤ 2); from a cold disk {seen[0][1]:.1f} s",
        detail={"window_s": window_s, "drivable_s": drivable_s},
    )


@contextmanager
def _display() -> Iterator[str]:
    """Name of a virtual display."""
    receiver, sender = os.pipe()
    command = ["Xvfb", "-displayfd", str(sender), "-screen", "0", "1600x1000x24", "-noreset"]
    with subprocess.Popen(command, pass_fds=[sender], stderr=subprocess.DEVNULL) as server:
        os.close(sender)
        with os.fdopen(receiver) as output:
            yield f":{output.readline().strip()}"
        server.terminate()


def _open(display: str) -> tuple[float, float]:
    """Times from the command to the window and to the drive [s]."""
    # Written when the drive begins, to estimate the time left in the next run.
    times = default_cache_dir() / "opening_times.json"
    times.unlink(missing_ok=True)
    environment = {**os.environ, "DISPLAY": display}
    environment.pop("SDL_VIDEODRIVER", None)
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "recorder.cli.main", "record", "--map", TOWN, "--device", "keyboard"]
        command += ["--out", str(Path(folder) / "drive.mcap")]
        began_s = time.monotonic()
        with subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL) as child:
            window_s = 0.0
            while not times.exists() and child.poll() is None and time.monotonic() - began_s < PATIENCE_S:
                if not window_s and _has_window(environment):
                    window_s = time.monotonic() - began_s
                time.sleep(0.05)
            drivable_s = time.monotonic() - began_s
            child.send_signal(signal.SIGINT)
    assert times.exists(), "the window did not open"
    return window_s, drivable_s


def _has_window(environment: dict[str, str]) -> bool:
    tree = subprocess.run(
        ["xwininfo", "-root", "-tree"], env=environment, capture_output=True, text=True, check=False
    )
    return "CarlaLoc" in tree.stdout
