"""The lane network of a map: where every lane runs, what follows it, and what stands beside it."""

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.build_lanes import LaneRecords, RoadMap
from carlaloc_env.map.lanes.centre_lines import LanePose
from carlaloc_env.map.lanes.lane_search import LaneSearch, NearestLane
from carlaloc_env.map.lanes.lanes import Crosswalk, SignalHead, StaticSign
from carlaloc_env.map.lanes.topology import LaneLinks
from carlaloc_env.map.opendrive.records import Note, OpenDrive
from carlaloc_env.map.opendrive.road_surface import RoadSurface

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

    @property
    def driven_middles_m(self) -> Array:
        """Middles of all driving lanes every half metre [m], (M, 3)."""
        driven = np.array([lane.type == "driving" for lane in self.lanes], dtype=bool)
        return np.asarray(self.tables.position_m[np.repeat(driven, self.tables.count)])

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
