"""Speed profile: the speed that roads allow at every sample of the lane tables."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.town.lanes.lane_network import LaneNetwork

LATERAL_ACCELERATION_MPS2 = 2.9
"""Comfortable lateral acceleration in bends [m/s²]."""


COMFORT_BRAKING_MPS2 = 2.0
"""Braking on which speed tables count when they look ahead [m/s²]."""
SLOWEST_BEND_MPS = 2.5
"""Bends are never taken slower: where two arcs meet, maps hold kinks [m/s]."""


def allowed_speeds(network: LaneNetwork) -> Array:
    """Speed allowed at every sample of the lane tables [m/s], (R,).

    The least of the posted limit, what bends allow, and what lets one brake in comfort for the rest
    of the lane.
    """
    tables = network.tables
    bend = np.maximum(np.abs(tables.curvature_radpm), 1e-4)
    bend_mps = np.maximum(np.sqrt(LATERAL_ACCELERATION_MPS2 / bend), SLOWEST_BEND_MPS)
    allowed = np.minimum(tables.speed_limit_mps, bend_mps)
    last = tables.first + tables.count - 1
    # Backward pass: one sweep over samples of equal index before their lane's end.
    for back in range(1, int(tables.count.max())):
        long = tables.count > back
        rows = last[long] - back
        entry_mps = allowed[rows + 1]
        brake = np.sqrt(entry_mps * entry_mps + 2.0 * COMFORT_BRAKING_MPS2 * tables.step_m[long])
        allowed[rows] = np.minimum(allowed[rows], brake)
    return np.ascontiguousarray(allowed)
