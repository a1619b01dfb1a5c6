"""What a process holds, and a small map to make and close environments on."""

from __future__ import annotations

import ctypes
import gc
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

STRAIGHT = """<OpenDRIVE><header revMajor="1" revMinor="4"/><road id="1" length="300" junction="-1">
<planView><geometry s="0" x="0" y="0" hdg="0" length="300"><line/></geometry></planView><lanes>
<laneSection s="0"><center><lane id="0" type="none"/></center><right><lane id="-1" type="driving">
<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road></OpenDRIVE>"""


class Held(NamedTuple):
    """What this process holds of the machine."""

    memory_mb: float
    """Memory of its own, what the allocator keeps for later not counted [MB]."""
    handles: int
    """Open files, sockets and devices."""

    @classmethod
    def now(cls) -> Held:
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)
        own = re.search(r"Anonymous:\s*(\d+) kB", Path("/proc/self/smaps_rollup").read_text())
        assert own is not None
        return cls(int(own[1]) / 1024, len(list(Path("/proc/self/fd").iterdir())))


def runs(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def growth(cycle: Callable[[int], None], cycles: int, warm_ups: int) -> Held:
    """What is held after some cycles more than after the first ones."""
    if not Path("/proc/self/smaps_rollup").exists() or not hasattr(ctypes.CDLL(None), "malloc_trim"):
        pytest.skip("what a process holds is read from Linux's /proc, with the GNU C library")
    for number in range(warm_ups):
        cycle(number)
    before = Held.now()
    for number in range(cycles - warm_ups):
        cycle(warm_ups + number)
    after = Held.now()
    return Held(after.memory_mb - before.memory_mb, after.handles - before.handles)


@pytest.fixture(scope="session")
def straight_map(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """300 m of a single lane: a town that stands in half a second."""
    path = tmp_path_factory.mktemp("map") / "straight.xodr"
    path.write_text(STRAIGHT)
    return path
