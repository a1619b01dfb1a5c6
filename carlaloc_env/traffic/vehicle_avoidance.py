"""Vehicle avoidance of walkers: they stop before vehicles and step aside from them."""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.walker_state import RADIUS_M, VehicleBoxes, WalkerState

_VEHICLE_NEAR_M = 9.0
"""Vehicles farther away are not looked at [m]."""
_MOVES_MPS = 0.2
"""Slower vehicles are not stepped aside from [m/s]."""
_DODGE_MPS = 1.4
"""Speed at which a walker steps aside [m/s]."""
_DODGE_M = 0.7
"""Distance beside a box within which it does [m]."""
_DODGE_S = 0.3
"""Driving time ahead of a box within which it does [s]."""
_SHORT_M, _SWING = 3.0, 0.12
"""Half the length of what turns without a tail that swings out [m], and how much more every metre counts."""


@compiled
def vehicle_ahead(walkers: WalkerState, boxes: VehicleBoxes, w: int, gx: float, gy: float) -> bool:
    """Whether the next step of walker w along (gx, gy) leads into a vehicle's box, or one comes across it."""
    x, y = walkers.position_m[w, 0], walkers.position_m[w, 1]
    for v in range(len(boxes.speed_mps)):
        dx, dy = boxes.position_m[v, 0] - x, boxes.position_m[v, 1] - y
        if abs(dx) > _VEHICLE_NEAR_M or abs(dy) > _VEHICLE_NEAR_M:
            continue
        if abs(boxes.height_m[v] - walkers.position_m[w, 2]) > 2.5:
            continue
        c, s = boxes.direction[v, 0], boxes.direction[v, 1]
        now = _gap(dx, dy, c, s, boxes.half_m[v, 0], boxes.half_m[v, 1])
        for look in (0.4, 0.8):
            move = 0.3 * boxes.speed_mps[v]
            ex, ey = dx + move * c - look * gx, dy + move * s - look * gy
            then = _gap(ex, ey, c, s, boxes.half_m[v, 0] + move, boxes.half_m[v, 1])
            if then < RADIUS_M + 0.15 and then < now:
                return True
    return False


@compiled
def dodge(walkers: WalkerState, boxes: VehicleBoxes, w: int) -> tuple[float, float]:
    """Velocity with which a walker steps aside from vehicles whose box comes close to it [m/s].

    The tails of buses swing out at two metres a second where they turn: one steps aside earlier and faster.
    """
    ax, ay = 0.0, 0.0
    x, y = walkers.position_m[w, 0], walkers.position_m[w, 1]
    for v in range(len(boxes.speed_mps)):
        dx, dy = x - boxes.position_m[v, 0], y - boxes.position_m[v, 1]
        if boxes.speed_mps[v] < _MOVES_MPS or abs(dx) > _VEHICLE_NEAR_M or abs(dy) > _VEHICLE_NEAR_M:
            continue
        if abs(boxes.height_m[v] - walkers.position_m[w, 2]) > 2.5:
            continue
        c, s = boxes.direction[v, 0], boxes.direction[v, 1]
        along, lateral_offset = dx * c + dy * s, dy * c - dx * s
        beyond = max(abs(along) - boxes.half_m[v, 0] - _DODGE_S * boxes.speed_mps[v], 0.0)
        beside = abs(lateral_offset) - boxes.half_m[v, 1]
        longer = 1.0 + _SWING * max(boxes.half_m[v, 0] - _SHORT_M, 0.0)
        range_m = _DODGE_M * longer
        if beyond > 0.0 or beside > range_m:
            continue
        push = _DODGE_MPS * longer * min((range_m - beside) / (range_m - RADIUS_M), 1.0)
        push = push if lateral_offset > 0.0 else -push
        ax, ay = ax - push * s, ay + push * c
    return ax, ay


@compiled
def _gap(dx: float, dy: float, c: float, s: float, half_length_m: float, half_width_m: float) -> float:
    """Distance of a point from a box [m]; (dx, dy) leads from the point to the box's centre."""
    along = max(abs(dx * c + dy * s) - half_length_m, 0.0)
    lateral_offset = max(abs(dy * c - dx * s) - half_width_m, 0.0)
    return float(np.sqrt(along * along + lateral_offset * lateral_offset))
