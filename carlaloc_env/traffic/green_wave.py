"""Green waves: when the cycles along a route begin, so that cars which set out with the drive wait least."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.traffic.tables.record_arrays import Flags

DEPARTURE_S = 3.0
"""When a drive gets going: it begins with two seconds of rest [s]."""
PACES = (0.72, 0.77, 0.82, 0.87, 0.92)
"""Speeds of cars over what limits and bends allow: from dense traffic to a free street."""
_QUEUE_S = 6.0
"""How long after the beginning of green the queue before a car has left [s]."""
_OFF_MIDDLE = 0.05
"""Weight of a second that a car passes before or after the middle of a green against one that it waits."""
_STEP_S = 0.25
"""Step in which the beginning of a cycle is looked for [s]."""
_SWEEPS = 3
"""How often each junction is looked at again, once the others have found theirs."""


class Passings(NamedTuple):
    """Passings of stop lines with lights along a route, in their order, L of them."""

    travel_s: Array
    """Time from the start at a pace of 1 [s], (L,)."""
    junction: Index
    """Number of the junction, from 0, (L,)."""
    green_begins_s: Array
    """When the green begins in the junction's cycle [s], (L,)."""
    green_s: Array
    """How long it lasts [s], (L,)."""
    cycle_s: Array
    """The junction's cycle [s], (L,)."""

    def rows(self, chosen: Flags) -> Passings:
        """Some of the passings, by flags (L,)."""
        return Passings(**{name: column[chosen] for name, column in self._asdict().items()})


def wave_begins_s(passings: Passings, begins_s: Array) -> Array:
    """Beginnings of the cycles of J junctions with which cars of all `PACES` wait least [s], (J,).

    Junctions are gone over in the order of the route, each with the others held (coordinate descent): a car
    that waits at one light comes later to the next. At first, lights not yet gone over are open.

    Args:
        passings: Passings of stop lines.
        begins_s: Beginnings for junctions that are not passed [s], (J,).
    """
    begins_s = begins_s.copy()
    counts = np.zeros(len(passings.junction), bool)
    for _ in range(_SWEEPS):
        for junction in dict.fromkeys(passings.junction.tolist()):
            counts |= passings.junction == junction
            cycle_s = float(passings.cycle_s[passings.junction == junction][0])
            candidate_s = np.arange(0.0, cycle_s, _STEP_S)
            trial = np.repeat(begins_s[:, None], len(candidate_s), axis=1)
            trial[junction] = candidate_s
            begins_s[junction] = candidate_s[np.argmin(_cost_s(passings.rows(counts), trial))]
    return begins_s


def _cost_s(passings: Passings, begins_s: Array) -> Array:
    """What cars lose at all lights for C trials of beginnings [s], (J, C) → (C,)."""
    waits, off_middle = drive_along(passings, begins_s)
    total: Array = (waits + _OFF_MIDDLE * off_middle).sum(axis=(0, 1))
    return total


def drive_along(passings: Passings, begins_s: Array) -> tuple[Array, Array]:
    """Waits of cars of each of `PACES` at L lights; how far from the middle of the green the others pass.

    Args:
        passings: Passings of stop lines.
        begins_s: C trials of the beginnings of the cycles [s], (J, C).

    Returns:
        Both in seconds, (L, P, C).
    """
    pace = np.array(PACES)[:, None]
    time_s = np.full((len(pace), begins_s.shape[1]), DEPARTURE_S)
    waits, off_middle = [], []
    before_s = 0.0
    for row, travel_s in enumerate(passings.travel_s.tolist()):
        time_s = time_s + (travel_s - before_s) / pace
        before_s = travel_s
        begin_s = begins_s[passings.junction[row]] + passings.green_begins_s[row]
        green_s, cycle_s = passings.green_s[row], passings.cycle_s[row]
        into_s = np.mod(time_s - begin_s, cycle_s)
        leaves_s = np.where(into_s < green_s, np.maximum(into_s, _QUEUE_S), cycle_s + _QUEUE_S)
        off_middle.append(np.where(into_s < green_s, np.abs(into_s - 0.5 * green_s), 0.0))
        waits.append(leaves_s - into_s)
        time_s = time_s + waits[-1]
    return np.array(waits), np.array(off_middle)
