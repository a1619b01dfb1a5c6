"""Steering of walkers: towards a point ahead, past others, along their path."""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.vehicle_state import STEP_S
from carlaloc_env.traffic.tables.walker_network import WalkerNetwork
from carlaloc_env.traffic.tables.walker_state import RADIUS_M, VehicleBoxes, WalkerState
from carlaloc_env.traffic.vehicle_avoidance import dodge, vehicle_ahead

_AHEAD_M = 1.0
"""Distance of the point that a walker walks towards [m]."""
_RELAX_S = 0.5
"""Relaxation time of the velocity [s]: τ of the social force model."""
_PUSH_MPS2 = 5.0
"""Greatest push of another walker [m/s²]."""
_PUSH_M = 1.6
"""Distance at which that push ends [m]."""
_BACK_MPS = 1.5
"""Speed at which a walker beside its path is moved back [m/s]."""


@compiled
def move(
    walker_network: WalkerNetwork, walkers: WalkerState, boxes: VehicleBoxes, w: int, desired_mps: float
) -> None:
    """Move walker w by one step towards a point ahead: pushed by others, stopped by vehicles, on its path.

    Writes its position [m], velocity [m/s], direction, station [m], distance walked [m] and time waited [s].
    """
    path, path_direction = walkers.path[w], walkers.path_direction[w]
    x, y = walkers.position_m[w, 0], walkers.position_m[w, 1]
    row = _row(walker_network, path, walkers.station_m[w] + path_direction * _AHEAD_M)
    c, s = walker_network.row.tangent[row, 0], walker_network.row.tangent[row, 1]
    room = max(0.5 * walker_network.row.width_m[row] - RADIUS_M - 0.1, 0.0)
    own_side = walker_network.path.own_side[path]
    side = min(walkers.side_m[w], room) * path_direction * -own_side
    ahead = path_direction * _AHEAD_M - (_station_of(walker_network, path, row) - walkers.station_m[w])
    gx = walker_network.row.position_m[row, 0] + ahead * c + side * s - x
    gy = walker_network.row.position_m[row, 1] + ahead * s - side * c - y
    far = np.sqrt(gx * gx + gy * gy) + 1e-6
    gx, gy = gx / far, gy / far
    px, py, slow = _others(walkers, w, gx, gy, own_side)
    if vehicle_ahead(walkers, boxes, w, gx, gy):
        desired_mps = 0.0
    desired_mps *= slow
    vx, vy = walkers.velocity_mps[w, 0], walkers.velocity_mps[w, 1]
    vx += ((gx * desired_mps - vx) / _RELAX_S + px * min(desired_mps, 1.0)) * STEP_S
    vy += ((gy * desired_mps - vy) / _RELAX_S + py * min(desired_mps, 1.0)) * STEP_S
    speed = np.sqrt(vx * vx + vy * vy)
    most = 1.3 * walkers.pace_mps[w]
    if speed > most:
        vx, vy, speed = vx * most / speed, vy * most / speed, most
    if desired_mps == 0.0 and speed < 0.05:
        vx, vy, speed = 0.0, 0.0, 0.0
    walkers.waited_s[w] = walkers.waited_s[w] + STEP_S if speed < 0.1 else 0.0
    walkers.velocity_mps[w, 0], walkers.velocity_mps[w, 1] = vx, vy
    ax, ay = dodge(walkers, boxes, w)
    _keep_on_path(walker_network, walkers, w, x + (vx + ax) * STEP_S, y + (vy + ay) * STEP_S)
    dx, dy = walkers.position_m[w, 0] - x, walkers.position_m[w, 1] - y
    walkers.travelled_m[w] += np.sqrt(dx * dx + dy * dy)
    if speed > 0.15:
        # The heading turns towards the velocity.
        tx = walkers.direction[w, 0] + 0.3 * vx / speed
        ty = walkers.direction[w, 1] + 0.3 * vy / speed
        norm = np.sqrt(tx * tx + ty * ty)
        if norm < 0.05:
            tx, ty, norm = -vy / speed, vx / speed, 1.0
        walkers.direction[w, 0], walkers.direction[w, 1] = tx / norm, ty / norm


