"""Crosswalks: their outline in the world, the way across, and the lanes they cross."""

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Crosswalk
from carlaloc_env.map.lanes.signals import object_pose
from carlaloc_env.map.opendrive.records import CornerLocal, Outline, Road, RoadObject


def outline_points(
    network: LaneNetwork, road: Road, item: RoadObject, outline: Outline
) -> NDArray[np.float64]:
    """World corners (K, 3) of an object's outline, bottom edge."""
    local = [c for c in outline.corners if isinstance(c, CornerLocal)]
    if local:
        T = object_pose(network, road, item)
        points = np.array([(c.u_m, c.v_m, c.z_m) for c in local])
        return points[:, :1] * T[:3, 0] + points[:, 1:2] * T[:3, 1] + points[:, 2:] * T[:3, 2] + T[:3, 3]
    corners = [c for c in outline.corners if not isinstance(c, CornerLocal)]
    if not corners:
        return np.zeros((0, 3))
    n = np.full(len(corners), network.road_index[road.id])
    s, t, dz = (np.array(k) for k in zip(*((c.s_m, c.t_m, c.dz_m) for c in corners), strict=True))
    return network.surface.position(n, s, t, dz)


def find_crosswalks(network: LaneNetwork) -> tuple[Crosswalk, ...]:
    """All crosswalks of a map in file order; objects without a usable outline use length and width."""
    crosswalks = []
    for road in network.xodr.roads:
        for item in road.objects:
            if item.type == "crosswalk" or item.name.lower().endswith("crosswalk"):
                crosswalk = _crosswalk(network, road, item)
                if crosswalk is not None:
                    crosswalks.append(crosswalk)
    return tuple(crosswalks)


def _crosswalk(network: LaneNetwork, road: Road, item: RoadObject) -> Crosswalk | None:
    points = np.zeros((0, 3))
    for outline in item.outlines:
        points = outline_points(network, road, item, outline)
        if len(points) >= 3:
            break
    if len(points) < 3 and min(item.length_m, item.width_m) > 0.0:
        half = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * 0.5
        T = object_pose(network, road, item)
        points = T[:3, 3] + half[:, :1] * item.length_m * T[:3, 0] + half[:, 1:] * item.width_m * T[:3, 1]
    if len(points) > 3 and np.hypot(*(points[0] - points[-1])[:2]) < 1e-3:
        points = points[:-1]
    if len(points) < 3:
        return None
    road_heading = float(
        network.surface.heading(np.array([network.road_index[road.id]]), np.array([item.s_m]))[0]
    )
    start, end, width = _axis(points, road_heading)
    lanes, spans = _crossed(network, points)
    return Crosswalk(
        id=item.id,
        road_id=road.id,
        polygon_m=points,
        start_m=start,
        end_m=end,
        width_m=width,
        lanes=lanes,
        span_m=spans,
    )


def _axis(
    points: NDArray[np.float64], road_heading_rad: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """End points and width of the way across: the longer side, or where equal, square to the road."""
    centre = points.mean(axis=0)
    xy = points[:, :2] - centre[:2]
    xx, yy, xy_sum = (float(np.sum(k)) for k in (xy[:, 0] ** 2, xy[:, 1] ** 2, xy[:, 0] * xy[:, 1]))
    # Principal axis of the corners, in closed form.
    turn = 0.5 * elementary.arctan2(2.0 * xy_sum, xx - yy)
    spread = math.hypot(xx - yy, 2.0 * xy_sum)
    if xx + yy + spread < 1.7 * (xx + yy - spread):
        turn = road_heading_rad + 0.5 * math.pi
    axis = np.array([elementary.cos(turn), elementary.sin(turn)])
    along = xy[:, 0] * axis[0] + xy[:, 1] * axis[1]
    across = xy[:, 1] * axis[0] - xy[:, 0] * axis[1]
    middle = 0.5 * (across.max() + across.min())
    ends = []
    for reach, near in ((along.min(), along <= np.median(along)), (along.max(), along >= np.median(along))):
        xy_end = centre[:2] + reach * axis + middle * np.array([-axis[1], axis[0]])
        ends.append(np.array([xy_end[0], xy_end[1], points[near, 2].mean()]))
    return ends[0], ends[1], float(across.max() - across.min())


def _crossed(
    network: LaneNetwork, polygon: NDArray[np.float64]
) -> tuple[tuple[int, ...], tuple[tuple[float, float], ...]]:
    """Driving lanes whose centre line runs through the polygon, with the stations of entry and exit."""
    tables = network.tables
    low, high = polygon.min(axis=0) - 1e-9, polygon.max(axis=0) + 1e-9
    p = tables.position_m
    near = np.flatnonzero(
        (p[:, 0] >= low[0])
        & (p[:, 0] <= high[0])
        & (p[:, 1] >= low[1])
        & (p[:, 1] <= high[1])
        & (p[:, 2] >= low[2] - 2.5)
        & (p[:, 2] <= high[2] + 2.5)
    )
    inside = near[_inside(p[near, :2], polygon[:, :2])]
    owner = np.searchsorted(tables.first, inside, side="right") - 1
    lanes, spans = [], []
    for lane in np.unique(owner):
        if network.lanes[lane].type == "driving":
            rows = inside[owner == lane] - tables.first[lane]
            step = float(tables.step_m[lane])
            lanes.append(int(lane))
            spans.append((float(rows.min()) * step, float(rows.max()) * step))
    return tuple(lanes), tuple(spans)


def _inside(points: NDArray[np.float64], polygon: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Even-odd rule, points (M, 2), polygon (K, 2)."""
    result = np.zeros(len(points), dtype=bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        crosses = (a[1] > points[:, 1]) != (b[1] > points[:, 1])
        rise = b[1] - a[1]
        x = a[0] + (points[:, 1] - a[1]) / (rise if rise != 0.0 else 1.0) * (b[0] - a[0])
        result ^= crosses & (points[:, 0] < x)
    return result
