"""Lanes, and what stands along them, as records; how lanes follow each other, and how fast one drives there.

Lanes, and what stands along them: traffic lights, signs, crosswalks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.core.errors import MapError
from carlaloc_env.map.lanes.centre_lines import LaneTables, build_tables
from carlaloc_env.map.lanes.topology import DRIVABLE_TYPES, LaneLinks
from carlaloc_env.map.opendrive.lane_boundaries import LaneEdges
from carlaloc_env.map.opendrive.records import OpenDrive, Road
from carlaloc_env.map.opendrive.road_surface import RoadSurface
from carlaloc_env.road.road_profile import Relief

SignKind = Literal["stop", "yield", "speed", "other"]
"""Meaning of a sign for drivers."""
SIGN_CODES: dict[SignKind, str] = {"stop": "206", "yield": "205", "speed": "274"}
"""CARLA's and RoadRunner's sign codes (after the German catalogue)."""
SIGN_KINDS = {code: kind for kind, code in SIGN_CODES.items()}
"""Kind of sign by code."""


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

    @property
    def kerb_side(self) -> int:
        """Side on which the kerb lies for its driver: −1 right, 1 left where traffic keeps to the left."""
        return -1 if (self.lane_id < 0) == self.forward else 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalHead:
    """A dynamic traffic light."""

    id: str
    name: str
    type: str
    T_world_signal: NDArray[np.float64]
    """Pose (4, 4); x faces the drivers it speaks to, z up."""
    width_m: float
    height_m: float
    lanes: tuple[int, ...]
    """Lanes that must stop for it."""
    stop_station_m: tuple[float, ...]
    """Where each of them must stop."""
    junction_lanes: tuple[int, ...]
    """Lanes inside the junction that it opens and closes."""
    controller_id: str | None
    junction_id: str | None
    sequence: int | None
    """Number of its controller in that junction: equal ones are green together."""
    road_id: str
    s_m: float
    t_m: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StaticSign:
    """A sign that never changes."""

    id: str
    kind: SignKind
    type: str
    T_world_sign: NDArray[np.float64]
    """Pose (4, 4); x faces the drivers it speaks to, z up."""
    lanes: tuple[int, ...]
    stop_station_m: tuple[float, ...]
    """Where each lane meets the sign: the stop line of stop and yield signs."""
    speed_mps: float | None
    road_id: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crosswalk:
    """A marked way for walkers across a road."""

    id: str
    road_id: str
    polygon_m: NDArray[np.float64]
    """World outline, first corner not repeated, (K, 3)."""
    start_m: NDArray[np.float64]
    """Middle of one kerb side (3,)."""
    end_m: NDArray[np.float64]
    """Middle of the other kerb side (3,)."""
    width_m: float
    """Extent along the road."""
    lanes: tuple[int, ...]
    """Driving lanes that it crosses."""
    span_m: tuple[tuple[float, float], ...]
    """Stations between which each of them is crossed."""


DEFAULT_LIMIT_MPS = 50.0 / 3.6
"""Where neither the lane, its road nor any lane leading to it states a limit."""
NO_LIMIT_MPS = 130.0 / 3.6
"""Stands for "no limit"."""


CAR_WIDTH_M = EGO_SIZE_M[1]
"""No car drives where a lane is narrower [m]."""
TAPER_M = 0.01
"""Lanes whose width varies by less are as wide all along [m]."""


class RoadMap(NamedTuple):
    """A map and its roads as surfaces."""

    xodr: OpenDrive
    """The map."""
    surface: RoadSurface
    """Its roads, on a relief where there is one."""


def road_map(xodr: OpenDrive, relief: Relief | None = None) -> RoadMap:
    """A map's roads, on undulation that the file does not hold; None: heights are exactly the file's."""
    with np.errstate(all="ignore"):
        return RoadMap(xodr, RoadSurface(xodr.roads, relief))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaneRecords:
    """Lanes of a map, N of them."""

    forward: Mask
    """True where traffic runs with growing s, (N,)."""
    start_s_m: Array
    """Road coordinate s at which each lane begins, in travel direction [m], (N,)."""
    tables: LaneTables
    """Samples of all lanes."""
    lanes: tuple[Lane, ...]
    """All lanes, in the order of the file."""


def build_lanes(roads: RoadMap) -> LaneRecords:
    """All lanes of a map.

    Raises:
        MapError: The map is too large, or a lane is not finite.
    """
    xodr, surface = roads
    edges = surface.edges
    if not edges.lanes:
        raise MapError(f"{xodr.source} has no lanes beside centre lanes; export its lanes")
    owners = [xodr.roads[n] for n in edges.road]
    is_forward = [
        (lane.id < 0) != road.left_hand_traffic for lane, road in zip(edges.lanes, owners, strict=True)
    ]
    links = LaneLinks(xodr, surface, is_forward)
    start = np.array([section.s_m for section in edges.sections])
    end = np.array([section.end_m for section in edges.sections])
    forward = np.array(is_forward, dtype=bool)
    labels = [
        f"{xodr.source}: line {lane.line}: lane {lane.id} of road {road.id}"
        for lane, road in zip(edges.lanes, owners, strict=True)
    ]
    limits = _speed_limits(surface, xodr.roads, links.predecessors)
    rank = np.array([abs(lane.id) for lane in edges.lanes], dtype=np.int64)
    tables = build_tables(surface, start, end, forward, limits, rank, labels)
    return LaneRecords(
        forward=forward,
        start_s_m=np.where(forward, start, np.maximum(end, start)),
        tables=tables,
        lanes=_lanes(xodr, edges, links, tables, is_forward),
    )


def _lanes(
    xodr: OpenDrive, edges: LaneEdges, links: LaneLinks, tables: LaneTables, is_forward: Sequence[bool]
) -> tuple[Lane, ...]:
    lowest = np.minimum.reduceat(tables.speed_limit_mps, tables.first)
    # Of a junction that is not in the file there is nothing but the road.
    junctions = {junction.id for junction in xodr.junctions}
    cars = np.array([lane.type in DRIVABLE_TYPES for lane in edges.lanes], dtype=bool)
    ways = _ways(tables, cars)
    lanes = []
    for n, lane in enumerate(edges.lanes):
        r, k = int(edges.road[n]), int(edges.section[n])
        forward = is_forward[n]
        lanes.append(
            Lane(
                index=n,
                road_id=xodr.roads[r].id,
                section=k,
                lane_id=lane.id,
                type="restricted" if ways.closed[n] else lane.type,
                length_m=float(tables.length_m[n]),
                junction_id=xodr.roads[r].junction_id if xodr.roads[r].junction_id in junctions else None,
                forward=forward,
                successors=tuple(m for m in links.successors[n] if ways.lead(n, m)),
                predecessors=tuple(m for m in links.predecessors[n] if ways.lead(m, n)),
                left=_neighbour(edges, ways, n, 1 if forward else -1),
                right=_neighbour(edges, ways, n, -1 if forward else 1),
                speed_limit_mps=float(lowest[n]),
            )
        )
    return tuple(lanes)


class _Ways(NamedTuple):
    """Where lanes are wide enough for a car, each field (N,)."""

    closed: Mask
    """Lanes of cars that narrow in their midst, or are narrow all along."""
    shrunk: Mask
    """Lanes that end narrow."""
    growing: Mask
    """Lanes that begin narrow."""

    def lead(self, lane: int, following: int) -> bool:
        """Whether a car gets from one lane onto the next."""
        waist = self.shrunk[lane] and self.growing[following]
        return bool(self.closed[lane] == self.closed[following] and not waist)


def _ways(tables: LaneTables, cars: Mask) -> _Ways:
    """Which lanes are too narrow to drive along; a taper at one end is not, since cars enter beside it."""
    width, first = tables.width_m, tables.first
    begin, end = width[first], width[first + tables.count - 1]
    least, most = np.minimum.reduceat(width, first), np.maximum.reduceat(width, first)
    narrow, varies = least < CAR_WIDTH_M, most - least >= TAPER_M
    closed = cars & narrow & ((least < np.minimum(begin, end) - TAPER_M) | ~varies)
    # A map on which no car could drive at all keeps its lanes.
    closed &= not closed[cars].all()
    return _Ways(closed, narrow & varies & (end == least), narrow & varies & (begin == least))


def _neighbour(edges: LaneEdges, ways: _Ways, n: int, step: int) -> int | None:
    lane = edges.lanes[n]
    other = edges.index.get((int(edges.road[n]), int(edges.section[n]), lane.id + step))
    if other is None or (lane.id + step) * lane.id <= 0 or ways.closed[[n, other]].any():
        return None
    return other if lane.type == "driving" and edges.lanes[other].type == "driving" else None


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
        for n, limits in enumerate(found):
            if not limits and edges.lanes[n].type in DRIVABLE_TYPES:
                before = [found[m][-1][1] for m in predecessors[n] if found[m]]
                if before:
                    found[n] = [(edges.sections[n].s_m, min(before))]
    return [limits or [(edges.sections[n].s_m, DEFAULT_LIMIT_MPS)] for n, limits in enumerate(found)]


def road_limit_mps(road: Road) -> float:
    """Highest speed limit that a road states [m/s]."""
    stated = [record.limit_mps for record in road.speeds]
    stated += [r.limit_mps for section in road.sections for lane in section.lanes for r in lane.speeds]
    return min(max(stated), 60.0) if stated else DEFAULT_LIMIT_MPS