@compiled
def _row(walker_network: WalkerNetwork, path: int, station_m: float) -> int:
    """Row of the sample nearest to a station [m] of a path."""
    at = int(station_m / walker_network.path.row_step_m[path] + 0.5)
    return int(walker_network.path.row_first[path] + min(max(at, 0), walker_network.path.row_count[path] - 1))


@compiled
def _station_of(walker_network: WalkerNetwork, path: int, row: int) -> float:
    """Station of a row of a path [m]."""
    return float((row - walker_network.path.row_first[path]) * walker_network.path.row_step_m[path])


@compiled
def _keep_on_path(walker_network: WalkerNetwork, walkers: WalkerState, w: int, x: float, y: float) -> None:
    """Put the walker at a point, moved gently back if that lies beside its path."""
    path = walkers.path[w]
    row = _row(walker_network, path, walkers.station_m[w])
    c, s = walker_network.row.tangent[row, 0], walker_network.row.tangent[row, 1]
    dx, dy = x - walker_network.row.position_m[row, 0], y - walker_network.row.position_m[row, 1]
    along, lateral_offset = dx * c + dy * s, dy * c - dx * s
    room = max(0.5 * walker_network.row.width_m[row] - RADIUS_M, 0.05)
    back = min(max(lateral_offset, -room), room) - lateral_offset
    back = min(max(back, -_BACK_MPS * STEP_S), _BACK_MPS * STEP_S)
    x, y = x - back * s, y + back * c
    station = _station_of(walker_network, path, row) + along
    # Near a bend's inside, projections jump: the station moves no faster than twice the pace.
    most = 2.6 * walkers.pace_mps[w] * STEP_S
    change = min(max(station - walkers.station_m[w], -most), most)
    walkers.station_m[w] += change
    walkers.position_m[w, 0], walkers.position_m[w, 1] = x, y
    near = _row(walker_network, path, walkers.station_m[w])
    z = walker_network.row.position_m[near, 2]
    walkers.position_m[w, 2] += min(max(z - walkers.position_m[w, 2], -0.03), 0.03)


@compiled
def _others(
    walkers: WalkerState, w: int, gx: float, gy: float, own_side: float
) -> tuple[float, float, float]:
    """Push of other walkers [m/s²], (x, y), and the fraction of speed left when one walks right ahead.

    A simple social force after Helbing & Molnár, "Social force model for pedestrian dynamics",
    Phys. Rev. E 51 (1995): repulsion that falls with distance, half as strong from behind, and a
    step to their side (−1 right, 1 left) for walkers who meet head on.
    """
    px, py, slow = 0.0, 0.0, 1.0
    x, y = walkers.position_m[w, 0], walkers.position_m[w, 1]
    for o in range(len(walkers.path)):
        dx, dy = x - walkers.position_m[o, 0], y - walkers.position_m[o, 1]
        if o == w or abs(dx) > _PUSH_M or abs(dy) > _PUSH_M:
            continue
        far = np.sqrt(dx * dx + dy * dy) + 1e-6
        if far > _PUSH_M or abs(walkers.position_m[w, 2] - walkers.position_m[o, 2]) > 2.0:
            continue
        near = 1.0 - far / _PUSH_M
        ahead = -(dx * gx + dy * gy) / far
        force = _PUSH_MPS2 * near * near * (1.0 if ahead > 0.0 else 0.5)
        px += force * (dx / far + (-0.6 * own_side * gy if ahead > 0.5 else 0.0))
        py += force * (dy / far - (-0.6 * own_side * gx if ahead > 0.5 else 0.0))
        along = walkers.velocity_mps[o, 0] * gx + walkers.velocity_mps[o, 1] * gy
        if ahead > 0.8 and far < 2.6 * RADIUS_M and along > -0.1 and o < w:
            slow = min(slow, 0.3)
    return px, py, slow
