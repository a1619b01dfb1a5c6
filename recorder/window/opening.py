"""The window before the drive begins: open from the first second, it shows the work and the time left."""

import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TypeVar

from carlaloc_env.core.errors import DeviceError
from carlaloc_env.core.files.array_cache import default_cache_dir
from recorder.window.window import Window

T = TypeVar("T")

CLOSED_EARLY = "the window was closed before the drive began; nothing has been recorded"

_FIRST_S = 120.0
"""Usual time of a town's first opening on two cores [s]."""
_REFRESH_S = 0.1
"""Time between two views of the text [s]."""


class Opening(AbstractContextManager["Opening"]):
    """A window that answers while the town is loaded in another thread; a context manager.

    How long the same took the last time is kept in the cache, to show the time left.

    Args:
        map_name: Town, or path of an OpenDRIVE file.

    Raises:
        MissingDependencyError: pygame is not installed.
        DeviceError: there is no display.
    """

    def __init__(self, map_name: str) -> None:
        self._began_s = time.monotonic()
        self._town = Path(map_name).stem
        self.window = Window(f"CarlaLoc: {self._town}")
        self._times = default_cache_dir() / "opening_times.json"
        self._last_s = _kept_times(self._times).get(self._town)
        self.show("starting")

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the window; may be called twice."""
        self.window.close()

    def run(self, what: str, work: Callable[[], T]) -> T:
        """Run some work while the window shows its name.

        Raises:
            DeviceError: the window has been closed in the meantime.
        """
        closed = False
        with ThreadPoolExecutor(1) as pool:
            future = pool.submit(work)
            while not wait([future], _REFRESH_S).done:
                closed = closed or self.window.closed()
                self.show("ending" if closed else what)
        if closed:
            raise DeviceError(CLOSED_EARLY)
        return future.result()

    def text(self, what: str) -> str:
        """Text of the work, with the time left where it is known, else with the time so far."""
        passed_s = self._passed_s()
        if self._last_s is not None and passed_s < self._last_s:
            return f"{what}, {max(self._last_s - passed_s, 1.0):.0f} s left"
        why = "the first time takes minutes" if self._last_s is None else "longer than the last time"
        return f"{what}, {why}; {passed_s:.0f} s so far"

    def share(self) -> float:
        """Length of the bar, 0–1, which never stands: nine tenths when the usual time has passed."""
        usual = self._passed_s() / (self._last_s or _FIRST_S)
        return 0.9 * usual if usual < 1.0 else 1.0 - 0.1 / usual

    def show(self, what: str) -> None:
        """Show the name of the work, and a bar."""
        self.window.show_progress(self.text(what), self.share())

    def finish(self) -> None:
        """Store the loading time, as the drive begins."""
        times = _kept_times(self._times) | {self._town: round(self._passed_s(), 1)}
        try:
            self._times.parent.mkdir(parents=True, exist_ok=True)
            self._times.write_text(json.dumps(times))
        except OSError:
            return  # the next start does without

    def _passed_s(self) -> float:
        return time.monotonic() - self._began_s


def _kept_times(path: Path) -> dict[str, float]:
    try:
        seconds_by_town = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return {str(k): float(v) for k, v in seconds_by_town.items()} if isinstance(seconds_by_town, dict) else {}
