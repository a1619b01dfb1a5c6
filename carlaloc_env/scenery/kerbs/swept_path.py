"""Where a car may go about a turn: how far kerbs are, the end of the asphalt, and its own lanes."""

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area, strip_polygon
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import (
    EGO_REAR_M,
    EGO_SIZE_M,
    EGO_TYRE_ENVELOPE_M,
    EGO_TYRE_OUTER_M,
    EGO_WHEELBASE_M,
)
from carlaloc_env.core.polylines import distance_along
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.topology import DRIVABLE_TYPES
from carlaloc_env.map.routing.smoothing import RouteLine
from carlaloc_env.scenery.ground.grade_graph import runs
from carlaloc_env.scenery.ground.lane_strips import Strip, road_strips
from carlaloc_env.scenery.ground.lowered_walks import lower_walks
from carlaloc_env.scenery.ground.paved_areas import town_areas

EASY_M = 4.75
"""Radius that a car can drive with some lock in hand [m]."""
WHEEL_ROOM_M, BODY_ROOM_M = 0.30, 0.05
"""How far wheels and body keep from kerbs [m]."""
_CELL_M = 0.1
_MARGIN_M = 8.0
_NEAR_M = 60.0
"""As far as the roads reach round an island [m]."""
_LEVEL_M = 2.0
_HIGH_M = 0.05
"""Edges that stand higher above the road are kerbs [m]."""
_TOO_TIGHT, _TOO_SUDDEN, _SUDDEN = 20.0, 1.0, 0.15
"""Cost of a curvature above the greatest [m per 1/m], and of one that changes faster than 0.15 /m a metre."""
_TYRE_M = np.array([-EGO_TYRE_ENVELOPE_M, 0.0, EGO_TYRE_ENVELOPE_M])
_ROOM = frozenset({"shoulder", "stop", "border", "parking", "biking", "bus", "restricted"})


def _both_sides(x: Array, y_m: float) -> Array:
    return np.stack(np.broadcast_arrays(x[None], np.array([[y_m], [-y_m]])), axis=-1).reshape(-1, 2)


WHEELS_M = _both_sides(np.concatenate([_TYRE_M, EGO_WHEELBASE_M + _TYRE_M]), EGO_TYRE_OUTER_M)
"""Where tyres touch, from the rear axle's middle [m], (W, 2)."""
BODY_M = _both_sides(EGO_REAR_M + np.linspace(0.0, EGO_SIZE_M[0], 6), 0.5 * EGO_SIZE_M[1])
"""The body's sides [m], (B, 2)."""


class FreeSpace(NamedTuple):
    """Distances on a grid of points."""

    low_m: Array
    kerb_m: Array
    """To the nearest raised kerb; below 0 on what it bounds [m]."""
    ground_m: Array
    """To the nearest asphalt, 0 on it [m]."""
    lanes_m: Array
    """To the junction's and the car's own lanes, 0 on them [m]."""

    def at(self, field: Array, points_m: Array) -> Array:
        """Values of one of the fields at points (N, 2)."""
        cell = ((points_m - self.low_m) / _CELL_M).astype(np.int64)
        i, j = (np.clip(cell[:, k], 0, field.shape[k] - 1) for k in range(2))
        result: Array = field[i, j]
        return result


def swept(xy_m: Array, heading_rad: Array, points_m: Array) -> Array:
    """Where points (K, 2) of a car come whose rear axle follows a line of N points, (N·K, 2)."""
    c, n = elementary.cos(heading_rad)[:, None], elementary.sin(heading_rad)[:, None]
    x = xy_m[:, :1] + c * points_m[:, 0] - n * points_m[:, 1]
    y = xy_m[:, 1:2] + n * points_m[:, 0] + c * points_m[:, 1]
    return np.stack([x.ravel(), y.ravel()], axis=-1)


def kerb_room(xy_m: Array, heading_rad: Array, room: FreeSpace) -> tuple[Array, Array]:
    """Least distance of the wheels and of the body to kerbs at each point of a line [m], (N,) each."""
    wheels, body = (
        room.at(room.kerb_m, swept(xy_m, heading_rad, places)).reshape(len(xy_m), -1).min(axis=1)
        for places in (WHEELS_M, BODY_M)
    )
    return wheels, body


def cost_of(xy_m: Array, heading_rad: Array, room: FreeSpace) -> float:
    """How ill a line suits the car: kerbs, ground beside the road, others' lanes, and bends too tight [m]."""
    s = distance_along(xy_m)
    bend = (np.interp(s + 1.0, s, heading_rad) - np.interp(s - 1.0, s, heading_rad)) / 2.0
    change = np.abs(np.interp(s + 1.0, s, bend) - np.interp(s - 1.0, s, bend)) / 2.0
    sharp = float(np.abs(bend).max())
    wheels, body = kerb_room(xy_m, heading_rad, room)
    wheels, body = np.maximum(WHEEL_ROOM_M - wheels, 0.0), np.maximum(BODY_ROOM_M - body, 0.0)
    points = swept(xy_m, heading_rad, BODY_M)
    ground, lanes = (
        room.at(field, points).reshape(len(xy_m), -1).max(axis=1) for field in (room.ground_m, room.lanes_m)
    )
    return float(
        4.0 * wheels.max()
        + 1.5 * body.max()
        + wheels.mean()
        + 0.5 * body.mean()
        + 0.7 * ground.max()
        + 0.2 * ground.mean()
        + 0.3 * lanes.max()
        + 0.1 * lanes.mean()
        + _TOO_TIGHT * max(0.0, sharp - 1.0 / EASY_M)
        + _TOO_SUDDEN * max(0.0, float(change.max()) - _SUDDEN)
        + 0.2 * sharp
    )


