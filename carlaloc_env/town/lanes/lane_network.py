"""The lane network of a map: where every lane runs, what follows it, and what stands beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.geometry.transforms import wrap_angle
from carlaloc_env.core.road.road_profile import Relief
from carlaloc_env.town.lanes.centre_lines import KeepTables, LanePose, LaneTables, build_tables
from carlaloc_env.town.lanes.nearest_lane import LaneSearch, NearestLane
from carlaloc_env.town.lanes.records import Crosswalk, SignalHead, StaticSign
from carlaloc_env.town.lanes.topology import DRIVABLE_TYPES, BrokenLink, LaneLinks
from carlaloc_env.town.opendrive.records import OpenDrive, Road
from carlaloc_env.town.opendrive.road_surface import RoadSurface

CLEARANCE_M = 4.5
"""Free height that vehicles need under roofs and roads [m]."""
DEFAULT_LIMIT_MPS = 50.0 / 3.6
"""Where neither the lane, its road nor any lane leading to it states a limit."""
NO_LIMIT_MPS = 130.0 / 3.6
"""Stands for "no limit"."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lane:
    """One lane of one lane section. Stations run in travel direction along the lane's centre."""

    index: int
    road_id: str
    section: int
    lane_id: int
    type: str
    length_m: float
    junction_id: str | None
    forward: bool
    """True if traffic runs with growing s."""
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    left: int | None
    """Driving lane to the left with the same travel direction."""
    right: int | None
    """Driving lane to the right with the same travel direction."""
    speed_limit_mps: float
    """Lowest limit on the lane."""


class LaneNetwork:
    """Lanes, signals and crosswalks of one OpenDRIVE map. World frame ENU, metres.

    `build_network` makes one with all that stands along its lanes; a bare one has lanes alone.
    """

    def __init__(
        self, xodr: OpenDrive, relief: Relief | None = None, *, keep: KeepTables | None = None
    ) -> None:
        """Builds the lanes, on a relief where there is one.

        Args:
            xodr: The map.
            relief: Undulation that the file does not hold.
            keep: Gives the tables that were kept of these lanes, or what it is handed makes anew.

        Raises:
            MapError: The map is too large, or a lane is not finite.
        """
        self.xodr = xodr
        self.road_index: dict[str, int] = {road.id: n for n, road in enumerate(xodr.roads)}
        """Road id → road number, as `surface` counts them."""
        with np.errstate(all="ignore"):
            self.surface = RoadSurface(xodr.roads, relief)
            edges = self.surface.edges
            if not edges.lanes:
                raise MapError(f"{xodr.source} has no lanes beside centre lanes; export its lanes")
            roads = [xodr.roads[n] for n in edges.road]
            forward = [
                (lane.id < 0) != road.left_hand_traffic for lane, road in zip(edges.lanes, roads, strict=True)
            ]
            links = LaneLinks(xodr, self.surface, forward)
            self.broken_links: tuple[BrokenLink, ...] = tuple(links.broken)
            start = np.array([section.s_m for section in edges.sections])
            end = np.array([section.end_m for section in edges.sections])
            self.forward: NDArray[np.bool_] = np.array(forward, dtype=bool)
            """True where traffic runs with growing s, (N,)."""
            self._start_s: Array = np.where(self.forward, start, np.maximum(end, start))
            labels = [
                f"{xodr.source}: line {lane.line}: lane {lane.id} of road {road.id}"
                for lane, road in zip(edges.lanes, roads, strict=True)
            ]
            limits = _speed_limits(self.surface, xodr.roads, links.predecessors)
            rank = np.array([abs(lane.id) for lane in edges.lanes], dtype=np.int64)
            make = partial(build_tables, self.surface, start, end, self.forward, limits, rank, labels)
            self.tables: LaneTables = make() if keep is None else keep(make)
            self.lanes: tuple[Lane, ...] = self._lanes(links)
            self._searches: dict[tuple[tuple[str, ...], int], LaneSearch] = {}
        self.signals: tuple[SignalHead, ...] = ()
        self.static_signs: tuple[StaticSign, ...] = ()
        self.crosswalks: tuple[Crosswalk, ...] = ()

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
        result: Array = self._start_s[lanes] + np.where(self.forward[lanes], along, -along)
        return result

    def station_m(self, lane: ArrayLike, s_m: ArrayLike) -> Array:
        """Stations [m] of road coordinates s, clipped to the lanes, (M,)."""
        lanes, s = _queries(lane, s_m)
        along = (s - self._start_s[lanes]) * np.where(self.forward[lanes], 1.0, -1.0)
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

    def _lanes(self, links: LaneLinks) -> tuple[Lane, ...]:
        edges, tables = self.surface.edges, self.tables
        lowest = np.minimum.reduceat(tables.speed_limit_mps, tables.first)
        lanes = []
        for n, lane in enumerate(edges.lanes):
            r, k = int(edges.road[n]), int(edges.section[n])
            forward = bool(self.forward[n])
            lanes.append(
                Lane(
                    index=n,
                    road_id=self.xodr.roads[r].id,
                    section=k,
                    lane_id=lane.id,
                    type=lane.type,
                    length_m=float(tables.length_m[n]),
                    junction_id=self.xodr.roads[r].junction_id,
                    forward=forward,
                    successors=tuple(links.successors[n]),
                    predecessors=tuple(links.predecessors[n]),
                    left=self._neighbour(r, k, lane.id, 1 if forward else -1),
                    right=self._neighbour(r, k, lane.id, -1 if forward else 1),
                    speed_limit_mps=float(lowest[n]),
                )
            )
        return tuple(lanes)

    def _neighbour(self, road: int, section: int, lane_id: int, step: int) -> int | None:
        edges = self.surface.edges
        other = edges.index.get((road, section, lane_id + step))
        own = edges.lanes[edges.index[road, section, lane_id]]
        same_side = (lane_id + step) * lane_id > 0
        if other is None or not same_side or own.type != "driving" or edges.lanes[other].type != "driving":
            return None
        return other


def _queries(lane: ArrayLike, station_m: ArrayLike) -> tuple[Index, Array]:
    lanes, stations = np.broadcast_arrays(
        np.asarray(lane, dtype=np.int64), np.asarray(station_m, dtype=np.float64)
    )
    return np.atleast_1d(lanes), np.atleast_1d(stations)


def _speed_limits(
    surface: RoadSurface, roads: Sequence[Road], predecessors: Sequence[Sequence[int]]
) -> list[list[tuple[float, float]]]:
    """Per lane, ascending (s, limit): the lane's own records, else the road's, else what leads to it."""
    edges = surface.edges
    found: list[list[tuple[float, float]]] = []
    for n, lane in enumerate(edges.lanes):
        section = edges.sections[n]
        records = lane.speeds or tuple(
            r for r in roads[edges.road[n]].speeds if r.s_m < section.end_m or r.s_m <= section.s_m
        )
        found.append([(r.s_m, min(r.limit_mps, NO_LIMIT_MPS)) for r in records])
    # Connecting roads rarely state a limit: a lane takes over the one of the lanes before it.
    for _ in range(4):
        for n, own in enumerate(found):
            if not own and edges.lanes[n].type in DRIVABLE_TYPES:
                before = [found[m][-1][1] for m in predecessors[n] if found[m]]
                if before:
                    found[n] = [(edges.sections[n].s_m, min(before))]
    return [own or [(edges.sections[n].s_m, DEFAULT_LIMIT_MPS)] for n, own in enumerate(found)]
