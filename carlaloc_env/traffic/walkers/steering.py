"""One step on foot: towards a point ahead, past others, on one's way."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.sidewalk_tables import Ground
from carlaloc_env.traffic.tables.walker_state import RADIUS_M, STEP_S, Boxes, Walking
from carlaloc_env.traffic.walkers.vehicle_avoidance import dodge, vehicle_ahead

_AHEAD_M = 1.0
_RELAX_S = 0.5
_PUSH_MPS2, _PUSH_M = 5.0, 1.6
_BACK_MPS = 1.5


@compiled
def move(ground: Ground, walking: Walking, boxes: Boxes, w: int, wanted_mps: float) -> None:
    """Walk towards a point a little ahead, pushed aside by others, stopped by vehicles, held on the way."""
    way, sense = walking.way[w], walking.sense[w]
    x, y = walking.position_m[w, 0], walking.position_m[w, 1]
    row = _row(ground, way, walking.station_m[w] + sense * _AHEAD_M)
    c, s = ground.row.tangent[row, 0], ground.row.tangent[row, 1]
    room = max(0.5 * ground.row.width_m[row] - RADIUS_M - 0.1, 0.0)
    side = min(walking.side_m[w], room) * sense
    ahead = sense * _AHEAD_M - (_station_of(ground, way, row) - walking.station_m[w])
    gx = ground.row.position_m[row, 0] + ahead * c + side * s - x
    gy = ground.row.position_m[row, 1] + ahead * s - side * c - y
    far = np.sqrt(gx * gx + gy * gy) + 1e-6
    gx, gy = gx / far, gy / far
    px, py, slow = _others(walking, w, gx, gy)
    if vehicle_ahead(walking, boxes, w, gx, gy):
        wanted_mps = 0.0
    wanted_mps *= slow
    vx, vy = walking.velocity_mps[w, 0], walking.velocity_mps[w, 1]
    vx += ((gx * wanted_mps - vx) / _RELAX_S + px * min(wanted_mps, 1.0)) * STEP_S
    vy += ((gy * wanted_mps - vy) / _RELAX_S + py * min(wanted_mps, 1.0)) * STEP_S
    speed = np.sqrt(vx * vx + vy * vy)
    most = 1.3 * walking.pace_mps[w]
    if speed > most:
        vx, vy, speed = vx * most / speed, vy * most / speed, most
    if wanted_mps == 0.0 and speed < 0.05:
        vx, vy, speed = 0.0, 0.0, 0.0
    walking.waited_s[w] = walking.waited_s[w] + STEP_S if speed < 0.1 else 0.0
    walking.velocity_mps[w, 0], walking.velocity_mps[w, 1] = vx, vy
    ax, ay = dodge(walking, boxes, w)
    _keep_on_way(ground, walking, w, x + (vx + ax) * STEP_S, y + (vy + ay) * STEP_S)
    dx, dy = walking.position_m[w, 0] - x, walking.position_m[w, 1] - y
    walking.travelled_m[w] += np.sqrt(dx * dx + dy * dy)
    if speed > 0.15:
        # The look turns towards the way that is walked.
        tx = walking.direction[w, 0] + 0.3 * vx / speed
        ty = walking.direction[w, 1] + 0.3 * vy / speed
        norm = np.sqrt(tx * tx + ty * ty)
        if norm < 0.05:
            tx, ty, norm = -vy / speed, vx / speed, 1.0
        walking.direction[w, 0], walking.direction[w, 1] = tx / norm, ty / norm


@compiled
def _row(ground: Ground, way: int, station_m: float) -> int:
    at = int(station_m / ground.way.row_step_m[way] + 0.5)
    return int(ground.way.row_first[way] + min(max(at, 0), ground.way.row_count[way] - 1))


@compiled
def _station_of(ground: Ground, way: int, row: int) -> float:
    return float((row - ground.way.row_first[way]) * ground.way.row_step_m[way])


@compiled
def _keep_on_way(ground: Ground, walking: Walking, w: int, x: float, y: float) -> None:
    """Put the walker at a point, moved gently back if that lies beside its footway."""
    way = walking.way[w]
    row = _row(ground, way, walking.station_m[w])
    c, s = ground.row.tangent[row, 0], ground.row.tangent[row, 1]
    dx, dy = x - ground.row.position_m[row, 0], y - ground.row.position_m[row, 1]
    along, aside = dx * c + dy * s, dy * c - dx * s
    room = max(0.5 * ground.row.width_m[row] - RADIUS_M, 0.05)
    back = min(max(aside, -room), room) - aside
    back = min(max(back, -_BACK_MPS * STEP_S), _BACK_MPS * STEP_S)
    x, y = x - back * s, y + back * c
    station = _station_of(ground, way, row) + along
    # Near a bend's inside, projections jump: the station moves no faster than twice the pace.
    most = 2.6 * walking.pace_mps[w] * STEP_S
    change = min(max(station - walking.station_m[w], -most), most)
    walking.station_m[w] += change
    walking.position_m[w, 0], walking.position_m[w, 1] = x, y
    near = _row(ground, way, walking.station_m[w])
    z = ground.row.position_m[near, 2]
    walking.position_m[w, 2] += min(max(z - walking.position_m[w, 2], -0.03), 0.03)


@compiled
def _others(walking: Walking, w: int, gx: float, gy: float) -> tuple[float, float, float]:
    """Push of other walkers [m/s²], (x, y), and the share of speed left when one walks right ahead.

    A simple social force after Helbing & Molnár, "Social force model for pedestrian dynamics",
    Phys. Rev. E 51 (1995): repulsion that falls with distance, half as strong from behind, and a
    step to the right for those who meet head on.
    """
    px, py, slow = 0.0, 0.0, 1.0
    x, y = walking.position_m[w, 0], walking.position_m[w, 1]
    for o in range(len(walking.way)):
        dx, dy = x - walking.position_m[o, 0], y - walking.position_m[o, 1]
        if o == w or abs(dx) > _PUSH_M or abs(dy) > _PUSH_M:
            continue
        far = np.sqrt(dx * dx + dy * dy) + 1e-6
        if far > _PUSH_M or abs(walking.position_m[w, 2] - walking.position_m[o, 2]) > 2.0:
            continue
        near = 1.0 - far / _PUSH_M
        ahead = -(dx * gx + dy * gy) / far
        force = _PUSH_MPS2 * near * near * (1.0 if ahead > 0.0 else 0.5)
        px += force * (dx / far + (0.6 * gy if ahead > 0.5 else 0.0))
        py += force * (dy / far - (0.6 * gx if ahead > 0.5 else 0.0))
        along = walking.velocity_mps[o, 0] * gx + walking.velocity_mps[o, 1] * gy
        if ahead > 0.8 and far < 2.6 * RADIUS_M and along > -0.1 and o < w:
            slow = min(slow, 0.3)
    return px, py, slow
