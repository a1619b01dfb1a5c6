"""Events in the order of time: bands of rows sort theirs into slots of time, then each slot is sorted.

Both steps go side by side, and neither writes far apart: an event meets a slot's few streams first,
then a slot that fits into the processor's cache.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.compiled import compiled, over_bands
from carlaloc_env.samples import EVENT

SLOT_BITS = 8
"""A slot is 2 to the power of this long [µs]."""


def by_time(
    bands: list[tuple[NDArray[np.int32], NDArray[np.uint32]]], start_ns: int, span_us: int
) -> NDArray[np.void]:
    """Rows of `EVENT` by time; those of the same time stay in the order that they come in.

    Args:
        bands: Times [µs], from 0 to `span_us`, and codes of the events of each band: y · 2^17 + x · 2 + p.
        start_ns: What times count from [ns].
        span_us: Longest time [µs].
    """
    slots = (span_us >> SLOT_BITS) + 1
    counts = np.zeros((len(bands), slots), np.int64)
    over_bands(lambda band, _: _count_slots(bands[band][0], counts[band]), len(bands), 1)
    ends = np.cumsum(counts.T).reshape(slots, len(bands)).T
    places, first = ends - counts, np.append(0, ends[-1])
    found, events = np.empty(first[-1], np.uint64), np.empty(first[-1], EVENT)
    over_bands(lambda band, _: _into_slots(*bands[band], places[band], found), len(bands), 1)

    def sort(begin: int, end: int) -> None:
        _sort_slots(found, first, begin, end, np.empty((1 << SLOT_BITS) + 1, np.int64), start_ns, events)

    over_bands(sort, slots)
    return events


@compiled
def _count_slots(t_us: Any, counts: Any) -> None:
    """Count the events of each slot; `counts` holds zeros."""
    for k in range(len(t_us)):
        counts[t_us[k] >> SLOT_BITS] += 1


@compiled
def _into_slots(t_us: Any, code: Any, place: Any, found: Any) -> None:
    """Put down time and code of each event at the next place of its slot."""
    for k in range(len(t_us)):
        slot = t_us[k] >> SLOT_BITS
        found[place[slot]] = np.uint64(t_us[k]) << np.uint64(32) | np.uint64(code[k])
        place[slot] += 1


@compiled
def _sort_slots(found: Any, first: Any, begin: int, end: int, place: Any, start_ns: int, events: Any) -> None:
    """Counting sort of slots that lie one after another, from slot k's events at `first[k]` on."""
    for slot in range(begin, end):
        place[:] = 0
        for k in range(first[slot], first[slot + 1]):
            place[_time_in_slot(found[k]) + 1] += 1
        place[0] = first[slot]
        for t in range(len(place) - 1):
            place[t + 1] += place[t]
        for k in range(first[slot], first[slot + 1]):
            t = _time_in_slot(found[k])
            row = place[t]
            place[t] += 1
            events[row].t = start_ns + 1000 * np.int64(found[k] >> np.uint64(32))
            events[row].x = found[k] >> np.uint64(1) & np.uint64(0xFFFF)
            events[row].y = found[k] >> np.uint64(17) & np.uint64(0x7FFF)
            events[row].p = found[k] & np.uint64(1)


@compiled
def _time_in_slot(word: Any) -> int:
    """Time since the beginning of its slot [µs]."""
    time: int = np.int64(word >> np.uint64(32) & np.uint64((1 << SLOT_BITS) - 1))  # type: ignore[assignment]
    return time
