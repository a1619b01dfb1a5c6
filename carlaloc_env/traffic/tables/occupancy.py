"""Occupancy of every lane: vehicles, their tails and noses on other lanes, the ego, sorted by station.

Lane geometry for compiled functions: points, widths, speeds and neighbouring stations of lanes.
"""

from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.conflict_zones import MERGING, PARTING
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.record_arrays import columns
from carlaloc_env.traffic.tables.vehicle_state import PAST, Drivers, Fleet


@compiled
def sample(roads: Roads, lane: int, station_m: float) -> tuple[int, float]:
    """Row of the sample before a station [m], and the fraction of the distance to the next row, 0–1."""
    at = min(max(station_m / roads.lane.row_step_m[lane], 0.0), roads.lane.row_count[lane] - 1.0)
    k = min(int(at), roads.lane.row_count[lane] - 2)
    return roads.lane.row_first[lane] + k, at - k


@compiled
def allowed_at(roads: Roads, lane: int, station_m: float) -> float:
    """Speed that limit and bends allow at a station [m] of a lane [m/s]."""
    row, _ = sample(roads, lane, station_m)
    return float(roads.row.allowed_mps[row])


@compiled
def width_at(roads: Roads, lane: int, station_m: float) -> float:
    """Width of a lane at a station [m], linear between samples [m]."""
    row, f = sample(roads, lane, station_m)
    return float(roads.row.width_m[row] * (1.0 - f) + roads.row.width_m[row + 1] * f)


@compiled
def centre_at(roads: Roads, lane: int, station_m: float) -> tuple[float, float, float, float]:
    """Point (x, y) [m], cosine and sine of a lane's centre line, by straight lines between the samples."""
    row, f = sample(roads, lane, station_m)
    c = roads.row.tangent[row, 0] * (1.0 - f) + roads.row.tangent[row + 1, 0] * f
    s = roads.row.tangent[row, 1] * (1.0 - f) + roads.row.tangent[row + 1, 1] * f
    x = roads.row.position_m[row, 0] * (1.0 - f) + roads.row.position_m[row + 1, 0] * f
    y = roads.row.position_m[row, 1] * (1.0 - f) + roads.row.position_m[row + 1, 1] * f
    norm = np.sqrt(c * c + s * s)
    return float(x), float(y), float(c / norm), float(s / norm)


@compiled
def station_beside(roads: Roads, lane: int, station_m: float, other: int) -> float:
    """Station of a neighbouring lane of the same section that lies beside a station [m].

    Both have the same distance along the road's reference line, linear between samples.
    """
    row, f = sample(roads, lane, station_m)
    along = roads.row.along_m[row] * (1.0 - f) + roads.row.along_m[row + 1] * f
    first, last = roads.lane.row_first[other], roads.lane.row_first[other] + roads.lane.row_count[other] - 2
    past = row - roads.lane.row_first[lane] + f
    other_row = min(first + int(past * roads.lane.row_count[other] / roads.lane.row_count[lane]), last)
    while other_row > first and roads.row.along_m[other_row] > along:
        other_row -= 1
    while other_row < last and roads.row.along_m[other_row + 1] < along:
        other_row += 1
    gap = roads.row.along_m[other_row + 1] - roads.row.along_m[other_row]
    fraction = (along - roads.row.along_m[other_row]) / gap if gap > 1e-9 else 0.0
    beyond = station_m - min(max(station_m, 0.0), roads.lane.length_m[lane])
    return float((other_row - first + fraction) * roads.lane.row_step_m[other] + beyond)


@compiled
def bank_at(roads: Roads, lane: int, station_m: float) -> float:
    """Rise of the road per metre to the left of a lane at a station [m], linear between samples."""
    row, f = sample(roads, lane, station_m)
    return float(roads.row.bank[row] * (1.0 - f) + roads.row.bank[row + 1] * f)


@compiled
def put_point(roads: Roads, lane: int, station_m: float, lateral_offset_m: float, out: Array) -> None:
    """Write a point of a lane and its direction to `out`: x, y, z [m], cos, sin, rise.

    Args:
        roads: The roads.
        lane: The lane.
        station_m: Station [m]; beyond the lane's ends its end directions go on straight.
        lateral_offset_m: Distance to the left of the centre line [m].
        out: Six numbers.
    """
    row, f = sample(roads, lane, station_m)
    on_lane = min(max(station_m, 0.0), roads.lane.length_m[lane])
    g, h, f2 = 1.0 - f, roads.lane.row_step_m[lane], f * f
    w1 = f2 * (3.0 - 2.0 * f)
    m0, m1 = h * f * g * g, h * f2 * g
    for k in range(3):
        t0, t1 = roads.row.tangent[row, k], roads.row.tangent[row + 1, k]
        p0, p1 = roads.row.position_m[row, k], roads.row.position_m[row + 1, k]
        tangent = t0 * g + t1 * f
        out[k] = p0 * (1.0 - w1) + p1 * w1 + t0 * m0 - t1 * m1 + (station_m - on_lane) * tangent
        out[3 + k] = tangent
    norm = np.sqrt(out[3] * out[3] + out[4] * out[4])
    out[3] /= norm
    out[4] /= norm
    out[0] -= lateral_offset_m * out[4]
    out[1] += lateral_offset_m * out[3]
    out[2] += lateral_offset_m * bank_at(roads, lane, station_m)


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
