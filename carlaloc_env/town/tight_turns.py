"""Turns tighter than a car can drive along the lane's middle: lines on which all of it stays on the lanes.

Where a lane bends tighter than a car's rear axle can follow, drivers swing out before the turn, use the room
of the junction, and come back to the middle behind it. Of a family of such lines, cubic curves between two
places aside of the lane's middle, the one is taken whose swept area leaves the lanes least.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from carlaloc_env.assets.catalog import EGO_REAR_M, EGO_SIZE_M
from carlaloc_env.town.lane_links import DRIVABLE_TYPES
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.opendrive.profiles import Array
from carlaloc_env.town.polygons import Area, strip_polygon
from carlaloc_env.town.route_line import SAMPLE_M, RouteLine

TIGHT_M = 4.6
"""Turns of a smaller radius, as a mean over `WINDOW_M`, are fitted [m]."""
KINK_M = 4.2
"""So are kinks of a smaller radius as a mean over half of it [m]."""
WINDOW_M = 4.0
EASY_M = 4.75
"""Radius that a car can drive with some lock in hand [m]."""
LEAD_M = 12.0
"""How far before and behind a turn the line may leave the lane's middle [m]."""
_BEGINS_M = (-1.5, 0.0, 1.5, 3.0, 5.0)
_ASIDE_M = (0.0, 0.3, 0.6, 1.0)
_HANDLES = (0.34, 0.42, 0.5, 0.6)
_MERGE_M = 4.0
"""Turns closer together than this are driven as one [m]."""
_CELL_M = 0.1
_REACH_M = 7.0
_LEVEL_M = 2.0
_TOO_TIGHT = 20.0
"""What a curvature above the greatest costs [m² per 1/m], against metres off the lanes."""
_ROOM = frozenset({"shoulder", "stop", "border", "parking", "biking", "bus", "restricted"})
_SIDES = 0.5 * EGO_SIZE_M[1] * np.array([[1.0], [-1.0]])
_BODY = np.stack(
    np.broadcast_arrays(EGO_REAR_M + np.linspace(0.0, EGO_SIZE_M[0], 6)[None], _SIDES), axis=-1
).reshape(-1, 2)


class _Turn(NamedTuple):
    """Rows of a line: where it may leave the middle, where the turn begins and ends, where it is back."""

    start: int
    first: int
    last: int
    end: int


class _Room(NamedTuple):
    """How far points are off the lanes [m], on a grid."""

    low_m: Array
    off_m: Array

    def at(self, points_m: Array) -> Array:
        """Distance off the lanes of points (N, 2), 0 on them [m]."""
        cell = ((points_m - self.low_m) / _CELL_M).astype(np.int64)
        i, j = (np.clip(cell[:, k], 0, self.off_m.shape[k] - 1) for k in range(2))
        result: Array = self.off_m[i, j]
        return result


def fit_turns(network: LaneNetwork, line: RouteLine) -> tuple[RouteLine, NDArray[np.bool_]]:
    """The line with its tight turns fitted to a car, and which of its points (P,) were."""
    parts: list[RouteLine] = []
    fitted: list[NDArray[np.bool_]] = []
    done = 0
    for turn in _tight_turns(line):
        piece = _fit(network, line, turn)
        if piece is None:
            continue
        parts += [_rows(line, slice(done, turn.start)), piece]
        fitted += [np.zeros(turn.start - done, dtype=bool), np.ones(len(piece.lane), dtype=bool)]
        done = turn.end + 1
    parts.append(_rows(line, slice(done, None)))
    fitted.append(np.zeros(len(line.lane) - done, dtype=bool))
    joined = RouteLine(
        np.concatenate([part.position_m for part in parts]),
        np.concatenate([part.heading_rad for part in parts]),
        np.concatenate([part.slope for part in parts]),
        np.concatenate([part.lane for part in parts]),
        np.concatenate([part.station_m for part in parts]),
    )
    return joined, np.concatenate(fitted)


def _rows(line: RouteLine, rows: slice) -> RouteLine:
    p, h, slope, lane, station = line
    return RouteLine(p[rows], h[rows], slope[rows], lane[rows], station[rows])


