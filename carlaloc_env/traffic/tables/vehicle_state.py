"""Who drives, and where everybody is: arrays that compiled functions read and write.

All arrays have one row more than there are vehicles: the last row is the ego.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.traffic.tables.record_arrays import Flags, columns

PLAN = 12
"""Lanes that a plan holds, the present one first."""
PAST = 3
"""Lanes that are remembered behind a vehicle."""
GOALS = 6
"""Junction lanes that a driver has chosen ahead."""
REFUSED_LIGHT, REFUSED_LEADER, REFUSED_ROOM, REFUSED_ZONE = 1, 2, 3, 4
"""By light or stop sign; because the vehicle before it waits; no room behind; somebody crosses."""
HELD = 6
"""Junction lanes that a vehicle can be admitted to at once."""


class Drivers:
    """Fixed properties of N vehicles and their drivers; the last row is the ego, (N + 1,) each."""

    length_m: Array
    """Vehicle length [m]."""
    width_m: Array
    """Vehicle width [m]."""
    wheelbase_m: Array
    """Wheelbase [m]."""
    speed_factor: Array
    """Desired speed over what is allowed, 0.8–1.2 for cars."""
    top_mps: Array
    """Speed that is never exceeded [m/s]."""
    headway_s: Array
    """Time headway T [s]."""
    standstill_m: Array
    """Gap s0 kept when standing [m]."""
    acceleration_mps2: Array
    """Greatest acceleration [m/s²]."""
    braking_mps2: Array
    """Comfortable braking [m/s²]."""
    change_s: Array
    """Time that a lane change takes [s]."""
    keeps_right: Array
    """Gain that the driver sees in the right lane [m/s²]."""
    aside_m: Array
    """Where in the lane the vehicle drives: distance from the right edge [m], 0 = in the middle."""


class Habits(NamedTuple):
    """What applies to all drivers."""

    seed: int
    """Seed of all chance."""
    auto_lane_change: bool
    """Whether lanes are changed for speed, not only because the way asks for it."""
    random_left: float
    """Chance of a change to the left without a reason, at each decision."""
    random_right: float
    """Chance of a change to the right without a reason, at each decision."""
    ignore_lights: float
    """Chance that a driver does not mind the lights of a junction."""
    ignore_signs: float
    """Chance that a driver does not mind the signs of a junction."""
    ignore_walkers: float
    """Chance that a driver does not mind the walkers on a crosswalk."""
    ignore_vehicles: float
    """Chance that a driver does not mind the vehicle in front for one second."""


class Fleet:
    """State of N vehicles; the last row is the ego."""

    plan: Annotated[Index, PLAN]
    """Lanes each vehicle will drive, the present one first, −1 = none, (N + 1, PLAN)."""
    past: Annotated[Index, PAST]
    """Lanes it came from, the last one first, −1 = none, (N + 1, PAST)."""
    station_m: Array
    """Station of the vehicle's centre on its lane [m], (N + 1,)."""
    speed_mps: Array
    """Speed [m/s], (N + 1,)."""
    acceleration_mps2: Array
    """Acceleration [m/s²], (N + 1,)."""
    travelled_m: Array
    """Distance covered [m], (N + 1,)."""
    waited_s: Array
    """How long it has stood [s], (N + 1,)."""
    stopped_s: Array
    """How long it has stood at the stop sign before it [s], (N + 1,)."""
    goals: Annotated[Index, GOALS]
    """Junction lanes that the driver heads for, one after the other, −1 = none, (N + 1, GOALS)."""
    draws: Index
    """How many goals have been reached, (N + 1,)."""
    held_lane: Annotated[Index, HELD]
    """Junction lanes that it is admitted to, −1 = none, (N + 1, HELD)."""
    held_front_m: Annotated[Array, HELD]
    """Station of its front on each of them [m], negative before it, (N + 1, HELD)."""
    held_ticket: Annotated[Index, HELD]
    """Order of admission, (N + 1, HELD)."""
    aside_m: Array
    """Distance of the centre to the left of the lane's centre line [m], (N + 1,)."""
    drift: Array
    """Metres that it moves to the left per metre driven, (N + 1,)."""
    origin: Index
    """Side on which the lane lies that it is leaving: 1 left, −1 right, 0 none, (N + 1,)."""
    change: Array
    """Share of the lane change that is done, (N + 1,)."""
    spacing_m: Array
    """Distance between the two lanes of the change [m], (N + 1,)."""
    wish: Index
    """Side to which it indicates a lane change, (N + 1,)."""
    wished_s: Array
    """For how long it has indicated [s], (N + 1,)."""
    urgent: Flags
    """Whether the wish follows from the way, (N + 1,)."""
    at_stop_sign: Flags
    """Whether it stands or comes to a stand at a stop sign, (N + 1,)."""
    refused: Index
    """Why it may not enter the junction before it (`REFUSED_…`), 0 = it may or need not, (N + 1,)."""
    blocker: Index
    """Who takes the room that it needs behind that junction, −1 = nobody, (N + 1,)."""
    leader: Index
    """Who drives in front, −1 = nobody, (N + 1,)."""
    gap_m: Array
    """Gap to the leader [m], (N + 1,)."""
    stop_gap_m: Array
    """Distance from the front to the place to stop at [m], inf = none, (N + 1,)."""


def empty_fleet(count: int) -> Fleet:
    """Rows for a number of vehicles and the ego, nobody placed yet."""
    fleet = columns(Fleet, count + 1)
    for lanes in (fleet.plan, fleet.past, fleet.goals, fleet.held_lane):
        lanes[...] = -1
    fleet.change[:] = 1.0
    fleet.leader[:] = -1
    fleet.blocker[:] = -1
    fleet.gap_m[:] = np.inf
    fleet.stop_gap_m[:] = np.inf
    return fleet
