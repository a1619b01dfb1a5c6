"""Yielding of drivers to walkers on crosswalks."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import WANTED, Roads
from carlaloc_env.traffic.tables.uniform_draws import happens
from carlaloc_env.traffic.tables.vehicle_state import (
    PLAN,
    DriverParameters,
    Drivers,
    Fleet,
)

STOP_BEFORE_M = 1.2
"""Distance before a crosswalk at which drivers stop [m]."""
_TOO_LATE_MPS2 = 6.0
"""A driver who would have to brake harder drives on [m/s²]."""
_AT_STRIPES_M = 0.7
"""Distance to a crosswalk within which a driver stands at its stripes [m]."""
_STOOD_S = 5.0
"""A driver who has stood there longer goes before walkers who wait at the kerb [s]."""
_DRAW_IGNORE_WALKERS = 21
"""Purpose of the draw for ignored walkers."""


@compiled
def yield_to_walkers(
    taken: NDArray[np.uint8],
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    parameters: DriverParameters,
    count: int,
    step: int,
) -> None:
    """Stop before crossings that walkers have taken; lowers `fleet.stop_gap_m` [m], (N + C,).

    Args:
        taken: 0, WANTED or TAKEN for each crossing, (C,).
        roads: The roads.
        drivers: Drivers, (N + C,).
        fleet: State, (N + C,).
        parameters: Parameters of all drivers.
        count: Number of vehicles.
        step: Number of this step.
    """
    for v in range(count):
        if happens(parameters.ignore_walkers, parameters.seed, _DRAW_IGNORE_WALKERS, v, step // 200):
            continue
        front, speed = fleet.station_m[v] + 0.5 * drivers.length_m[v], fleet.speed_mps[v]
        range_m = 10.0 + speed * speed / 3.0
        ahead = -front
        for hop in range(PLAN):
            lane = fleet.plan[v, hop]
            if lane < 0 or ahead > range_m:
                break
            for k in range(roads.lane.crossing_first[lane], roads.lane.crossing_end[lane]):
                gap = ahead + roads.crossing.enter_m[k]
                if taken[k] == 0 or gap < -0.3 or gap > range_m:
                    continue
                # A driver who stands at the stripes already lets walkers at the kerb wait.
                stood = taken[k] == WANTED or fleet.waited_s[v] > _STOOD_S
                if stood and gap < _AT_STRIPES_M:
                    continue
                if speed * speed < 2.0 * _TOO_LATE_MPS2 * max(gap - 0.3, 0.1):
                    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], max(gap - STOP_BEFORE_M, 0.0))
            ahead += roads.lane.length_m[lane]