def _tight_turns(line: RouteLine) -> list[_Turn]:
    """Turns that are too tight, none of them reaching into its neighbours."""
    s = _along(line.position_m[:, :2])
    heading = np.unwrap(line.heading_rad)

    def bend(window_m: float) -> Array:
        ahead, behind = (np.interp(s + side * window_m, s, heading) for side in (0.5, -0.5))
        return np.abs(ahead - behind) / window_m

    tight = np.flatnonzero((bend(WINDOW_M) > 1.0 / TIGHT_M) | (bend(0.5 * WINDOW_M) > 1.0 / KINK_M))
    if not len(tight):
        return []
    apart = np.flatnonzero(np.diff(s[tight]) > _MERGE_M)
    runs = [(int(run[0]), int(run[-1])) for run in np.split(tight, apart + 1)]
    turns = []
    for k, (first, last) in enumerate(runs):
        low = 0.5 * (s[runs[k - 1][1]] + s[first]) if k else s[0]
        high = 0.5 * (s[last] + s[runs[k + 1][0]]) if k + 1 < len(runs) else s[-1]
        start = int(np.searchsorted(s, max(low, s[first] - LEAD_M)))
        end = int(np.searchsorted(s, min(high, s[last] + LEAD_M))) - 1
        if start < first and last < end:
            turns.append(_Turn(start, first, last, end))
    return turns


def _along(xy_m: Array) -> Array:
    step = np.diff(xy_m, axis=0)
    return np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])


def _fit(network: LaneNetwork, line: RouteLine, turn: _Turn) -> RouteLine | None:
    """The best line through a turn, None where nothing is better than the lane's middle."""
    own = _rows(line, slice(turn.start, turn.end + 1))
    xy, heading = own.position_m[:, :2], np.unwrap(own.heading_rad)
    s = _along(xy)
    begins, ends = s[turn.first - turn.start], s[turn.last - turn.start]
    outward = -np.sign(heading[-1] - heading[0])
    room = _room(network, own)
    best, least = None, _cost(xy, heading, room)
    for before, behind, aside, handle in itertools.product(_BEGINS_M, _BEGINS_M, _ASIDE_M, _HANDLES):
        a, b = begins - before, ends + behind
        if a < 0.2 or b > s[-1] - 0.2 or b - a < 2.0:
            continue
        path = _candidate(s, xy, heading, (a, b), outward * aside, handle)
        cost = _cost(*path, room) + 0.02 * aside
        if cost < least:
            best, least = path, cost
    return None if best is None else _as_line(own, *best)


def _candidate(
    s: Array, xy: Array, heading: Array, span: tuple[float, float], aside_m: float, handle: float
) -> tuple[Array, Array]:
    """Points (N, 2) and headings of one line: aside of the middle up to the turn, a cubic, and back."""
    a, b = span
    count = max(2, round(a / SAMPLE_M))
    lead, into = _beside(s, xy, heading, np.linspace(0.0, a, count + 1), aside_m, rising=True)
    count = max(2, round((s[-1] - b) / SAMPLE_M))
    tail, out = _beside(s, xy, heading, np.linspace(b, s[-1], count + 1), aside_m, rising=False)
    reach = handle * float(np.hypot(*(tail[0] - lead[-1])))
    p1 = lead[-1] + reach * np.array([np.cos(into), np.sin(into)])
    p2 = tail[0] - reach * np.array([np.cos(out), np.sin(out)])
    f = np.linspace(0.0, 1.0, max(4, round((b - a) / SAMPLE_M)) + 1)[:, None]
    g = 1.0 - f
    curve = g**3 * lead[-1] + 3 * g * g * f * p1 + 3 * g * f * f * p2 + f**3 * tail[0]
    path = np.concatenate([lead[:-1], curve, tail[1:]])
    step = np.gradient(path, axis=0)
    turned = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    turned += 2 * np.pi * np.round((heading[0] - turned[0]) / (2 * np.pi))
    turned[0], turned[-1] = heading[0], heading[-1]
    return path, turned


