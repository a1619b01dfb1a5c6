"""Times of calls: wall-clock time and CPU time."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Times of one call, over several calls [s]."""

    median_s: float
    """Median wall-clock time."""
    least_s: float
    """Shortest wall-clock time, as on an idle machine."""
    cpu_s: float
    """Median CPU time, all threads together."""
    calls: int
    """Number of calls that were timed."""

    def per(self, count: int) -> Timing:
        """Times of one of `count` equal parts of the call."""
        return Timing(
            median_s=self.median_s / count,
            least_s=self.least_s / count,
            cpu_s=self.cpu_s / count,
            calls=self.calls * count,
        )

    def to_json(self) -> dict[str, float | int]:
        """Plain numbers."""
        return asdict(self)


def time_calls(calls: Mapping[str, Callable[[], object]], repeat: int, warm_up: int = 1) -> dict[str, Timing]:
    """Time several calls in turn, so that a busy spell of the machine meets all of them.

    Args:
        calls: Functions to time, by name.
        repeat: How often each is timed.
        warm_up: How often each is called before.
    """
    for _ in range(warm_up):
        for call in calls.values():
            call()
    wall: dict[str, list[float]] = {name: [] for name in calls}
    cpu: dict[str, list[float]] = {name: [] for name in calls}
    gc.collect()
    gc.disable()  # as `timeit` does; a collection before every call would empty the caches
    try:
        for _ in range(repeat):
            for name, call in calls.items():
                began, cpu_began = time.perf_counter(), time.process_time()
                call()
                wall[name].append(time.perf_counter() - began)
                cpu[name].append(time.process_time() - cpu_began)
    finally:
        gc.enable()
    return {
        name: Timing(
            median_s=statistics.median(wall[name]),
            least_s=min(wall[name]),
            cpu_s=statistics.median(cpu[name]),
            calls=repeat,
        )
        for name in calls
    }
