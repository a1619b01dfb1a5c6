"""The hunt: thousands of bad inputs to one reader, and what has to hold for each of them.

An input is read or refused by one line of ours. Nothing else is raised, nothing is written outside the
folders given, no answer takes longer than `DEADLINE_S`, and memory does not grow.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
from hypothesis import HealthCheck, Phase, given, seed, settings
from shared_fixtures.processes.lifecycles import Held

from carlaloc_env.core.errors import CarlaLocError

DEADLINE_S = 30
"""Longest processor time for an answer [s], whatever else the machine does."""
BLOCK = 1000
"""Inputs drawn by one call of hypothesis."""
GROWTH_MAX_MB = 60.0
"""Most that memory may grow over a hunt, after its first block [MB]."""
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate")


@dataclass(slots=True, eq=False)
class Tally:
    """What came of a hunt."""

    name: str
    """Kind of input."""
    tried: int = 0
    """Inputs."""
    refused: int = 0
    """Inputs that were refused with a line of ours."""
    slowest_s: float = 0.0
    """Longest answer [s]."""
    growth_mb: float = 0.0
    """Growth of memory after the first block [MB]."""


@dataclass(slots=True, eq=False)
class WriteGuard:
    """Notes every file or folder that Python code of this process changes outside some folders."""

    allowed: tuple[Path, ...]
    """Folders that may be written into."""
    astray: list[str] = field(default_factory=list)
    """What was changed elsewhere."""
    active: bool = False

    def install(self) -> None:
        """Listen to the interpreter's audit events; there is no way to stop, so do it once."""
        if find_spec("matplotlib"):
            # It makes folders of its own when it is first imported, whichever command does that.
            import_module("matplotlib.font_manager")
        sys.addaudithook(self._heard)

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.active:
            return
        if event == "open":
            path, _, flags = arguments
            if not isinstance(path, (str, bytes, os.PathLike)) or not int(flags or 0) & _WRITES:
                return
        elif event in _CHANGES:
            path = arguments[1] if event in ("os.rename", "os.link", "os.symlink") else arguments[0]
        else:
            return
        where = Path(os.fsdecode(path)).resolve()
        # Python and numba keep compiled code in these folders, whatever the command was.
        if "__pycache__" in where.parts or where.parts[1:2] == ("dev",):
            return
        if not any(where.is_relative_to(folder) for folder in self.allowed):
            self.astray.append(f"{event} {where}")


@contextmanager
def deadline(seconds: int = DEADLINE_S) -> Iterator[None]:
    """Stops what hangs: raises TimeoutError after that processor time."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"no answer within {seconds} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def answered(read: Callable[[Any], None], value: Any) -> bool:
    """Whether an input was read; False: refused with one line of ours.

    Raises:
        AssertionError: the refusal is empty, or has more than one line.
    """
    try:
        with deadline():
            read(value)
    except CarlaLocError as error:
        text = str(error)
        assert text.strip()
        assert "\n" not in text
        return False
    return True


def hunt(
    name: str, inputs: st.SearchStrategy[Any], read: Callable[[Any], None], count: int, guard: WriteGuard
) -> Tally:
    """Give a reader many inputs.

    Args:
        name: Kind of input.
        inputs: Draws an input.
        read: Reads it; raises `CarlaLocError` to refuse it.
        count: Number of inputs.
        guard: Listens for writes.

    Raises:
        AssertionError: something was written astray, or memory grew.
        Exception: whatever a reader lets through.
    """
    tally = Tally(name)

    def one(value: Any) -> None:
        start = time.monotonic()
        guard.active = True
        try:
            tally.refused += not answered(read, value)
        finally:
            guard.active = False
            tally.slowest_s = max(tally.slowest_s, time.monotonic() - start)
        tally.tried += 1
        assert not guard.astray, guard.astray

    early: Held | None = None
    # In blocks: hypothesis keeps a tree of all that one call has drawn, which is not ours to count.
    for number, begin in enumerate(range(0, count, BLOCK)):
        drawn = settings(
            max_examples=min(BLOCK, count - begin), deadline=None, database=None, report_multiple_bugs=False,
            suppress_health_check=list(HealthCheck), phases=(Phase.generate, Phase.shrink),
        )(given(inputs)(one))  # fmt: skip
        seed(number)(drawn)()
        early = early or Held.now()
    tally.growth_mb = Held.now().memory_mb - (early or Held.now()).memory_mb
    assert tally.growth_mb < GROWTH_MAX_MB, f"memory grew by {tally.growth_mb:.0f} MB"
    return tally
