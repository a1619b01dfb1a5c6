"""The lane network of a map: where every lane runs, what follows it, and what stands beside it.

Nearest lane of any point.
"""

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.point_tree import point_tree
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.centre_lines import TABLE_STEP_M, LanePose, LaneTables
from carlaloc_env.map.lanes.lanes import Crosswalk, LaneRecords, RoadMap, SignalHead, StaticSign
from carlaloc_env.map.lanes.topology import LaneLinks
from carlaloc_env.map.opendrive.records import Note, OpenDrive
from carlaloc_env.map.opendrive.road_surface import RoadSurface

_CANDIDATES = 8


class NearestLane(NamedTuple):
    """Where points lie on the lanes nearest to them, each field (M,)."""

    lane: Index
    station_m: Array
    offset_m: Array
    """To the left of the lane centre, in travel direction."""
    distance_m: Array
    """To the lane centre, in the dimensions of the points given."""


class LaneSearch:
    """A k-d tree over the samples of some lanes."""

    def __init__(self, tables: LaneTables, lanes: Index, dimensions: int) -> None:
        """Gathers the samples of `lanes` in the plane (2) or in space (3)."""
        self._tables = tables
        self._dimensions = dimensions
        owner = np.repeat(np.arange(len(tables.count)), tables.count)
        self._rows: Index = np.flatnonzero(np.isin(owner, lanes)).astype(np.int64)
        self._owner: Index = owner[self._rows]
        self._tree = point_tree(tables.position_m[self._rows, :dimensions])

    def nearest(self, points_m: NDArray[np.float64]) -> NearestLane:
        """Nearest lanes of points (M, 2 or 3); equal distances go to the lower lane number."""
        points = points_m[:, : self._dimensions]
        number = min(_CANDIDATES, len(self._rows))
        _, near = self._tree.query(points, k=np.arange(1, number + 1))
        lane, station, offset, distance = self._project(np.repeat(points, number, axis=0), near.reshape(-1))
        # A micrometre decides nothing: there the lane number does.
        keys = (lane.reshape(-1, number), np.round(distance, 6).reshape(-1, number))
        best = np.lexsort(keys, axis=-1)[:, 0] + np.arange(len(points)) * number
        return NearestLane(lane[best], station[best], offset[best], distance[best])

    def within(self, point_m: NDArray[np.float64], radius_m: float) -> NearestLane:
        """All lanes that come within a reach [m] of one point, the nearest first."""
        near = np.array(self._tree.query_ball_point(point_m, radius_m + TABLE_STEP_M), dtype=np.int64)
        points = np.repeat(point_m[None], len(near), axis=0)
        lane, station, offset, distance = self._project(points, near)
        order = np.lexsort((station, distance, lane))
        _, first = np.unique(lane[order], return_index=True)
        best = order[first]
        best = best[distance[best] <= radius_m]
        best = best[np.argsort(distance[best], kind="stable")]
        return NearestLane(lane[best], station[best], offset[best], distance[best])

    def _project(self, points: NDArray[np.float64], near: Index) -> tuple[Index, Array, Array, Array]:
        tables, lane = self._tables, self._owner[near]
        row = self._rows[near]
        station = (row - tables.first[lane]) * tables.step_m[lane]
        length = tables.length_m[lane]
        for _ in range(3):
            pose = tables.pose(lane, station)
            c, s = elementary.cos(pose.heading_rad), elementary.sin(pose.heading_rad)
            dx, dy = points[:, 0] - pose.position_m[:, 0], points[:, 1] - pose.position_m[:, 1]
            ahead, left = c * dx + s * dy, c * dy - s * dx
            # Newton on the foot point; 1 − κ·offset is kept positive inside the curve's centre.
            move = ahead / np.maximum(1.0 - pose.curvature_radpm * left, 0.2)
            station = np.clip(station + np.clip(move, -1.0, 1.0), 0.0, length)
        pose = tables.pose(lane, station)
        delta = points - pose.position_m[:, : self._dimensions]
        c, s = elementary.cos(pose.heading_rad), elementary.sin(pose.heading_rad)
        offset = c * delta[:, 1] - s * delta[:, 0]
        return lane, station, offset, np.sqrt(np.sum(delta * delta, axis=1))


