"""Where roads end at the edge of a map: vehicles leave there, and come in again where other roads begin.

Towns are closed: their traffic goes round for ever. Of a map whose roads mostly lead out of it, such as a
single crossing or a piece of motorway, only what may leave can drive there at all.
"""

from __future__ import annotations

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.hash_random import chance
from carlaloc_env.traffic.tables.lane_tables import Roads, allowed_at
from carlaloc_env.traffic.tables.occupancy import Presence
from carlaloc_env.traffic.tables.vehicle_state import Drivers, Fleet
from carlaloc_env.traffic.vehicles.lane_plans import plan_ahead
from carlaloc_env.traffic.vehicles.neighbours import find_ahead

_BEHIND_M, _ROOM_M, _ROOM_S = 0.5, 8.0, 2.0
_GATE = 13


@compiled
def pass_gates(
    there: Presence,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    crowd: Array,
    taken: Index,
    count: int,
    step: int,
    seed: int,
) -> None:
    """Whoever comes to the edge of the map comes in again elsewhere, or waits there for room.

    Args:
        there: What stands on the lanes.
        roads: The roads.
        drivers: Their habits.
        fleet: State, changed in place.
        crowd: How full each stretch is.
        taken: Step at which somebody last moved into each lane: one a step.
        count: Number of vehicles.
        step: Number of this step.
        seed: Seed of all chance.
    """
    gates = len(roads.entrance)
    for v in range(count):
        lane = fleet.plan[v, 0]
        front = fleet.station_m[v] + 0.5 * drivers.length_m[v]
        if not roads.lane.leaves[lane] or front < roads.lane.length_m[lane] or gates == 0:
            continue
        first = int(chance(seed, _GATE, v, fleet.draws[v]) * gates)
        entered = False
        for k in range(gates):
            gate = roads.entrance[(first + k) % gates]
            if _has_room(there, roads, drivers, fleet, taken, v, gate, step):
                _enter(roads, drivers, fleet, crowd, v, gate, seed)
                taken[gate] = step
                entered = True
                break
        if not entered:
            fleet.speed_mps[v] = fleet.acceleration_mps2[v] = 0.0


@compiled
def _has_room(
    there: Presence, roads: Roads, drivers: Drivers, fleet: Fleet, taken: Index, v: int, gate: int, step: int
) -> bool:
    if taken[gate] == step:
        return False
    half = 0.5 * drivers.length_m[v]
    _, gap, _ = find_ahead(there, roads, gate, there.first[gate], half + _BEHIND_M, v, half)
    return bool(gap > _ROOM_M + _ROOM_S * fleet.speed_mps[v])


@compiled
def _enter(roads: Roads, drivers: Drivers, fleet: Fleet, crowd: Array, v: int, gate: int, seed: int) -> None:
    """Put a vehicle at the beginning of a lane, as if it had come from beyond the map."""
    fleet.plan[v, :] = -1
    fleet.past[v, :] = -1
    fleet.goals[v, :] = -1
    fleet.held_lane[v, :] = -1
    fleet.plan[v, 0] = gate
    fleet.station_m[v] = 0.5 * drivers.length_m[v] + _BEHIND_M
    fleet.speed_mps[v] = min(
        fleet.speed_mps[v], allowed_at(roads, gate, fleet.station_m[v]) * drivers.speed_factor[v]
    )
    fleet.acceleration_mps2[v] = 0.0
    fleet.aside_m[v] = fleet.drift[v] = 0.0
    fleet.origin[v] = fleet.wish[v] = 0
    fleet.change[v] = 1.0
    fleet.waited_s[v] = fleet.stopped_s[v] = fleet.wished_s[v] = 0.0
    fleet.urgent[v] = False
    fleet.draws[v] += 1
    plan_ahead(roads, crowd, fleet, v, seed)
