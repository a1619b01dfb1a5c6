"""How fast to drive: the IDM+ car-following law and speed limits that look ahead.

IDM+ takes the smaller of free-road and interaction acceleration (Schakel, van Arem & Netten,
"Effects of cooperative adaptive cruise control on traffic flow stability", ITSC 2010), so that
the gap in equilibrium is exactly s0 + v·T. Only + − × ÷ and √ are used: equal bits on every CPU.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.town.network import LaneNetwork

Array = NDArray[np.float64]

TABLE_STEP_M = 0.5
"""Spacing of the speed tables along a lane [m]."""
LATERAL_ACCELERATION_MPS2 = 2.2
"""Comfortable lateral acceleration in bends [m/s²]."""
COMFORT_BRAKING_MPS2 = 1.5
"""Braking on which speed tables count when they look ahead [m/s²]."""


def idm_plus(
    speed_mps: Array,
    desired_mps: Array,
    gap_m: Array,
    leader_mps: Array,
    *,
    headway_s: Array,
    standstill_m: Array,
    acceleration_mps2: Array,
    braking_mps2: Array,
) -> Array:
    """Acceleration [m/s²], shape (N,), −8…+a.

    Args:
        speed_mps: Own speed [m/s], shape (N,).
        desired_mps: Speed wished for [m/s], shape (N,).
        gap_m: Bumper-to-bumper gap to the leader [m], inf without one, shape (N,).
        leader_mps: Speed of the leader [m/s], shape (N,).
        headway_s: Time headway T [s], shape (N,).
        standstill_m: Gap s0 kept at a standstill [m], shape (N,).
        acceleration_mps2: Greatest acceleration a [m/s²], shape (N,).
        braking_mps2: Comfortable braking b [m/s²], shape (N,).
    """
    ratio = speed_mps / np.maximum(desired_mps, 0.1)
    squared = ratio * ratio
    free = np.maximum(1.0 - squared * squared, -2.5)
    closing = speed_mps * (speed_mps - leader_mps) / (2.0 * np.sqrt(acceleration_mps2 * braking_mps2))
    wanted = standstill_m + np.maximum(0.0, speed_mps * headway_s + closing)
    share = wanted / np.maximum(gap_m, 0.1)
    follow = 1.0 - share * share
    return np.clip(acceleration_mps2 * np.minimum(free, follow), -8.0, None)


class SpeedTables:
    """Speed limits along every lane: posted limit, bends, and braking for what follows in the lane."""

    def __init__(self, network: LaneNetwork) -> None:
        lengths = np.array([lane.length_m for lane in network.lanes])
        counts = np.maximum(2, np.ceil(lengths / TABLE_STEP_M).astype(np.int64) + 1)
        self.offset = np.concatenate([[0], np.cumsum(counts)[:-1]])
        self.count = counts
        lane = np.repeat(np.arange(len(lengths)), counts)
        place = np.arange(counts.sum()) - np.repeat(self.offset, counts)
        station = np.minimum(place * TABLE_STEP_M, lengths[lane])
        bend = np.abs(network.pose(lane, station).curvature_radpm)
        posted = network.speed_limit_mps(lane, station)
        self.limit_mps = np.minimum(posted, np.sqrt(LATERAL_ACCELERATION_MPS2 / np.maximum(bend, 1e-4)))
        # Backward pass: one sweep over columns of equal place before the lane's end.
        last = self.offset + counts - 1
        for back in range(1, int(counts.max())):
            rows = last - back
            rows = rows[rows >= self.offset]
            reach = self.limit_mps[rows + 1]
            allowed = np.sqrt(reach * reach + 2.0 * COMFORT_BRAKING_MPS2 * TABLE_STEP_M)
            self.limit_mps[rows] = np.minimum(self.limit_mps[rows], allowed)
        self.entry_mps = self.limit_mps[self.offset]

    def at(self, lane: NDArray[np.int64], station_m: Array) -> Array:
        """Speed allowed at stations of lanes [m/s], shape (M,)."""
        place = np.clip((station_m / TABLE_STEP_M).astype(np.int64), 0, self.count[lane] - 1)
        result: Array = self.limit_mps[self.offset[lane] + place]
        return result
