"""Other road users as the car meets them: the nearest ones in its axes, and the first in its path."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_CENTRE_M, EGO_FRONT_M, EGO_SIZE_M
from carlaloc_env.core.jit import compiled
from carlaloc_env.envs.task.task_world import CarState

COLUMNS = 11
"""Numbers of one road user: forward, left, their velocities, heading (cos, sin), length, width, kind (3)."""
RANGE_M = 50.0
"""Road users farther away are left out [m]."""
_ROOM_M = 0.25
"""Room that the car wants beside others in its path [m]."""
STOREY_M = 4.0
"""What lies so far above or below is on another road [m]."""
_HALF_WIDTH_M = 0.5 * EGO_SIZE_M[1]


class Ego(NamedTuple):
    """The car in the world, for compiled functions."""

    x: float
    """East of `base_link` [m]."""
    y: float
    """North [m]."""
    z: float
    """Up [m]."""
    cos: float
    """Cosine of the heading."""
    sin: float
    """Sine of the heading."""
    speed_mps: float
    """Forward speed [m/s]."""


def ego_of(state: CarState) -> Ego:
    """The car in a state."""
    x, y, z = state.position_m.tolist()
    cos, sin = float(np.cos(state.heading_rad)), float(np.sin(state.heading_rad))
    return Ego(x, y, z, cos, sin, state.speed_mps)


@compiled
def put_neighbours(
    position_m: NDArray[np.float32],
    heading_rad: NDArray[np.float32],
    speed_mps: NDArray[np.float32],
    size_m: Array,
    kind: NDArray[np.int64],
    ego: Ego,
    distance_m: Array,
    out: Array,
) -> None:
    """Write the road users next to the car, the nearest first.

    Args:
        position_m: Centres of N road users on the ground [m], world, (N, 3).
        heading_rad: Their headings [rad], (N,).
        speed_mps: Their speeds [m/s], (N,).
        size_m: Their lengths and widths [m], (N, 2).
        kind: 0 vehicle, 1 two-wheeler, 2 walker, (N,).
        ego: The car.
        distance_m: Room for K distances.
        out: K rows of `COLUMNS`; rows without a road user become 0.
    """
    x, y = ego.x + ego.cos * EGO_CENTRE_M, ego.y + ego.sin * EGO_CENTRE_M
    out[:] = 0.0
    count = 0
    for n in range(len(heading_rad)):
        dx, dy = float(position_m[n, 0]) - x, float(position_m[n, 1]) - y
        away = np.sqrt(dx * dx + dy * dy)
        if away > RANGE_M or abs(float(position_m[n, 2]) - ego.z) > STOREY_M:
            continue
        if count == len(out) and away >= distance_m[count - 1]:
            continue
        row = min(count, len(out) - 1)
        while row > 0 and distance_m[row - 1] > away:
            distance_m[row] = distance_m[row - 1]
            for k in range(COLUMNS):
                out[row, k] = out[row - 1, k]
            row -= 1
        distance_m[row] = away
        angle = float(heading_rad[n])
        c, s = np.cos(angle), np.sin(angle)
        turned_cos, turned_sin = c * ego.cos + s * ego.sin, s * ego.cos - c * ego.sin
        out[row, 0] = ego.cos * dx + ego.sin * dy
        out[row, 1] = ego.cos * dy - ego.sin * dx
        out[row, 2] = float(speed_mps[n]) * turned_cos - ego.speed_mps
        out[row, 3] = float(speed_mps[n]) * turned_sin
        out[row, 4], out[row, 5] = turned_cos, turned_sin
        out[row, 6], out[row, 7] = size_m[n, 0], size_m[n, 1]
        for k in range(3):
            out[row, 8 + k] = 1.0 if kind[n] == k else 0.0
        count = min(count + 1, len(out))


@compiled
def first_in_path(
    route_m: NDArray[np.float64],
    route_heading_rad: Array,
    first_row: int,
    beyond_m: float,
    step_m: float,
    closed: bool,
    position_m: NDArray[np.float32],
    heading_rad: NDArray[np.float32],
    speed_mps: NDArray[np.float32],
    size_m: Array,
    sight_m: float,
    ego: Ego,
) -> tuple[float, float]:
    """Gap [m] from the front bumper to the first road user in the route's path, and its speed along it [m/s].

    Args:
        route_m: Samples of the route [m], world, (K, 3).
        route_heading_rad: Their headings [rad], (K,).
        first_row: The sample at or before `base_link`.
        beyond_m: How far beyond that sample `base_link` is [m].
        step_m: Distance between samples [m].
        closed: Whether the last sample leads to the first.
        position_m: Centres of N road users on the ground [m], world, (N, 3).
        heading_rad: Their headings [rad], (N,).
        speed_mps: Their speeds [m/s], (N,).
        size_m: Their lengths and widths [m], (N, 2).
        sight_m: Distance that is searched [m]; also the gap if the path is free.
        ego: The car.

    Returns:
        The gap, and the speed; the car's speed if the path is free.
    """
    rows = int(sight_m / step_m)
    best_m, best_mps = sight_m, ego.speed_mps
    for n in range(len(heading_rad)):
        x, y, z = float(position_m[n, 0]), float(position_m[n, 1]), float(position_m[n, 2])
        if abs(x - ego.x) > sight_m or abs(y - ego.y) > sight_m:
            continue
        nearest, least = -1, np.inf
        # Samples lie half a metre apart: every other sample is enough to find the nearest.
        for k in range(0, rows, 2):
            row = first_row + k
            if row >= len(route_m):
                if not closed:
                    break
                row %= len(route_m)
            dx, dy = x - route_m[row, 0], y - route_m[row, 1]
            if dx * dx + dy * dy < least:
                nearest, least = k, dx * dx + dy * dy
        if nearest <= 0:
            continue
        row = (first_row + nearest) % len(route_m)
        angle = float(heading_rad[n]) - route_heading_rad[row]
        across, along = abs(np.sin(angle)), abs(np.cos(angle))
        side = 0.5 * (size_m[n, 0] * across + size_m[n, 1] * along)
        if np.sqrt(least) > side + _HALF_WIDTH_M + _ROOM_M or abs(z - route_m[row, 2]) > STOREY_M:
            continue
        # From the sample on to the foot of the perpendicular: else the gap would go in steps of a metre.
        c, s = np.cos(route_heading_rad[row]), np.sin(route_heading_rad[row])
        ahead = nearest * step_m + c * (x - route_m[row, 0]) + s * (y - route_m[row, 1])
        gap = ahead - 0.5 * (size_m[n, 0] * along + size_m[n, 1] * across) - beyond_m - EGO_FRONT_M
        if gap < best_m and nearest * step_m > 0.5 * EGO_FRONT_M:
            best_m, best_mps = gap, float(speed_mps[n]) * np.cos(angle)
    return best_m, best_mps