def _beside(
    s: Array, xy: Array, heading: Array, at: Array, aside_m: float, *, rising: bool
) -> tuple[Array, float]:
    """Points beside the middle, to the left by up to `aside_m`, and the middle's heading where it is all."""
    share = (at - at[0]) / (at[-1] - at[0])
    share = share if rising else 1.0 - share
    off = aside_m * share**3 * (10.0 - share * (15.0 - 6.0 * share))
    h = np.interp(at, s, heading)
    points = np.stack([np.interp(at, s, xy[:, k]) for k in range(2)], axis=-1)
    points += off[:, None] * np.stack([-np.sin(h), np.cos(h)], axis=-1)
    return points, float(h[-1] if rising else h[0])


def _cost(xy: Array, heading: Array, room: _Room) -> float:
    """How far a car leaves the lanes on a line, and how much it bends too much [m]."""
    s = _along(xy)
    bend = np.abs(np.interp(s + 1.0, s, heading) - np.interp(s - 1.0, s, heading)) / 2.0
    c, n = np.cos(heading)[:, None], np.sin(heading)[:, None]
    x = xy[:, :1] + c * _BODY[:, 0] - n * _BODY[:, 1]
    y = xy[:, 1:] + n * _BODY[:, 0] + c * _BODY[:, 1]
    off = room.at(np.stack([x.ravel(), y.ravel()], axis=-1)).reshape(len(xy), -1).max(axis=1)
    tight = max(0.0, float(bend.max()) - 1.0 / EASY_M)
    return float(off.max()) + 0.3 * float(off.mean()) + _TOO_TIGHT * tight + 0.2 * float(bend.max())


def _room(network: LaneNetwork, own: RouteLine) -> _Room:
    """Where a car may go about a turn: lanes in junctions, its own lanes, and the verges beside these."""
    low = own.position_m[:, :2].min(axis=0) - _REACH_M
    high = own.position_m[:, :2].max(axis=0) + _REACH_M
    count = np.ceil((high - low) / _CELL_M).astype(int) + 1
    x, y = (low[k] + (np.arange(count[k]) + 0.5) * _CELL_M for k in range(2))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    lanes = shapely.union_all(_lanes_near(network, own, low, high), grid_size=1e-4)
    shapely.prepare(lanes)
    free = shapely.contains_xy(lanes, grid[:, 0], grid[:, 1]).reshape(count)
    return _Room(low, distance_transform_edt(~free) * _CELL_M if free.any() else np.zeros(count))


def _lanes_near(network: LaneNetwork, own: RouteLine, low: Array, high: Array) -> list[Area]:
    tables = network.tables
    mine = {int(n) for n in np.unique(own.lane)}
    roads = {network.lanes[n].road_id for n in mine}
    inside = np.all((tables.position_m[:, :2] > low) & (tables.position_m[:, :2] < high), axis=1)
    level = np.abs(tables.position_m[:, 2] - float(own.position_m[:, 2].mean())) < _LEVEL_M
    rows = np.flatnonzero(inside & level)
    owner = np.searchsorted(tables.first, rows, side="right") - 1
    found = []
    for number in np.unique(owner).tolist():
        lane = network.lanes[number]
        crossing = lane.junction_id is not None and lane.type in DRIVABLE_TYPES
        if not (number in mine or crossing or (lane.type in _ROOM and lane.road_id in roads)):
            continue
        at = slice(int(tables.first[number]), int(tables.first[number] + tables.count[number]))
        half = 0.5 * tables.width_m[at][:, None]
        left = np.stack([-np.sin(tables.heading_rad[at]), np.cos(tables.heading_rad[at])], axis=-1)
        middle = tables.position_m[at, :2]
        found.append(strip_polygon(middle + half * left, middle - half * left))
    return found


def _as_line(own: RouteLine, xy: Array, heading: Array) -> RouteLine:
    """Points of a fitted line with heights, lanes and stations of the middle beside them."""
    nearest = np.asarray(cKDTree(own.position_m[:, :2]).query(xy)[1])
    nearest[0], nearest[-1] = 0, len(own.lane) - 1
    row = np.maximum.accumulate(nearest)
    position = np.column_stack([xy, own.position_m[row, 2]])
    return RouteLine(position, heading, own.slope[row], own.lane[row], own.station_m[row])
