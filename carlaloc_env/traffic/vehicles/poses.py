"""Poses of vehicles in the world: both axles on their path, the body between them.

Lights of vehicles: brake lights, indicators, low beam.

Lateral motion of vehicles: from lane to lane, and where in its lane a vehicle drives.
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.timeline.timeline import LIGHT_BRAKE, LIGHT_LEFT, LIGHT_LOW_BEAM, LIGHT_RIGHT
from carlaloc_env.traffic.tables.conflict_zones import TURN_RAD
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import bank_at, put_point, sample, station_beside, width_at
from carlaloc_env.traffic.tables.vehicle_state import PAST, PLAN, STANDING_MPS, STEP_S, Drivers, Fleet

_QUARTER = 0.7853981633974483
"""π/4 [rad]."""
STEER_MAX_RAD = 0.7
"""Greatest steering angle that is shown [rad], 40°: about that of a car's front wheels at full lock."""


class VehiclePoses:
    """Poses of N vehicles in the world (ENU)."""

    position_m: Annotated[Array, 3]
    """Centre of the box on the ground [m], (N, 3)."""
    heading_rad: Array
    """Heading, anticlockwise from east [rad], (N,)."""
    pitch_rad: Array
    """Pitch, nose up positive [rad], (N,)."""
    roll_rad: Array
    """Roll, left side up positive [rad], (N,)."""
    steer_rad: Array
    """Steering angle of the front wheels, left positive [rad], (N,)."""
    front_axle: Annotated[Array, 6]
    """Point of the path below the front axle, as `put_point` writes it, (N, 6)."""
    rear_axle: Annotated[Array, 6]
    """The same below the rear axle, (N, 6)."""


@compiled
def angle_of(y: float, x: float) -> float:
    """Angle of a direction [rad], −π…π, by + − × ÷ alone, so that all CPUs agree; error < 1e-10.

    The argument is halved twice by tan(φ/2) = t / (1 + √(1 + t²)), then the power series of arctan
    is summed.
    """
    if x == 0.0 and y == 0.0:
        return 0.0
    swap = abs(y) > abs(x)
    t = abs(x) / abs(y) if swap else abs(y) / abs(x)
    t = t / (1.0 + np.sqrt(1.0 + t * t))
    t = t / (1.0 + np.sqrt(1.0 + t * t))
    s = t * t
    total = 0.0
    for k in range(13, -1, -1):
        total = (1.0 if k % 2 == 0 else -1.0) / (2 * k + 1) + s * total
    angle = 4.0 * t * total
    if swap:
        angle = 2.0 * _QUARTER - angle
    if x < 0.0:
        angle = 4.0 * _QUARTER - angle
    return float(-angle if y < 0.0 else angle)


@compiled
def place_ahead(roads: Roads, fleet: Fleet, v: int, ahead_m: float) -> tuple[int, float]:
    """Lane and station [m] of a place on a vehicle's path, so far ahead of its centre [m]."""
    lane, station = fleet.plan[v, 0], fleet.station_m[v] + ahead_m
    for k in range(PAST):
        if station >= 0.0 or fleet.past[v, k] < 0:
            break
        lane = fleet.past[v, k]
        station += roads.lane.length_m[lane]
    for hop in range(1, PLAN):
        if station <= roads.lane.length_m[lane] or ahead_m < 0.0 or fleet.plan[v, hop] < 0:
            break
        station -= roads.lane.length_m[lane]
        lane = fleet.plan[v, hop]
    return int(lane), float(station)


