"""Map entries: vehicles leave where roads end at the map's edge, and enter again where others begin.

Towns are closed: their traffic goes round for ever. On a map whose roads mostly lead out of it, such as a
single crossing or a piece of motorway, only vehicles that may leave can drive at all.
"""

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_geometry import allowed_at
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.uniform_draws import hash_uniform
from carlaloc_env.traffic.tables.vehicle_state import Drivers, Fleet
from carlaloc_env.traffic.vehicles.lane_plans import plan_ahead
from carlaloc_env.traffic.vehicles.neighbours import find_ahead

_TAIL_M = 0.5
"""Distance from an entrance at which a vehicle's tail comes in [m]."""
_ENTRY_ROOM_M = 8.0
"""Room that it needs ahead there [m]."""
_ENTRY_ROOM_S = 2.0
"""Further room in driving time [s]."""
_DRAW_ENTRANCE = 13
"""Purpose of the draw for an entrance."""


@compiled
def reenter_map(
    occupancy: Occupancy,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    density: Array,
    taken: Index,
    count: int,
    step: int,
    seed: int,
) -> None:
    """Let vehicles that come to the edge of the map enter elsewhere, or wait there for room.

    Args:
        occupancy: Bodies on every lane.
        roads: The roads.
        drivers: Drivers, (N + C,).
        fleet: State, changed in place, (N + C,).
        density: Density of each stretch, (lanes,).
        taken: Step at which a vehicle last moved into each lane, (lanes,): one a step.
        count: Number of vehicles.
        step: Number of this step.
        seed: Seed of all draws.
    """
    entrances = len(roads.entrance)
    for v in range(count):
        lane = fleet.plan[v, 0]
        front = fleet.station_m[v] + 0.5 * drivers.length_m[v]
        if not roads.lane.leaves[lane] or front < roads.lane.length_m[lane] or entrances == 0:
            continue
        first = int(hash_uniform(seed, _DRAW_ENTRANCE, v, fleet.draws[v]) * entrances)
        entered = False
        for k in range(entrances):
            entrance = roads.entrance[(first + k) % entrances]
            if _has_room(occupancy, roads, drivers, fleet, taken, v, entrance, step):
                _place_at_entrance(roads, drivers, fleet, density, v, entrance, seed)
                taken[entrance] = step
                entered = True
                break
        if not entered:
            fleet.speed_mps[v] = fleet.acceleration_mps2[v] = 0.0


@compiled
def _has_room(
    occupancy: Occupancy,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    taken: Index,
    v: int,
    entrance: int,
    step: int,
) -> bool:
    """Whether no vehicle has entered at an entrance in this step, and there is room for vehicle v."""
    if taken[entrance] == step:
        return False
    half = 0.5 * drivers.length_m[v]
    _, gap, _ = find_ahead(occupancy, roads, entrance, occupancy.first[entrance], half + _TAIL_M, v, half)
    return bool(gap > _ENTRY_ROOM_M + _ENTRY_ROOM_S * fleet.speed_mps[v])


@compiled
def _place_at_entrance(
    roads: Roads, drivers: Drivers, fleet: Fleet, density: Array, v: int, entrance: int, seed: int
) -> None:
    """Put a vehicle at the beginning of a lane, as if it had come from beyond the map."""
    fleet.plan[v, :] = -1
    fleet.past[v, :] = -1
    fleet.goals[v, :] = -1
    fleet.held_lane[v, :] = -1
    fleet.plan[v, 0] = entrance
    fleet.station_m[v] = 0.5 * drivers.length_m[v] + _TAIL_M
    fleet.speed_mps[v] = min(
        fleet.speed_mps[v], allowed_at(roads, entrance, fleet.station_m[v]) * drivers.speed_factor[v]
    )
    fleet.acceleration_mps2[v] = 0.0
    fleet.lateral_offset_m[v] = fleet.lateral_slope[v] = 0.0
    fleet.origin[v] = fleet.desired_side[v] = 0
    fleet.change[v] = 1.0
    fleet.waited_s[v] = fleet.stopped_s[v] = fleet.indicated_s[v] = 0.0
    fleet.urgent[v] = False
    fleet.draws[v] += 1
    plan_ahead(roads, density, fleet, v, seed)
