"""Car following by IDM+: acceleration behind a leader, with the driver's own headway and braking.

IDM+ takes the smaller of free-road and interaction acceleration (Schakel, van Arem & Netten, "Effects of
cooperative adaptive cruise control on traffic flow stability", ITSC 2010), so that the gap in equilibrium is
exactly s0 + v·T. Only + − × ÷ and √ are used: equal bits on every CPU.
"""

import numpy as np

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.vehicle_state import Drivers

HARD_BRAKING_MPS2 = 8.0
"""Hardest braking on a dry road [m/s²]."""
FREE_MPS = 40.0
"""Desired speed that other drivers are taken to have [m/s]: so high that the gap alone decides. At town
speeds the free-road term of IDM+, 1 − (v/40)⁴, is within 2 % of 1."""


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
        desired_mps: Desired speed [m/s].
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
    desired_gap = standstill_m + max(0.0, speed_mps * headway_s + closing)
    gap_ratio = desired_gap / max(gap_m, 0.1)
    return float(max(acceleration_mps2 * min(free, 1.0 - gap_ratio * gap_ratio), -HARD_BRAKING_MPS2))


@compiled
def follow(
    drivers: Drivers, v: int, speed_mps: float, desired_mps: float, gap_m: float, leader_mps: float
) -> float:
    """IDM+ acceleration of vehicle v with its driver's own headway, gap, acceleration and braking [m/s²].

    Args:
        drivers: All drivers, (N + C,).
        v: The vehicle.
        speed_mps: Its speed [m/s].
        desired_mps: Speed that it would drive on a free road [m/s].
        gap_m: Bumper-to-bumper gap to the leader [m], inf without one.
        leader_mps: Speed of the leader [m/s].
    """
    return idm_plus(
        speed_mps,
        desired_mps,
        gap_m,
        leader_mps,
        drivers.headway_s[v],
        drivers.standstill_m[v],
        drivers.acceleration_mps2[v],
        drivers.braking_mps2[v],
    )