def room_about(network: LaneNetwork, piece: RouteLine) -> FreeSpace:
    """Room about a piece of a route."""
    low = piece.position_m[:, :2].min(axis=0) - _MARGIN_M
    high = piece.position_m[:, :2].max(axis=0) + _MARGIN_M
    count = np.ceil((high - low) / _CELL_M).astype(int) + 1
    x, y = (low[k] + (np.arange(count[k]) + 0.5) * _CELL_M for k in range(2))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)

    def inside(area: Area) -> NDArray[np.bool_]:
        shapely.prepare(area)
        result: NDArray[np.bool_] = shapely.contains_xy(area, grid[:, 0], grid[:, 1]).reshape(count)
        return result

    raised, asphalt = (inside(area) for area in raised_near(network, piece))
    lanes = inside(shapely.union_all(_lanes_near(network, piece), grid_size=1e-4))
    return FreeSpace(low, _away(raised) - _away(~raised), _away(asphalt | lanes), _away(lanes))


def _away(here: NDArray[np.bool_]) -> Array:
    """Distance of every cell to the nearest that is set [m]; 50 m where none is."""
    from scipy.ndimage import distance_transform_edt

    result: Array = distance_transform_edt(~here) * _CELL_M if here.any() else np.full(here.shape, 50.0)
    return result


def raised_near(network: LaneNetwork, piece: RouteLine) -> tuple[Area, Area]:
    """Raised areas near a piece of a route (sidewalks and islands, as the town is built), and asphalt."""
    near = [network.lanes[n] for n in _lanes_about(network, piece, _NEAR_M)]
    junctions = {lane.junction_id for lane in near} - {None}
    roads = network.xodr.roads
    ids = {lane.road_id for lane in near} | {road.id for road in roads if road.junction_id in junctions}
    strips = lower_walks(road_strips(roads, network.surface, ids))
    areas = town_areas(strips, roads)
    corners = [junction.sidewalk for junction in areas.junctions]
    walks = [area for strip in strips if strip.junction_id is None for area in _high_walks(strip)]
    return shapely.union_all([areas.islands, *corners, *walks], grid_size=1e-4), areas.roadway


def _high_walks(strip: Strip) -> list[Area]:
    """Sidewalks and medians of a strip where they are not lowered."""
    walks = []
    for lane in range(len(strip.lanes)):
        if strip.kind(lane) not in ("sidewalk", "median"):
            continue
        left, right = strip.lane_edges(lane)
        up = strip.raised_m[lane].max(axis=0) > _HIGH_M
        walks += [strip_polygon(left[a:b], right[a:b]) for a, b in runs(up) if b - a > 1]
    return walks


def _lanes_about(network: LaneNetwork, piece: RouteLine, margin_m: float) -> list[int]:
    """Lanes at the level of a piece of a route that come into the box about it, `margin_m` wider."""
    tables = network.tables
    low, high = piece.position_m[:, :2].min(axis=0) - margin_m, piece.position_m[:, :2].max(axis=0) + margin_m
    inside = np.all((tables.position_m[:, :2] > low) & (tables.position_m[:, :2] < high), axis=1)
    level = np.abs(tables.position_m[:, 2] - float(piece.position_m[:, 2].mean())) < _LEVEL_M
    owner = np.searchsorted(tables.first, np.flatnonzero(inside & level), side="right") - 1
    lanes: list[int] = np.unique(owner).tolist()
    return lanes


def _lanes_near(network: LaneNetwork, piece: RouteLine) -> list[Area]:
    """Lanes in junctions, the route's own lanes, and the verges beside these."""
    tables = network.tables
    mine = {int(n) for n in np.unique(piece.lane)}
    roads = {network.lanes[n].road_id for n in mine}
    areas = []
    for number in _lanes_about(network, piece, _MARGIN_M):
        lane = network.lanes[number]
        crossing = lane.junction_id is not None and lane.type in DRIVABLE_TYPES
        if not (number in mine or crossing or (lane.type in _ROOM and lane.road_id in roads)):
            continue
        at = slice(int(tables.first[number]), int(tables.first[number] + tables.count[number]))
        half = 0.5 * tables.width_m[at][:, None]
        heading = tables.heading_rad[at]
        left = np.stack([-elementary.sin(heading), elementary.cos(heading)], axis=-1)
        middle = tables.position_m[at, :2]
        areas.append(strip_polygon(middle + half * left, middle - half * left))
    return areas
