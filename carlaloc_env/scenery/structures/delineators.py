"""Reflecting posts along country roads, closer in bends."""

from collections.abc import Sequence

import numpy as np
import shapely

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scenery.ground.grade_levels import State
from carlaloc_env.scenery.ground.road_edges import RoadEdge, Waysides

SPACING_M = ((20.0, 3.0), (50.0, 5.0), (100.0, 10.0), (300.0, 20.0), (600.0, 50.0))
"""Radius of a bend and the distance of posts in it [m], after the German notes on delineators (HLB); the last
distance holds on straights."""
AWAY_M = 0.95
"""Distance from the road's edge, behind any rail [m]."""
ZONES = ("rural", "highway")
"""Zones whose roads have them."""
SMOOTH_M = 21
"""Length over which a bend's radius is taken [m]."""


def delineator_bases(ways: Waysides, paved: Area) -> tuple[Array, Array]:
    """Base points (N, 3) [m] of posts, and the direction of the traffic on their side [rad].

    Both sides of a road have them; of a road of one direction the kerb side alone. Their distances go on
    from one section of a road to the next.

    Args:
        ways: The ground beside the roads.
        paved: Everything paved or built, on which none stands.
    """
    country = ways.zones.area(*ZONES)
    for area in (country, paved):
        shapely.prepare(area)
    bases_m, yaws = [np.zeros((0, 3))], [np.zeros(0)]
    passed: dict[tuple[int, bool], float] = {}
    for edge in _in_driving_order(ways.edges):
        key = edge.strip.road, edge.name.endswith("right")
        count = passed.get(key, 0.5) + np.concatenate([[0.0], np.cumsum(1.0 / spacing_m(edge.line_m))])
        passed[key] = float(count[-1])
        if edge.sidewalk or against_traffic(edge):
            continue
        rows = np.flatnonzero(np.diff(np.floor(count)) > 0)
        xy = edge.line_m[rows, :2] + AWAY_M * edge.right[rows]
        free = shapely.distance(paved, shapely.points(xy)) > 0.6 * AWAY_M
        free &= shapely.contains_xy(country, xy[:, 0], xy[:, 1]) & (edge.state[rows] == State.GROUND)
        rows, xy = rows[free], xy[free]
        if len(rows):
            bases_m.append(np.column_stack([xy, ways.ground.height(xy) - 0.05]))
            traffic = edge.traffic[rows]
            yaws.append(elementary.arctan2(traffic[:, 1], traffic[:, 0]))
    return np.concatenate(bases_m), np.concatenate(yaws)


def spacing_m(line_m: Array) -> Array:
    """Distance of posts [m] at every metre of a line (N, 3) with a point per metre, shape (N − 1,)."""
    step = np.diff(line_m[:, :2], axis=0)
    turn = np.diff(np.unwrap(elementary.arctan2(step[:, 1], step[:, 0])))
    if len(turn) < 3:
        return np.full(len(step), SPACING_M[-1][1])
    width = min(SMOOTH_M, len(turn))
    curvature = np.abs(elementary.convolve(turn, np.ones(width) / width, mode="same"))
    curvature = np.concatenate([curvature[:1], curvature])
    radius, distance = np.array(SPACING_M).T
    spacing: Array = np.interp(1.0 / np.maximum(curvature, 1e-9), radius, distance)
    return spacing


def against_traffic(edge: RoadEdge) -> bool:
    """Whether the road is of one direction and the edge lies at its median or gore, not at its kerb."""
    strip = edge.strip
    forward = {strip.forward(k) for k, lane in enumerate(strip.lanes) if lane.type == "driving"}
    on_left = edge.name.endswith("left")
    return len(forward) == 1 and (on_left == forward.pop()) != strip.left_hand_traffic


def _in_driving_order(edges: Sequence[RoadEdge]) -> list[RoadEdge]:
    """Sections of each road in the order in which the edge's line meets them."""

    def place(edge: RoadEdge) -> tuple[int, bool, int]:
        left = edge.name.endswith("left")
        return edge.strip.road, left, -edge.strip.section if left else edge.strip.section

    return sorted(edges, key=place)
