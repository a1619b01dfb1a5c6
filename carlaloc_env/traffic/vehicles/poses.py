"""Poses of vehicles in the world: both axles on their path, the body between them."""

from typing import Annotated

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_geometry import (
    bank_at,
    put_point,
    sample,
)
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.vehicle_state import PAST, PLAN, Drivers, Fleet

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
