"""How drivers mind those who walk on crosswalks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.crosswalk_tables import WANTED
from carlaloc_env.traffic.tables.hash_random import chance
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.vehicle_state import PLAN, Drivers, Fleet, Habits

STOP_BEFORE_M = 1.2
"""How far before a crosswalk drivers stop [m]."""
_TOO_LATE_MPS2 = 6.0
_AT_STRIPES_M, _STOOD_S = 0.7, 5.0
_IGNORES = 21


@compiled
def mind_walkers(
    taken: NDArray[np.uint8],
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    habits: Habits,
    count: int,
    step: int,
) -> None:
    """Stop before crossings that walkers have taken, (C,) of them."""
    for v in range(count):
        if (
            habits.ignore_walkers > 0.0
            and chance(habits.seed, _IGNORES, v, step // 200) < habits.ignore_walkers
        ):
            continue
        front, speed = fleet.station_m[v] + 0.5 * drivers.length_m[v], fleet.speed_mps[v]
        reach = 10.0 + speed * speed / 3.0
        ahead = -front
        for hop in range(PLAN):
            lane = fleet.plan[v, hop]
            if lane < 0 or ahead > reach:
                break
            for k in range(roads.lane.crossing_first[lane], roads.lane.crossing_end[lane]):
                gap = ahead + roads.crossing.enter_m[k]
                if taken[k] == 0 or gap < -0.3 or gap > reach:
                    continue
                # Who stands at the stripes already lets those at the kerb wait.
                stood = taken[k] == WANTED or fleet.waited_s[v] > _STOOD_S
                if stood and gap < _AT_STRIPES_M:
                    continue
                if speed * speed < 2.0 * _TOO_LATE_MPS2 * max(gap - 0.3, 0.1):
                    fleet.stop_gap_m[v] = min(fleet.stop_gap_m[v], max(gap - STOP_BEFORE_M, 0.0))
            ahead += roads.lane.length_m[lane]
