"""Occupancy of every lane: vehicles, their tails and noses on other lanes, the ego, sorted by station."""

from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.conflict_zones import MERGING, PARTING
from carlaloc_env.traffic.tables.lane_geometry import station_beside, width_at
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.record_arrays import columns
from carlaloc_env.traffic.tables.vehicle_state import PAST, Drivers, Fleet

HORIZON_M = 120.0
"""Distance ahead within which drivers look for a leader [m]."""
_ROWS_PER_VEHICLE = 14
"""Rows that are made for each vehicle at first."""
_ROWS_FOR_EGO = 64
"""Rows that are made for the ego at first: it lies on every lane that its box touches."""


class Bodies:
    """Bodies on lanes in the order of their gathering, E of them."""

    lane: Index
    """Lane, (E,)."""
    centre_m: Array
    """Station of the body's centre, may lie beyond the lane's ends [m], (E,)."""
    half_m: Array
    """Half its length [m], (E,)."""
    speed_mps: Array
    """Speed along the lane [m/s], (E,)."""
    owner: Index
    """Vehicle; the ego's number is the count of vehicles, (E,)."""


class Occupancy(NamedTuple):
    """Bodies on all lanes."""

    body: Bodies
    """Rows; the first ``used[0]`` are in use."""
    order: Index
    """Rows sorted by lane and centre, (E,)."""
    first: Index
    """Where each lane begins in `order`, (N + 1,)."""
    used: Index
    """Number of bodies, (1,); above the number of rows when there was no room for all."""


def empty_occupancy(vehicles: int, lanes: int, rows: int = 0) -> Occupancy:
    """Empty occupancy of N lanes.

    Args:
        vehicles: Number of vehicles, the ego not counted.
        lanes: Number of lanes N.
        rows: Bodies that there is room for; usually enough for these vehicles when left out.
    """
    rows = rows or _ROWS_PER_VEHICLE * vehicles + _ROWS_FOR_EGO
    return Occupancy(
        body=columns(Bodies, rows),
        order=np.zeros(rows, np.int64),
        first=np.zeros(lanes + 1, np.int64),
        used=np.zeros(1, np.int64),
    )


@compiled
def add_body(
    occupancy: Occupancy, lane: int, centre_m: float, half_m: float, speed_mps: float, owner: int
) -> None:
    """Put one more body on a lane; without a free row it is only counted."""
    k = occupancy.used[0]
    if k < len(occupancy.order):
        occupancy.body.lane[k] = lane
        occupancy.body.centre_m[k] = centre_m
        occupancy.body.half_m[k] = half_m
        occupancy.body.speed_mps[k] = speed_mps
        occupancy.body.owner[k] = owner
    occupancy.used[0] = k + 1


@compiled
def _add_with_zones(
    occupancy: Occupancy, roads: Roads, lane: int, centre_m: float, half_m: float, speed: float, v: int
) -> None:
    """A body on a lane and, in junctions, on the lanes that part from or merge with it there."""
    add_body(occupancy, lane, centre_m, half_m, speed, v)
    if roads.lane.junction[lane] < 0:
        return
    for z in range(roads.lane.zone_first[lane], roads.lane.zone_end[lane]):
        other = roads.zone.other[z]
        if roads.zone.kind[z] == PARTING and centre_m - half_m < roads.zone.leave_m[z]:
            add_body(occupancy, other, centre_m, half_m, speed, v)
        elif roads.zone.kind[z] == MERGING and centre_m + half_m > roads.zone.enter_m[z]:
            other_centre = roads.lane.length_m[other] - (roads.lane.length_m[lane] - centre_m)
            add_body(occupancy, other, other_centre, half_m, speed, v)


@compiled
def gather_bodies(occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, count: int) -> None:
    """Gather the bodies of the first `count` vehicles on all lanes that they touch.

    Writes the rows of `occupancy.body` from 0 on and their number; `sort_bodies` orders them.
    """
    occupancy.used[0] = 0
    for v in range(count):
        lane, station = fleet.plan[v, 0], fleet.station_m[v]
        half, speed = 0.5 * drivers.length_m[v], fleet.speed_mps[v]
        _add_with_zones(occupancy, roads, lane, station, half, speed, v)
        centre = station
        for k in range(PAST):
            before = fleet.past[v, k]
            if centre - half >= 0.0 or before < 0:
                break
            centre += roads.lane.length_m[before]
            _add_with_zones(occupancy, roads, before, centre, half, speed, v)
        ahead = fleet.plan[v, 1]
        if ahead >= 0 and station + half > roads.lane.length_m[lane]:
            _add_with_zones(occupancy, roads, ahead, station - roads.lane.length_m[lane], half, speed, v)
        side = fleet.origin[v]
        if side != 0 and on_origin(roads, drivers, fleet, v):
            origin = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
            if origin >= 0:
                origin_station = station_beside(roads, lane, station, origin)
                add_body(occupancy, origin, origin_station, half, speed, v)
                first, end = roads.lane.before_first[origin], roads.lane.before_end[origin]
                if origin_station - half < 0.0 and first < end:
                    before = roads.before[first]
                    add_body(occupancy, before, origin_station + roads.lane.length_m[before], half, speed, v)


@compiled
def on_origin(roads: Roads, drivers: Drivers, fleet: Fleet, v: int) -> bool:
    """Whether vehicle v still reaches into the lane that it is leaving."""
    lane = fleet.plan[v, 0]
    half_extent = abs(fleet.lateral_offset_m[v]) + 0.5 * drivers.width_m[v] + 0.1
    return bool(half_extent > 0.5 * width_at(roads, lane, fleet.station_m[v]))


@compiled
def sort_bodies(occupancy: Occupancy) -> None:
    """Sort bodies by lane and centre; equal ones stay in the order of their gathering.

    Writes `order`, (E,), and `first`, (lanes + 1,).
    """
    first, order, count = occupancy.first, occupancy.order, occupancy.used[0]
    first[:] = 0
    for k in range(count):
        first[occupancy.body.lane[k]] += 1
    for lane in range(1, len(first)):
        first[lane] += first[lane - 1]
    # Each lane's end moves down to its beginning, one body at a time.
    for k in range(count - 1, -1, -1):
        lane = occupancy.body.lane[k]
        first[lane] -= 1
        order[first[lane]] = k
    # Insertion into each lane's stretch: lanes hold few bodies.
    for lane in range(len(first) - 1):
        for i in range(first[lane] + 1, first[lane + 1]):
            row = order[i]
            j = i
            while j > first[lane] and occupancy.body.centre_m[order[j - 1]] > occupancy.body.centre_m[row]:
                order[j] = order[j - 1]
                j -= 1
            order[j] = row


@compiled
def index_after(occupancy: Occupancy, lane: int, centre_m: float) -> int:
    """Index in `order` of the first body of a lane whose centre lies beyond a station [m]."""
    low, high = occupancy.first[lane], occupancy.first[lane + 1]
    while low < high:
        middle = (low + high) // 2
        if occupancy.body.centre_m[occupancy.order[middle]] > centre_m:
            high = middle
        else:
            low = middle + 1
    return int(low)
