"""State of vehicles and drivers: record arrays that compiled functions read and write.

All have a row for each of N vehicles, then one for each of C cars that are driven from elsewhere: the egos.
"""

from typing import Annotated, NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.traffic.tables.record_arrays import Flags, columns

STEP_S = STEP_NS / 1e9
"""One step [s]."""
STANDING_MPS = 0.1
"""Slower than this, a vehicle stands [m/s]."""
PLAN = 12
"""Lanes that a plan holds, the present one first."""
PAST = 3
"""Lanes that are remembered behind a vehicle."""
GOALS = 6
"""Junction lanes that a driver has chosen ahead."""
REFUSED_LIGHT, REFUSED_LEADER, REFUSED_ROOM, REFUSED_ZONE = 1, 2, 3, 4
"""Reasons in `Fleet.refused`: light or sign; the vehicle ahead waits; no room behind; a zone not clear."""
HELD = 6
"""Junction lanes that a vehicle can be admitted to at once."""


class Drivers:
    """Fixed properties of N vehicles and their drivers, then of the egos, (N + C,) each."""

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
    keeps_to_kerb: Array
    """Gain that the driver sees in the lane nearer to the kerb [m/s²]."""
    edge_distance_m: Array
    """Where in the lane the vehicle drives: distance from the edge at the kerb [m], 0 = in the middle."""


class DriverParameters(NamedTuple):
    """Parameters that apply to all drivers alike."""

    seed: int
    """Seed of all draws."""
    auto_lane_change: bool
    """Whether lanes are changed for speed, not only because the path needs it."""
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
    """State of N vehicles, then of the egos."""

    plan: Annotated[Index, PLAN]
    """Lanes each vehicle will drive, the present one first, −1 = none, (N + C, PLAN)."""
    past: Annotated[Index, PAST]
    """Lanes it came from, the last one first, −1 = none, (N + C, PAST)."""
    station_m: Array
    """Station of the vehicle's centre on its lane [m], (N + C,)."""
    speed_mps: Array
    """Speed [m/s], (N + C,)."""
    acceleration_mps2: Array
    """Acceleration [m/s²], (N + C,)."""
    travelled_m: Array
    """Distance covered [m], (N + C,)."""
    waited_s: Array
    """Time for which it has stood [s], (N + C,)."""
    goes_first_s: Array
    """Time left in which it moves before vehicles that stand, having waited in a junction [s], (N + C,)."""
    stopped_s: Array
    """Time for which it has stood at the stop sign before it [s], (N + C,)."""
    goals: Annotated[Index, GOALS]
    """Junction lanes that the driver heads for, one after the other, −1 = none, (N + C, GOALS)."""
    draws: Index
    """Number of goals reached, (N + C,)."""
    held_lane: Annotated[Index, HELD]
    """Junction lanes that it is admitted to, −1 = none, (N + C, HELD)."""
    held_front_m: Annotated[Array, HELD]
    """Station of its front on each of them [m], negative before it, (N + C, HELD)."""
    held_ticket: Annotated[Index, HELD]
    """Order of admission, (N + C, HELD)."""
    lateral_offset_m: Array
    """Distance of the centre to the left of the lane's centre line [m], (N + C,)."""
    lateral_slope: Array
    """Distance that it moves to the left per distance driven, (N + C,)."""
    origin: Index
    """Side of the lane that it is leaving: 1 left, −1 right, 0 none, (N + C,)."""
    change: Array
    """Fraction of the lane change that is done, (N + C,)."""
    spacing_m: Array
    """Distance between the two lanes of the change [m], (N + C,)."""
    desired_side: Index
    """Side to which it indicates a lane change, (N + C,)."""
    indicated_s: Array
    """Time for which it has indicated [s], (N + C,)."""
    urgent: Flags
    """Whether the path needs that change soon, (N + C,)."""
    at_stop_sign: Flags
    """Whether it stands or comes to a stand at a stop sign, (N + C,)."""
    refused: Index
    """Why it may not enter the junction before it (`REFUSED_…`), 0 = it may or need not, (N + C,)."""
    blocker: Index
    """Vehicle that takes the room it needs behind that junction, −1 = none, (N + C,)."""
    leader: Index
    """Vehicle in front, −1 = none, (N + C,)."""
    gap_m: Array
    """Gap to the leader [m], (N + C,)."""
    is_ego: Flags
    """Whether it is driven from elsewhere, (N + C,)."""
    stop_gap_m: Array
    """Distance from the front to where it has to stop [m], inf = nowhere, (N + C,)."""


def empty_fleet(count: int, egos: int) -> Fleet:
    """Empty state of N vehicles and C egos, (N + C,); no vehicle is on a lane yet."""
    fleet = columns(Fleet, count + egos)
    fleet.is_ego[count:] = True
    for column in (fleet.plan, fleet.past, fleet.goals, fleet.held_lane, fleet.leader, fleet.blocker):
        column[...] = -1
    fleet.change[:] = 1.0
    fleet.gap_m[:] = fleet.stop_gap_m[:] = np.inf
    return fleet
