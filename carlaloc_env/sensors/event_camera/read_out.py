"""Read-out of an event camera: events in the order of time, no more of them than the chip can pass on."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import I32, U32
from carlaloc_env.core.jit import compiled
from carlaloc_env.samples import EVENT


def by_time(t_us: list[I32], code: list[U32], start_ns: int, span_us: int) -> NDArray[np.void]:
    """Rows of `EVENT` by time; those of the same time stay in the order that they come in.

    Args:
        t_us: Times of the events of each band of rows [µs], from 0 to `span_us`.
        code: y · 2^17 + x · 2 + p of each of them.
        start_ns: What times count from [ns].
        span_us: Longest time [µs].
    """
    # Place of the first event of each microsecond; counting sort.
    counts = np.zeros(span_us + 2, np.int64)
    for times in t_us:
        _count(times, counts)
    places = np.cumsum(counts)
    events = np.empty(places[-1], EVENT)
    for times, codes in zip(t_us, code, strict=True):
        _put(times, codes, places, start_ns, events)
    return events


@compiled
def _count(t_us: Any, counts: Any) -> None:
    for t in t_us:
        counts[t + 1] += 1


@compiled
def _put(t_us: Any, code: Any, places: Any, start_ns: int, events: Any) -> None:
    for k in range(len(t_us)):
        t, event = t_us[k], code[k]
        row = places[t]
        places[t] += 1
        events[row].t = start_ns + 1000 * np.int64(t)
        events[row].x = event >> np.uint32(1) & np.uint32(0xFFFF)
        events[row].y = event >> np.uint32(17)
        events[row].p = event & np.uint32(1)


def limit_rate(
    events: NDArray[np.void], start_ns: int, rate_max_hz: float, slot_us: int = 1000
) -> NDArray[np.void]:
    """Events that a read-out of limited rate lets through: evenly thinned in every slot of time.

    Args:
        events: Rows by time.
        start_ns: Beginning of the first slot [ns].
        rate_max_hz: Events per second that can be read [1/s].
        slot_us: Length of a slot [µs].
    """
    most = max(int(rate_max_hz * 1e-6 * slot_us), 1)
    slot = (events["t"] - start_ns - 1) // (1000 * slot_us)
    count = np.bincount(slot)
    if not len(count) or count.max() <= most:
        return events
    begin = np.cumsum(count) - count
    rank = np.arange(len(events)) - begin[slot]
    total = count[slot]
    # Of n events in a slot, those stay at which floor(rank · most / n) rises.
    kept = (total <= most) | ((rank + 1) * most // total > rank * most // total)
    result: NDArray[np.void] = events[kept]
    return result
