"""Builds all lanes of a map: which follow each other, which lie side by side, and where a car fits."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.core.ego import EGO_SIZE_M
from carlaloc_env.core.errors import MapError
from carlaloc_env.map.lanes.centre_lines import LaneTables, build_tables
from carlaloc_env.map.lanes.lanes import Lane
from carlaloc_env.map.lanes.speed_limits import lane_limits_mps
from carlaloc_env.map.lanes.topology import DRIVABLE_TYPES, LaneLinks
from carlaloc_env.map.opendrive.lane_boundaries import LaneEdges
from carlaloc_env.map.opendrive.records import OpenDrive
from carlaloc_env.map.opendrive.road_surface import RoadSurface
from carlaloc_env.road.road_profile import Relief

CAR_WIDTH_M = EGO_SIZE_M[1]
"""No car drives where a lane is narrower [m]."""
TAPER_M = 0.01
"""Lanes whose width varies by less are as wide all along [m]."""


class RoadMap(NamedTuple):
    """A map, and its roads as surfaces."""

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
    limits = lane_limits_mps(surface, xodr.roads, links.predecessors)
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
    """Lanes by the room that they leave to a car, each field (N,)."""

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
