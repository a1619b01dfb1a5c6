"""Cores that a process may use, and work on bands of an image that is spread over them."""

import functools
import math
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

R = TypeVar("R")
BAND_ROWS = 24
"""Rows of one band; bands do not depend on the number of threads, so results do not either."""


def usable_cores(root: Path = Path("/")) -> tuple[int, ...]:
    """Numbers of the cores that this process may use: of its affinity, as many as its container is granted.

    Args:
        root: Folder of the system's files.
    """
    affinity = getattr(os, "sched_getaffinity", lambda _: range(os.cpu_count() or 1))
    cores = tuple(sorted(affinity(0)))
    return cores[: max(math.ceil(min(_granted(root), len(cores))), 1)]


@functools.cache
def _granted(root: Path) -> float:
    """Cores that the control groups of this process, of version 1 or 2, grant it; infinite: no limit."""
    granted = math.inf
    with suppress(OSError, ValueError):
        for line in (root / "proc/self/cgroup").read_text(encoding="utf-8").splitlines():
            _, controllers, group = line.split(":", 2)
            if controllers and "cpu" not in controllers.split(","):
                continue
            below = Path(group.strip("/"))
            # A group has at most what those above it have; a container may see itself as the topmost.
            for folder in (below, *below.parents):
                place = root / "sys/fs/cgroup" / ("cpu" if controllers else "") / folder
                granted = min(granted, _quota(place))
    return granted


def _quota(group: Path) -> float:
    """Cores that one control group grants; infinite: no limit."""
    for names in (("cpu.max",), ("cpu.cfs_quota_us", "cpu.cfs_period_us")):
        # "max" is no number.
        with suppress(OSError, ValueError):
            quota_us, period_us = " ".join((group / name).read_text() for name in names).split()
            if int(quota_us) > 0:
                return int(quota_us) / int(period_us)
    return math.inf


def over_bands(function: Callable[[int, int], R], rows: int, band_rows: int = BAND_ROWS) -> list[R]:
    """Results of a function of (first row, end row) for all bands of an image, from the top down."""
    bands = [(first, min(first + band_rows, rows)) for first in range(0, rows, band_rows)]
    threads = min(len(usable_cores()), len(bands), 8)
    if threads <= 1:
        return [function(*band) for band in bands]
    results: dict[int, R] = {}
    failed: list[BaseException] = []
    pending = iter(range(len(bands)))

    def work() -> None:
        # Threads of its own that each take the next band cost a tenth of an executor's.
        try:
            for number in pending:
                results[number] = function(*bands[number])
        except BaseException as error:
            failed.append(error)

    helpers = [threading.Thread(target=work) for _ in range(threads - 1)]
    for helper in helpers:
        helper.start()
    work()
    for helper in helpers:
        helper.join()
    if failed:
        raise failed[0]
    return [results[number] for number in range(len(bands))]
