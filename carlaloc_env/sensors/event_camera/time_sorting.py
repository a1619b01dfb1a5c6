"""Events in the order of time: each band of rows sorts its own into slots of time, then each slot is sorted.

Both steps go side by side, and neither writes far apart: an event meets a band's few streams first,
then a slot that fits into the processor's cache.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import I32, U32, U64
from carlaloc_env.core.jit import compiled, over_bands
from carlaloc_env.samples import EVENT

SLOT_BITS = 8
"""A slot is 2 to the power of this long [µs]."""


class Slots:
    """Takes the events of bands from several threads, and puts all of them in order.

    Args:
        bands: Number of bands.
        span_us: Longest time [µs].
        room: Events that there is room for; more are taken, too, but not as fast.
    """

    def __init__(self, bands: int, span_us: int, room: int) -> None:
        # One array for all, whose memory comes in large pages, in place of one for each band.
        self._found, self._used, self._lock = np.empty(room, np.uint64), 0, threading.Lock()
        self._more: dict[int, U64] = {}
        self._first = np.zeros((bands, (span_us >> SLOT_BITS) + 2), np.int64)

    def take(self, band: int, t_us: I32, code: U32) -> None:
        """Keep the events of a band.

        Args:
            band: Its number; events of the same time come in the order of these numbers.
            t_us: Times [µs], from 0 to `span_us`.
            code: y · 2^17 + x · 2 + p.
        """
        with self._lock:
            begin, end = self._used, self._used + len(t_us)
            fits = end <= len(self._found)
            if fits:
                self._used = end
            else:
                self._more[band] = np.empty(len(t_us), np.uint64)
        found = self._found if fits else self._more[band]
        _into_slots(t_us, code, begin if fits else 0, self._first[band], found)

    def by_time(self, start_ns: int) -> NDArray[np.void]:
        """Rows of `EVENT` by time; those of the same time stay in the order that they come in.

        Args:
            start_ns: What times count from [ns].
        """
        counts = np.diff(self._first, axis=1).sum(axis=0)
        rows = np.append(0, np.cumsum(counts))
        events = np.empty(rows[-1], EVENT)
        found, first = self._found, self._first.copy()
        for band, more in self._more.items():
            first[band] += len(found)
            found = np.concatenate([found, more])

        def sort(begin: int, end: int) -> None:
            place = np.empty((1 << SLOT_BITS) + 1, np.int64)
            _sort_slots(found, first, rows, begin, end, place, start_ns, events)

        over_bands(sort, len(counts))
        return events


@compiled
def _into_slots(t_us: Any, code: Any, begin: int, first: Any, found: Any) -> None:
    """Put down time and code of each event at the next place of its slot.

    Args:
        t_us: Times [µs].
        code: Codes.
        begin: First place in `found`.
        first: Zeros; filled with the first place of every slot, and the one after the last.
        found: Where to put them.
    """
    slots = len(first) - 1
    for k in range(len(t_us)):
        first[(t_us[k] >> SLOT_BITS) + 1] += 1
    first[0] = begin
    for slot in range(slots):
        first[slot + 1] += first[slot]
    for k in range(len(t_us)):
        slot = t_us[k] >> SLOT_BITS
        found[first[slot]] = np.uint64(t_us[k]) << np.uint64(32) | np.uint64(code[k])
        first[slot] += 1
    for slot in range(slots, 0, -1):
        first[slot] = first[slot - 1]
    first[0] = begin


@compiled
def _sort_slots(
    found: Any, first: Any, rows: Any, begin: int, end: int, place: Any, start_ns: int, events: Any
) -> None:
    """Counting sort of slots; band b's events in slot k begin at `first[b, k]`, and go from `rows[k]` on."""
    for slot in range(begin, end):
        place[:] = 0
        for band in range(len(first)):
            for k in range(first[band, slot], first[band, slot + 1]):
                place[_time_in_slot(found[k]) + 1] += 1
        place[0] = rows[slot]
        for t in range(len(place) - 1):
            place[t + 1] += place[t]
        for band in range(len(first)):
            for k in range(first[band, slot], first[band, slot + 1]):
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
