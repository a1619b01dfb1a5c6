"""Steering and crossing decisions of walkers.

Steering of walkers: towards a point ahead, past others, along their path.

Vehicle avoidance of walkers: they stop before vehicles and step aside from them.

Crossing decisions of walkers: whether to wait at the kerb, when to set out, which lanes to claim.
"""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_reachability import WalkerNetwork
from carlaloc_env.traffic.tables.lane_tables import TAKEN, WANTED, Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy, index_after
from carlaloc_env.traffic.tables.vehicle_state import RADIUS_M, STEP_S, VehicleBoxes, WalkerState
from carlaloc_env.traffic.vehicles.car_following import find_behind

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
    path, sense = walkers.path[w], walkers.sense[w]
    x, y = walkers.position_m[w, 0], walkers.position_m[w, 1]
    row = _row(walker_network, path, walkers.station_m[w] + sense * _AHEAD_M)
    c, s = walker_network.row.tangent[row, 0], walker_network.row.tangent[row, 1]
    room = max(0.5 * walker_network.row.width_m[row] - RADIUS_M - 0.1, 0.0)
    own_side = walker_network.path.own_side[path]
    side = min(walkers.side_m[w], room) * sense * -own_side
    ahead = sense * _AHEAD_M - (_station_of(walker_network, path, row) - walkers.station_m[w])
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


_WAIT_BEFORE_M = 0.5
"""Distance to the carriageway at which walkers wait [m]."""
_SAFE_S = 1.5
"""Time that must be left when the lane has been crossed [s]."""
_BRAKE_MPS2 = 2.5
"""Walkers set out before vehicles that can stop with this braking [m/s²]."""
_CLAIM_S = 3.0
"""Walking time before a lane from which on it is kept free [s]."""
_HELD_UP_S = 4.0
"""A walker who stands longer on a crosswalk is held up [s]."""
_LEFT_M = 0.1
"""A walker held up and so far past a lane has left it [m]."""


@compiled
def wait_or_go(
    walker_network: WalkerNetwork,
    walkers: WalkerState,
    roads: Roads,
    occupancy: Occupancy,
    boxes: VehicleBoxes,
    signals: NDArray[np.uint8],
    red_for_s: Array,
    w: int,
) -> float:
    """Desired speed of walker w, who comes up to the kerb [m/s]; notes when the crossing begins."""
    if not _at_kerb(walker_network, walkers, w):
        return float(walkers.pace_mps[w])
    if not _may_cross(walker_network, walkers, roads, occupancy, boxes, signals, red_for_s, w):
        return 0.0
    walkers.crossing[w] = True
    return float(walkers.pace_mps[w])


@compiled
def _at_kerb(walker_network: WalkerNetwork, walkers: WalkerState, w: int) -> bool:
    """Whether walker w stands at the kerb, or is past it."""
    kerb_m, station_m = walker_network.path.kerb_m[walkers.path[w]], walkers.station_m[w]
    to_kerb_m = kerb_m[0] - station_m if walkers.sense[w] > 0 else station_m - kerb_m[1]
    return bool(to_kerb_m < _WAIT_BEFORE_M + 0.3)


@compiled
def _may_cross(
    walker_network: WalkerNetwork,
    walkers: WalkerState,
    roads: Roads,
    occupancy: Occupancy,
    boxes: VehicleBoxes,
    signals: NDArray[np.uint8],
    red_for_s: Array,
    w: int,
) -> bool:
    """Whether lights hold the traffic for long enough, and vehicles are far away or can stop."""
    paths, crossings, path = walker_network.path, walker_network.lane_crossing, walkers.path[w]
    pace, station_m, ego = walkers.pace_mps[w], walkers.station_m[w], len(boxes.speed_mps) - 1
    across = (paths.kerb_m[path, 1] - paths.kerb_m[path, 0]) / pace
    if _blocked(walker_network, roads, occupancy, path):
        return False
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        for i in range(crossings.head_first[k], crossings.head_end[k]):
            head = walker_network.head[i]
            if signals[head] > 1 or (signals[head] == 1 and red_for_s[head] < across + 0.5):
                return False
        row = crossings.crossing[k]
        lane, enter = roads.crossing.lane[row], roads.crossing.enter_m[row]
        until = crossings.far_m[k] - station_m if walkers.sense[w] > 0 else station_m - crossings.near_m[k]
        clear = until / pace + _SAFE_S
        index = index_after(occupancy, lane, enter)
        owner, gap, speed = find_behind(occupancy, roads, lane, index, enter, -1, 0.0)
        if owner < 0 or gap > speed * clear:
            continue
        if owner == ego or speed * speed > 2.0 * _BRAKE_MPS2 * max(gap - 1.5, 0.05):
            return False
    return True


@compiled
def _blocked(walker_network: WalkerNetwork, roads: Roads, occupancy: Occupancy, path: int) -> bool:
    """Whether a vehicle is on the crosswalk or touches it."""
    paths = walker_network.path
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        row = walker_network.lane_crossing.crossing[k]
        lane = roads.crossing.lane[row]
        enter, leave = roads.crossing.enter_m[row], roads.crossing.leave_m[row]
        for index in range(occupancy.first[lane], occupancy.first[lane + 1]):
            body = occupancy.order[index]
            centre, half = occupancy.body.centre_m[body], occupancy.body.half_m[body]
            if centre + half > enter - 0.3 and centre - half < leave + 0.3:
                return True
    return False


@compiled
def claim_crossings(
    walker_network: WalkerNetwork,
    walkers: WalkerState,
    roads: Roads,
    occupancy: Occupancy,
    taken: NDArray[np.uint8],
    w: int,
) -> None:
    """Claim the crossings that walker w passes soon; without lights, also while it waits for them.

    Writes `taken`, (C,): WANTED or TAKEN.
    """
    paths, crossings = walker_network.path, walker_network.lane_crossing
    path, station_m = walkers.path[w], walkers.station_m[w]
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        to_near, to_far = crossings.near_m[k] - station_m, crossings.far_m[k] - station_m
        if walkers.sense[w] < 0:
            to_near, to_far = station_m - crossings.far_m[k], station_m - crossings.near_m[k]
        # A walker held up on the crosswalk keeps the lane free that it stands in, not one it has left.
        held_up = walkers.crossing[w] and walkers.waited_s[w] > _HELD_UP_S
        if to_far < (_LEFT_M if held_up else -0.3) or (held_up and to_near > 0.3):
            continue
        if walkers.crossing[w]:
            if to_near < _CLAIM_S * walkers.pace_mps[w]:
                taken[crossings.crossing[k]] = TAKEN
        elif (
            _at_kerb(walker_network, walkers, w)
            and not _has_lights(walker_network, path)
            and not _blocked(walker_network, roads, occupancy, path)
        ):
            row = crossings.crossing[k]
            taken[row] = max(taken[row], WANTED)


@compiled
def _has_lights(walker_network: WalkerNetwork, path: int) -> bool:
    """Whether lights stop the traffic on a lane that a crosswalk's path crosses."""
    paths, crossings = walker_network.path, walker_network.lane_crossing
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        if crossings.head_first[k] < crossings.head_end[k]:
            return True
    return False
