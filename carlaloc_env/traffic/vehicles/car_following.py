"""How fast to drive: the IDM+ car-following law and speed limits that look ahead.

IDM+ takes the smaller of free-road and interaction acceleration (Schakel, van Arem & Netten,
"Effects of cooperative adaptive cruise control on traffic flow stability", ITSC 2010), so that
the gap in equilibrium is exactly s0 + v·T. Only + − × ÷ and √ are used: equal bits on every CPU.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.jit import compiled
from carlaloc_env.town.lanes.lane_network import LaneNetwork

Array = NDArray[np.float64]

LATERAL_ACCELERATION_MPS2 = 2.9
"""Comfortable lateral acceleration in bends [m/s²]."""
COMFORT_BRAKING_MPS2 = 2.0
"""Braking on which speed tables count when they look ahead [m/s²]."""
HARD_BRAKING_MPS2 = 8.0
"""Hardest braking on a dry road [m/s²]."""
SLOWEST_BEND_MPS = 2.5
"""Bends are never taken slower: where two arcs meet, maps hold kinks [m/s]."""


@compiled
def idm_plus(
    speed_mps: float,
    desired_mps: float,
    gap_m: float,
    leader_mps: float,
    headway_s: float,
    standstill_m: float,
    acceleration_mps2: float,
    braking_mps2: float,
) -> float:
    """Acceleration [m/s²], −8…+a.

    Args:
        speed_mps: Own speed [m/s].
        desired_mps: Speed wished for [m/s].
        gap_m: Bumper-to-bumper gap to the leader [m], inf without one.
        leader_mps: Speed of the leader [m/s].
        headway_s: Time headway T [s].
        standstill_m: Gap s0 kept at a standstill [m].
        acceleration_mps2: Greatest acceleration a [m/s²].
        braking_mps2: Comfortable braking b [m/s²].
    """
    ratio = speed_mps / max(desired_mps, 0.1)
    squared = ratio * ratio
    free = max(1.0 - squared * squared, -2.5)
    closing = speed_mps * (speed_mps - leader_mps) / (2.0 * np.sqrt(acceleration_mps2 * braking_mps2))
    wanted = standstill_m + max(0.0, speed_mps * headway_s + closing)
    share = wanted / max(gap_m, 0.1)
    return float(max(acceleration_mps2 * min(free, 1.0 - share * share), -HARD_BRAKING_MPS2))


def allowed_speeds(network: LaneNetwork) -> Array:
    """Speed allowed at every sample of the lane tables [m/s], (R,).

    The least of the posted limit, what bends allow, and what lets one brake in comfort for the rest
    of the lane.
    """
    tables = network.tables
    bend = np.maximum(np.abs(tables.curvature_radpm), 1e-4)
    slow = np.maximum(np.sqrt(LATERAL_ACCELERATION_MPS2 / bend), SLOWEST_BEND_MPS)
    allowed = np.minimum(tables.speed_limit_mps, slow)
    last = tables.first + tables.count - 1
    # Backward pass: one sweep over samples of equal place before their lane's end.
    for back in range(1, int(tables.count.max())):
        own = tables.count > back
        rows = last[own] - back
        reach = allowed[rows + 1]
        brake = np.sqrt(reach * reach + 2.0 * COMFORT_BRAKING_MPS2 * tables.step_m[own])
        allowed[rows] = np.minimum(allowed[rows], brake)
    return np.ascontiguousarray(allowed)
