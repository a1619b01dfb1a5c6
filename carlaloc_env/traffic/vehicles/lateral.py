"""Lateral motion of vehicles: from lane to lane, and where in its lane a vehicle drives."""

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_geometry import (
    station_beside,
    width_at,
)
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.vehicle_state import STEP_S, Drivers, Fleet

_FULL_PACE_MPS = 4.0
"""Below this speed lane changes take longer in proportion [m/s]."""
_BEFORE_LINE_M = 2.0
"""Changes are complete so far before a junction's line [m]."""


@compiled
def move_laterally(roads: Roads, drivers: Drivers, fleet: Fleet, count: int) -> None:
    """Move all vehicles across their lanes; a change has done 10τ³ − 15τ⁴ + 6τ⁵ of the spacing at fraction τ.

    That is the path of least jerk (Flash & Hogan 1985).

    Slow vehicles take longer, those that stand do not move at all.
    """
    for v in range(count):
        lane, station = fleet.plan[v, 0], fleet.station_m[v]
        before = fleet.lateral_offset_m[v]
        base = _lane_position(roads, drivers, v, lane, station)
        if fleet.change[v] >= 1.0:
            target = base
        else:
            pace = min(fleet.speed_mps[v] / _FULL_PACE_MPS, 1.0) * STEP_S / drivers.change_s[v]
            ahead = fleet.plan[v, 1]
            if ahead < 0 or roads.lane.junction[ahead] >= 0:
                # Over before the line.
                rest = roads.lane.stop_m[lane] - station - 0.5 * drivers.length_m[v] - _BEFORE_LINE_M
                pace = max(pace, (1.0 - fleet.change[v]) * fleet.speed_mps[v] * STEP_S / max(rest, 3.0))
            off = abs(before - base) > 0.2
            fleet.change[v] = min(fleet.change[v] + pace, 0.99 if off else 1.0)
            t = fleet.change[v]
            side = fleet.origin[v]
            origin = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
            if origin >= 0:
                origin_station = station_beside(roads, lane, station, origin)
                width = width_at(roads, lane, station)
                fleet.spacing_m[v] = 0.5 * (width + width_at(roads, origin, origin_station))
            left = 1.0 - t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
            target = base + side * fleet.spacing_m[v] * left
            if t >= 1.0:
                fleet.origin[v] = 0
        # No vehicle slides sideways faster than a quarter of its speed.
        most = 0.25 * fleet.speed_mps[v] * STEP_S
        fleet.lateral_offset_m[v] = before + min(max(target - before, -most), most)
        lateral_slope = (fleet.lateral_offset_m[v] - before) / max(fleet.speed_mps[v] * STEP_S, 0.05)
        fleet.lateral_slope[v] += 0.4 * (lateral_slope - fleet.lateral_slope[v])


@compiled
def _lane_position(roads: Roads, drivers: Drivers, v: int, lane: int, station_m: float) -> float:
    """Where in its lane a vehicle usually drives: in the middle, or near the edge at the kerb [m]."""
    edge = drivers.edge_distance_m[v]
    if edge <= 0.0:
        return 0.0
    return float(-roads.lane.kerb_side[lane] * min(0.0, edge - 0.5 * width_at(roads, lane, station_m)))
