"""Lights of vehicles: brake lights, indicators, low beam."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.jit import compiled
from carlaloc_env.timeline.actors import (
    LIGHT_BRAKE,
    LIGHT_LEFT,
    LIGHT_LOW_BEAM,
    LIGHT_RIGHT,
)
from carlaloc_env.traffic.tables.conflict_zones import TURN_RAD
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.vehicle_state import PLAN, STANDING_MPS, Fleet

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