CLEARANCE_M = 4.5
"""Free height that vehicles need under roofs and roads [m]."""


class LaneNetwork:
    """Lanes, signals and crosswalks of one OpenDRIVE map. World frame ENU, metres.

    `build_network` makes one with all that stands along its lanes.
    """

    def __init__(self, read: Callable[[], RoadMap], lanes: LaneRecords) -> None:
        """Takes what is known of the lanes.

        Args:
            read: Reads the map; called at the first question that the lanes cannot answer.
            lanes: The lanes.
        """
        self._read = read
        self.forward = lanes.forward
        """True where traffic runs with growing s, (N,)."""
        self.start_s_m = lanes.start_s_m
        """Road coordinate s at which each lane begins, in travel direction [m], (N,)."""
        self.tables = lanes.tables
        """Samples of all lanes."""
        self.lanes = lanes.lanes
        """All lanes, in the order of the file."""
        self._searches: dict[tuple[tuple[str, ...], int], LaneSearch] = {}
        self.bank: Array = np.zeros(0)
        """Rise of the road per metre to the left of the lane's direction at all samples, (R,)."""
        self.signals: tuple[SignalHead, ...] = ()
        self.static_signs: tuple[StaticSign, ...] = ()
        self.crosswalks: tuple[Crosswalk, ...] = ()

    @cached_property
    def _map(self) -> RoadMap:
        return self._read()

    @property
    def xodr(self) -> OpenDrive:
        """The map."""
        return self._map.xodr

    @property
    def surface(self) -> RoadSurface:
        """Its roads as surfaces."""
        return self._map.surface

    @cached_property
    def road_index(self) -> dict[str, int]:
        """Road id → road number, as `surface` counts them."""
        return {road.id: n for n, road in enumerate(self.xodr.roads)}

    @cached_property
    def broken_links(self) -> tuple[Note, ...]:
        """Links of the map that lead nowhere."""
        return tuple(LaneLinks(self.xodr, self.surface, self.forward.tolist()).broken)

    @property
    def sidewalks(self) -> tuple[int, ...]:
        """Numbers of all lanes of type sidewalk."""
        return tuple(lane.index for lane in self.lanes if lane.type == "sidewalk")

    def pose(self, lane: ArrayLike, station_m: ArrayLike) -> LanePose:
        """Poses on lane centres from the half-metre tables; arrays (M,)."""
        return self.tables.pose(*_queries(lane, station_m))

    def exact_pose(self, lane: ArrayLike, station_m: ArrayLike) -> LanePose:
        """Poses on lane centres from the file's own formulas; arrays (M,)."""
        lanes, stations = _queries(lane, station_m)
        curve = self.surface.lane_centre(lanes, self.s_m(lanes, stations))
        sign = np.where(self.forward[lanes], 1.0, -1.0)
        heading = wrap_angle(curve.heading_rad + np.where(self.forward[lanes], 0.0, np.pi))
        return LanePose(
            curve.position_m, heading, elementary.arctan(curve.slope) * sign, curve.curvature_radpm * sign
        )

    def s_m(self, lane: ArrayLike, station_m: ArrayLike) -> Array:
        """Road coordinate s [m] of stations, (M,)."""
        lanes, stations = _queries(lane, station_m)
        along = self.tables.along(lanes, stations)
        result: Array = self.start_s_m[lanes] + np.where(self.forward[lanes], along, -along)
        return result

    def station_m(self, lane: ArrayLike, s_m: ArrayLike) -> Array:
        """Stations [m] of road coordinates s, clipped to the lanes, (M,)."""
        lanes, s = _queries(lane, s_m)
        along = (s - self.start_s_m[lanes]) * np.where(self.forward[lanes], 1.0, -1.0)
        return self.tables.station(lanes, along)

    def station_at(self, lane: int, s_m: float) -> float:
        """Station [m] of one road coordinate s on one lane."""
        return float(self.station_m([lane], [s_m])[0])

    def width_m(self, lane: ArrayLike, station_m: ArrayLike) -> Array:
        """Lane widths [m], (M,)."""
        row, f = self.tables.locate(*_queries(lane, station_m))
        width: Array = self.tables.width_m[row] * (1.0 - f) + self.tables.width_m[row + 1] * f
        return width

    def speed_limit_mps(self, lane: ArrayLike, station_m: ArrayLike) -> Array:
        """Speed limits [m/s], (M,)."""
        row, _ = self.tables.locate(*_queries(lane, station_m))
        limit: Array = self.tables.speed_limit_mps[row]
        return limit

    def lanes_at(self, road_id: str, s_m: float) -> list[tuple[int, int]]:
        """(lane id, lane number) of all lanes of a road at s, from left to right."""
        n = self.road_index[road_id]
        sections = self.xodr.roads[n].sections
        k = max((k for k, section in enumerate(sections) if section.s_m <= s_m), default=0)
        index = self.surface.edges.index
        return [(lane.id, index[n, k, lane.id]) for lane in sections[k].lanes if lane.id != 0]

    def nearest(self, points_m: ArrayLike, types: Sequence[str] = ("driving",)) -> NearestLane:
        """Nearest lanes of world points (M, 2) or (M, 3); with three columns, in space.

        Raises:
            MapError: The map has no lane of these types.
        """
        points = np.atleast_2d(np.asarray(points_m, dtype=np.float64))
        return self._search(types, points.shape[1]).nearest(points)

    def within(self, point_m: ArrayLike, radius_m: float, types: Sequence[str] = ("driving",)) -> NearestLane:
        """Every lane that comes within a reach [m] of one point (2|3,), the nearest first."""
        point = np.asarray(point_m, dtype=np.float64)
        return self._search(types, len(point)).within(point, radius_m)

    def _search(self, types: Sequence[str], dimensions: int) -> LaneSearch:
        key = (tuple(sorted(types)), dimensions)
        if key not in self._searches:
            own = np.array([lane.index for lane in self.lanes if lane.type in types], dtype=np.int64)
            if not len(own):
                raise MapError(
                    f"{self.xodr.source} has no lane of type {', '.join(types)}; ask for another type"
                )
            self._searches[key] = LaneSearch(self.tables, own, dimensions)
        return self._searches[key]

    def waypoints(self, step_m: float) -> NDArray[np.void]:
        """Poses on all driving lanes at every step of s, on CARLA's grid of ``generate_waypoints``.

        Returns:
            Rows with fields road_id, section, lane_id, s, x, y, z [m], heading [rad] (travel direction).
        """
        lanes, s = self._grid(step_m)
        curve = self.surface.lane_centre(lanes, s)
        heading = wrap_angle(curve.heading_rad + np.where(self.forward[lanes], 0.0, np.pi))
        label = max((len(road.id) for road in self.xodr.roads), default=1)
        names = ("s", "x", "y", "z", "heading")
        kinds = [("road_id", f"U{label}"), ("section", "i4"), ("lane_id", "i4"), *((n, "f8") for n in names)]
        rows = np.zeros(len(lanes), dtype=kinds)
        rows["road_id"] = [self.lanes[n].road_id for n in lanes]
        rows["section"] = [self.lanes[n].section for n in lanes]
        rows["lane_id"] = [self.lanes[n].lane_id for n in lanes]
        for name, column in zip(names, (s, *curve.position_m.T, heading), strict=True):
            rows[name] = column
        return rows

    def _grid(self, step_m: float) -> tuple[Index, Array]:
        if not (math.isfinite(step_m) and step_m >= 0.01):
            raise MapError(f"waypoints cannot lie {step_m} m apart; use a step of 0.01 m or more")
        # CARLA adds the step again and again, starting at ten machine epsilons.
        tiny = 10.0 * np.finfo(np.float64).eps
        lanes: list[int] = []
        stations: list[float] = []
        for road in self.xodr.roads:
            s = tiny
            while s < road.length_m - tiny:
                own = [n for _, n in self.lanes_at(road.id, s) if self.lanes[n].type == "driving"]
                lanes += own
                stations += [s] * len(own)
                s += step_m
        return np.array(lanes, dtype=np.int64), np.array(stations, dtype=np.float64)


def _queries(lane: ArrayLike, station_m: ArrayLike) -> tuple[Index, Array]:
    lanes, stations = np.broadcast_arrays(
        np.asarray(lane, dtype=np.int64), np.asarray(station_m, dtype=np.float64)
    )
    return np.atleast_1d(lanes), np.atleast_1d(stations)
