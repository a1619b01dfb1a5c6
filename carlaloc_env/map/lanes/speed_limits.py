"""Speed limits: of lanes by station, and of whole roads."""

from collections.abc import Sequence

from carlaloc_env.map.lanes.topology import DRIVABLE_TYPES
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.map.opendrive.road_surface import RoadSurface

DEFAULT_LIMIT_MPS = 50.0 / 3.6
"""Where neither the lane, its road nor any lane leading to it states a limit."""
NO_LIMIT_MPS = 130.0 / 3.6
"""Stands for "no limit"."""


def lane_limits_mps(
    surface: RoadSurface, roads: Sequence[Road], predecessors: Sequence[Sequence[int]]
) -> list[list[tuple[float, float]]]:
    """Per lane, ascending (s, limit): the lane's own records, else the road's, else what leads to it."""
    edges = surface.edges
    limits_of: list[list[tuple[float, float]]] = []
    for n, lane in enumerate(edges.lanes):
        section = edges.sections[n]
        records = lane.speeds or tuple(
            r for r in roads[edges.road[n]].speeds if r.s_m < section.end_m or r.s_m <= section.s_m
        )
        limits_of.append([(r.s_m, min(r.limit_mps, NO_LIMIT_MPS)) for r in records])
    # Connecting roads rarely state a limit: a lane takes over the one of the lanes before it.
    for _ in range(4):
        for n, limits in enumerate(limits_of):
            if not limits and edges.lanes[n].type in DRIVABLE_TYPES:
                before = [limits_of[m][-1][1] for m in predecessors[n] if limits_of[m]]
                if before:
                    limits_of[n] = [(edges.sections[n].s_m, min(before))]
    return [limits or [(edges.sections[n].s_m, DEFAULT_LIMIT_MPS)] for n, limits in enumerate(limits_of)]


def road_limit_mps(road: Road) -> float:
    """Highest speed limit that a road states [m/s]."""
    stated = [record.limit_mps for record in road.speeds]
    stated += [r.limit_mps for section in road.sections for lane in section.lanes for r in lane.speeds]
    return min(max(stated), 60.0) if stated else DEFAULT_LIMIT_MPS