@compiled
def _path_point(
    roads: Roads, fleet: Fleet, v: int, ahead_m: float, lateral_offset_m: float, out: Array
) -> tuple[float, float]:
    """Write a point of a vehicle's path to `out`; give its curvature [1/m] and the road's rise to the left.

    Args:
        roads: The roads.
        fleet: State.
        v: Vehicle.
        ahead_m: How far ahead of its centre [m], negative behind.
        lateral_offset_m: Distance to the left of the lane's centre line [m].
        out: Six numbers, as `put_point` writes them.
    """
    lane, station = place_ahead(roads, fleet, v, ahead_m)
    put_point(roads, lane, station, lateral_offset_m, out)
    row, _ = sample(roads, lane, station)
    a, b = roads.row.tangent[row], roads.row.tangent[row + 1]
    bend = (a[0] * b[1] - a[1] * b[0]) / max(roads.lane.row_step_m[lane], 1e-3)
    return float(bend), bank_at(roads, lane, station)


@compiled
def put_poses(roads: Roads, drivers: Drivers, fleet: Fleet, poses: VehiclePoses) -> None:
    """Write the poses of N vehicles.

    They lean as the road does below both axles, left side up positive. Steering is that of a bicycle of
    the same wheelbase on the path's mean curvature.
    """
    for v in range(len(poses.heading_rad)):
        front, rear = poses.front_axle[v], poses.rear_axle[v]
        half = 0.5 * drivers.wheelbase_m[v]
        lateral_offset, slope = fleet.lateral_offset_m[v], fleet.lateral_slope[v]
        bend, bank = _path_point(roads, fleet, v, half, lateral_offset + slope * half, front)
        bend_behind, bank_behind = _path_point(roads, fleet, v, -half, lateral_offset - slope * half, rear)
        bend += bend_behind
        dx, dy, dz = front[0] - rear[0], front[1] - rear[1], front[2] - rear[2]
        for k in range(3):
            poses.position_m[v, k] = 0.5 * (front[k] + rear[k])
        poses.heading_rad[v] = angle_of(dy, dx)
        level = np.sqrt(dx * dx + dy * dy)
        poses.pitch_rad[v] = angle_of(dz, level)
        # Across a slope along the heading, the same rise to the left is less of a turn.
        cos_pitch = level / max(np.sqrt(level * level + dz * dz), 1e-9)
        poses.roll_rad[v] = angle_of(0.5 * (bank + bank_behind) * cos_pitch, 1.0)
        wheel = angle_of(half * bend, 1.0)
        poses.steer_rad[v] = min(max(wheel, -STEER_MAX_RAD), STEER_MAX_RAD)


INDICATE_M = 35.0
"""From here on before a turn drivers indicate it [m]."""
_BRAKE_LIGHT_MPS2 = -0.6
"""Acceleration below which the brake lights are lit [m/s²]."""


@compiled
def put_lights(roads: Roads, fleet: Fleet, count: int, lights: NDArray[np.uint8]) -> None:
    """Write the bits of lit lights (`LIGHT_…` of the timeline) of `count` vehicles to `lights`, (N,)."""
    for v in range(count):
        lit = LIGHT_LOW_BEAM
        if fleet.acceleration_mps2[v] < _BRAKE_LIGHT_MPS2 or fleet.speed_mps[v] < STANDING_MPS:
            lit |= LIGHT_BRAKE
        side = fleet.desired_side[v]
        if side == 0 and fleet.change[v] < 1.0:
            side = -fleet.origin[v]
        if side == 0:
            side = _turn_side(roads, fleet, v)
        if side > 0:
            lit |= LIGHT_LEFT
        elif side < 0:
            lit |= LIGHT_RIGHT
        lights[v] = lit


@compiled
def _turn_side(roads: Roads, fleet: Fleet, v: int) -> int:
    """Side of the next turn within `INDICATE_M`: 1 left, −1 right, 0 none."""
    ahead = -fleet.station_m[v]
    for hop in range(PLAN):
        lane = fleet.plan[v, hop]
        if lane < 0 or ahead > INDICATE_M:
            return 0
        if roads.lane.junction[lane] >= 0:
            turn = roads.lane.turn_rad[lane]
            return 1 if turn > TURN_RAD else -1 if turn < -TURN_RAD else 0
        ahead += roads.lane.length_m[lane]
    return 0


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
