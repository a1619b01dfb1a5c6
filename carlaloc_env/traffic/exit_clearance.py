"""Exit clearance: room behind a junction, so that no vehicle comes to a stand inside."""

from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.request_queue import Requests
from carlaloc_env.traffic.tables.vehicle_state import (
    HELD,
    PLAN,
    Drivers,
    Fleet,
)

_ROOM_M = 1.5
"""Room that a vehicle needs behind a junction beside its length and standstill gap [m]."""
_SLOW_MPS = 2.0
"""Slower than this, the vehicle ahead counts as standing [m/s]."""
_GAP_M = 2.0
"""Gap between vehicles that close up [m]."""


@compiled
def claim_rooms(requests: Requests, roads: Roads, drivers: Drivers, fleet: Fleet) -> None:
    """Claim the room [m] of all vehicles admitted and not yet through; writes `claimed`, (lanes,)."""
    requests.claimed[:] = 0.0
    for v in range(len(fleet.speed_mps)):
        if fleet.is_ego[v]:
            break
        for k in range(HELD):
            lane = fleet.held_lane[v, k]
            if lane >= 0 and fleet.held_front_m[v, k] < roads.lane.length_m[lane]:
                claim_room(requests, drivers, fleet, v, lane)


@compiled
def claim_room(requests: Requests, drivers: Drivers, fleet: Fleet, v: int, lane: int) -> None:
    """Claim room [m] for vehicle v on the lane that follows a junction lane in its plan; writes `claimed`."""
    for hop in range(PLAN - 1):
        if fleet.plan[v, hop] == lane and fleet.plan[v, hop + 1] >= 0:
            requests.claimed[fleet.plan[v, hop + 1]] += drivers.length_m[v] + 2.0
            return


@compiled
def has_room(
    requests: Requests, occupancy: Occupancy, roads: Roads, drivers: Drivers, fleet: Fleet, v: int, hop: int
) -> bool:
    """Whether the lanes behind the junction can take the vehicle as a whole, whichever vehicle stops there.

    Each vehicle on those lanes that has not been admitted to the next junction is taken to close up behind
    the first that stands, or at the next stop line; so are those admitted before.
    """
    need = drivers.length_m[v] + drivers.standstill_m[v] + _ROOM_M
    free = 0.0
    for k in range(hop + 1, PLAN):
        lane = fleet.plan[v, k]
        if lane < 0:
            return True
        if roads.lane.junction[lane] >= 0 and k == hop + 1:
            hop += 1
            continue
        free -= requests.claimed[lane]
        for index in range(occupancy.first[lane], occupancy.first[lane + 1]):
            row = occupancy.order[index]
            other = occupancy.body.owner[row]
            if other == v:
                continue
            fleet.blocker[v] = other
            if occupancy.body.speed_mps[row] < _SLOW_MPS:
                return bool(free + occupancy.body.centre_m[row] - occupancy.body.half_m[row] >= need)
            if not _moves_on(roads, fleet, other):
                free -= 2.0 * occupancy.body.half_m[row] + _GAP_M
        following = fleet.plan[v, k + 1] if k + 1 < PLAN else -1
        ends = following >= 0 and roads.lane.junction[following] >= 0
        if ends and roads.lane.junction[lane] < 0 and roads.lane.stop_m[lane] >= need:
            return bool(free + roads.lane.stop_m[lane] >= need)
        free += roads.lane.length_m[lane]
        if free >= need:
            return True
    return True


@compiled
def _moves_on(roads: Roads, fleet: Fleet, v: int) -> bool:
    """Whether a vehicle has been admitted to the junction ahead of it."""
    for k in range(HELD):
        held = fleet.held_lane[v, k]
        if held >= 0 and fleet.held_front_m[v, k] < 0.0 and roads.lane.junction[held] >= 0:
            return True
    return False
