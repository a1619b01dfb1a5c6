"""Crosswalks by the lanes that they cross."""

from __future__ import annotations

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.tables.record_arrays import packed

WANTED, TAKEN = 1, 2
"""What walkers do with a crossing: they wait to cross, or they walk there or will within seconds."""


class Crossings:
    """Pairs of a crosswalk and a lane that it crosses, C rows."""

    lane: Index
    """Number of the lane, (C,)."""
    crosswalk: Index
    """Number of the crosswalk, (C,)."""
    enter_m: Array
    """Station at which the crosswalk begins [m], (C,)."""
    leave_m: Array
    """Station at which it ends [m], (C,)."""


def find_crossings(network: LaneNetwork) -> tuple[Index, Crossings]:
    """Where each lane's rows begin (N + 1,), and all crossings of driving lanes."""
    rows: list[list[tuple[int, int, float, float]]] = [[] for _ in network.lanes]
    for number, crosswalk in enumerate(network.crosswalks):
        for lane, (enter, leave) in zip(crosswalk.lanes, crosswalk.span_m, strict=True):
            rows[lane].append((lane, number, enter, leave))
    return packed(Crossings, rows)
