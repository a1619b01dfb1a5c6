"""Lane changes: MOBIL's incentive and safety criterion, and changes that the path needs.

MOBIL: Kesting, Treiber & Helbing, "General lane-changing model MOBIL for car-following models",
Transportation Research Record 1999 (2007).
"""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_geometry import centre_at, station_beside, width_at
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.request_queue import drop_holds_ahead
from carlaloc_env.traffic.tables.uniform_draws import happens
from carlaloc_env.traffic.tables.vehicle_state import (
    PAST,
    REFUSED_ROOM,
    STEP_S,
    DriverParameters,
    Drivers,
    Fleet,
)
from carlaloc_env.traffic.vehicles.lane_plans import change_goal, find_goal_path, plan_ahead
from carlaloc_env.traffic.vehicles.mobil import is_safe, mobil_incentive

DECIDE_EVERY = 10
"""Steps between two decisions about a lane change: 0.5 s; ours."""
THRESHOLD_MPS2 = 0.15
"""MOBIL's threshold Δa_th: gain from which a change is worth it [m/s²]; 0.1 in Kesting et al. 2007."""
INDICATE_S = 1.0
"""Time for which drivers indicate before they move over [s]; ours."""
CLEAR_OF_JUNCTION_M = 18.0
"""Distance before a junction within which no change for speed alone begins [m]; ours."""
_URGENT_RANGE_M = 150.0
"""From here on before the last chance for a change that the path needs, it is urgent [m], for each
change; ours, about the distance of SUMO's LC2013 at 50 km/h (Erdmann 2015)."""
_GIVE_UP_ROOM_M = 22.0
"""Room for each needed change below which a driver may choose another path instead [m]; ours."""
_SHORTEST_ROOM_M = 14.0
"""Room for each needed change below which a driver does so without waiting [m]: three car lengths; ours."""
_CLEAR_OF_JUNCTION_S = 2.5
"""Driving time before a junction within which none begins either [s]: half a lane change; ours."""
_WIDTH_MARGIN_M = 0.5
"""A lane must be this much wider than the vehicle to be changed to [m]; ours."""
_NO_ROOM_PATIENCE_S = 20.0
"""A driver who waits longer for room behind a junction may choose another path [s]; ours."""
_STANDING_PATIENCE_S = 3.0
"""A driver who stands longer, short of room for a change or between two lanes, gives it up [s]; ours."""
_ABORT_PATIENCE_S = 45.0
"""A driver who stands longer in a change turns back into the old lane [s]; ours."""
_DETOUR_ROOM_M = 120.0
"""Away from the path, lanes are changed for speed only with so much room for each change back [m]; ours."""
_HYSTERESIS_MPS2 = 0.1
"""Gain that is added for the side already indicated, so that drivers keep to it [m/s²]; ours."""
_DRAW_LEFT = 11
"""Purpose of the draw for random changes to the left."""
_DRAW_RIGHT = 12
"""Purpose of the draw for random changes to the right."""


@compiled
def decide_lane_changes(
    occupancy: Occupancy,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    parameters: DriverParameters,
    density: Array,
    taken: NDArray[np.int64],
    count: int,
    step: int,
) -> None:
    """Let drivers decide, indicate and begin lane changes.

    Args:
        occupancy: Bodies on every lane.
        roads: The roads.
        drivers: Drivers, (N + C,).
        fleet: State, changed in place, (N + C,).
        parameters: Parameters of all drivers.
        density: Density of each stretch, (lanes,).
        taken: Step at which a vehicle last moved into each lane, (lanes,): one a step.
        count: Number of vehicles.
        step: Number of this step.
    """
    for v in range(count):
        if fleet.change[v] < 1.0:
            # A vehicle that stands between two lanes where a further change is due gives it up.
            if fleet.waited_s[v] > _STANDING_PATIENCE_S and fleet.plan[v, 1] < 0 and (step + v) % 20 == 0:
                change_goal(roads, density, fleet, v, parameters.seed)
            if fleet.waited_s[v] > _ABORT_PATIENCE_S and (step + v) % 20 == 0:
                _abort_change(roads, drivers, fleet, density, v, parameters.seed)
            continue
        if fleet.desired_side[v] != 0:
            fleet.indicated_s[v] += STEP_S
        ready = fleet.desired_side[v] != 0 and fleet.indicated_s[v] >= INDICATE_S and (step + v) % 4 == 0
        if not ready and (step + v) % DECIDE_EVERY != 0:
            continue
        side, urgent = _side_to_take(occupancy, roads, drivers, fleet, parameters, density, v, step)
        fleet.urgent[v] = urgent
        if side != fleet.desired_side[v]:
            fleet.desired_side[v], fleet.indicated_s[v] = side, 0.0
        elif side != 0 and fleet.indicated_s[v] >= INDICATE_S:
            target = roads.lane.left[fleet.plan[v, 0]] if side > 0 else roads.lane.right[fleet.plan[v, 0]]
            if taken[target] != step and is_safe(occupancy, roads, drivers, fleet, v, target, urgent):
                taken[target] = step
                _begin_change(roads, drivers, fleet, density, v, side, target, parameters.seed)


@compiled
def _abort_change(roads: Roads, drivers: Drivers, fleet: Fleet, density: Array, v: int, seed: int) -> None:
    """Abort a change that has hardly begun: a vehicle where the old lane ends may need the room."""
    side, lane = fleet.origin[v], fleet.plan[v, 0]
    old = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
    if side == 0 or old < 0 or side * fleet.lateral_offset_m[v] < 0.5 * fleet.spacing_m[v]:
        return
    fleet.waited_s[v] = 0.0
    _begin_change(roads, drivers, fleet, density, v, side, old, seed)


@compiled
def _side_to_take(
    occupancy: Occupancy,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    parameters: DriverParameters,
    density: Array,
    v: int,
    step: int,
) -> tuple[int, bool]:
    """Side to change to (0 = stay), and whether the path needs it."""
    lane = fleet.plan[v, 0]
    if roads.lane.junction[lane] >= 0:
        return 0, False
    rest = roads.lane.length_m[lane] - fleet.station_m[v] - 0.5 * drivers.length_m[v]
    path = find_goal_path(roads, lane, fleet.goals[v, 0])
    changes, must, room = 0, 0, np.inf
    if path >= 0:
        changes, must = roads.path.changes[path], roads.path.side[path]
        room = rest + roads.path.room_m[path]
    tired = fleet.waited_s[v] > _STANDING_PATIENCE_S or room < _SHORTEST_ROOM_M * changes
    if changes > 0 and room < _GIVE_UP_ROOM_M * changes and tired:  # noqa: SIM102
        if change_goal(roads, density, fleet, v, parameters.seed):
            return 0, False
    if (
        fleet.refused[v] == REFUSED_ROOM
        and fleet.waited_s[v] > _NO_ROOM_PATIENCE_S
        and (step + v) % 100 < DECIDE_EVERY
    ):
        change_goal(roads, density, fleet, v, parameters.seed)
    ahead = fleet.plan[v, 1]
    clear = max(CLEAR_OF_JUNCTION_M, _CLEAR_OF_JUNCTION_S * fleet.speed_mps[v])
    if rest < clear and changes == 0 and (ahead < 0 or roads.lane.junction[ahead] >= 0):
        return 0, False
    if must != 0:
        target = roads.lane.left[lane] if must > 0 else roads.lane.right[lane]
        if _wide_enough(roads, drivers, fleet, v, lane, target):
            if room < (_URGENT_RANGE_M + 2.0 * fleet.speed_mps[v]) * changes:
                return must, True
        elif changes > 0:
            return 0, False
    return _incentive_side(occupancy, roads, drivers, fleet, parameters, v, step, changes, room), False


@compiled
def _wide_enough(roads: Roads, drivers: Drivers, fleet: Fleet, v: int, lane: int, target: int) -> bool:
    """Whether lane `target` is wide enough for vehicle v beside its station."""
    if target < 0:
        return False
    station = station_beside(roads, lane, fleet.station_m[v], target)
    return bool(width_at(roads, target, station) > drivers.width_m[v] + _WIDTH_MARGIN_M)


@compiled
def _incentive_side(
    occupancy: Occupancy,
    roads: Roads,
    drivers: Drivers,
    fleet: Fleet,
    parameters: DriverParameters,
    v: int,
    step: int,
    changes: int,
    room_m: float,
) -> int:
    """Side on which driving would be better by more than the threshold, 0 if on none."""
    lane = fleet.plan[v, 0]
    best, best_gain = 0, 0.0
    for side in (1, -1):
        target = roads.lane.left[lane] if side > 0 else roads.lane.right[lane]
        if not _wide_enough(roads, drivers, fleet, v, lane, target):
            continue
        path = find_goal_path(roads, target, fleet.goals[v, 0])
        probability = parameters.random_left if side > 0 else parameters.random_right
        purpose = _DRAW_LEFT if side > 0 else _DRAW_RIGHT
        changes_lane = happens(probability, parameters.seed, purpose, v, step // 40)
        if changes_lane and (path >= 0 or roads.lane.lasting[target]):
            return side
        if fleet.goals[v, 0] >= 0:
            if path < 0:
                continue
            more = roads.path.changes[path]
            station = station_beside(roads, lane, fleet.station_m[v], target)
            left_m = roads.lane.length_m[target] - station + roads.path.room_m[path]
            if more > changes and left_m < _DETOUR_ROOM_M * more:
                continue
        elif not roads.lane.lasting[target]:
            continue
        if not parameters.auto_lane_change:
            continue
        gain = mobil_incentive(occupancy, roads, drivers, fleet, v, target) - THRESHOLD_MPS2
        gain += drivers.keeps_to_kerb[v] * roads.lane.kerb_side[lane] * side
        if fleet.desired_side[v] == side:
            gain += _HYSTERESIS_MPS2
        if gain > best_gain and is_safe(occupancy, roads, drivers, fleet, v, target, False):
            best, best_gain = side, gain
    return best


@compiled
def _begin_change(
    roads: Roads, drivers: Drivers, fleet: Fleet, density: Array, v: int, side: int, target: int, seed: int
) -> None:
    """Move vehicle v to lane `target` on a side; its offset keeps it where it is in the world.

    Writes its plan, past, station [m], lateral offset [m] and the change's origin and spacing [m].
    """
    lane = fleet.plan[v, 0]
    station = station_beside(roads, lane, fleet.station_m[v], target)
    apart = 0.5 * (width_at(roads, lane, fleet.station_m[v]) + width_at(roads, target, station))
    # Where lanes run askew to their road, equal places along it do not lie side by side.
    x, y, c, s = centre_at(roads, lane, fleet.station_m[v])
    target_x, target_y, target_c, target_s = centre_at(roads, target, station)
    dx = x - fleet.lateral_offset_m[v] * s - target_x
    dy = y + fleet.lateral_offset_m[v] * c - target_y
    station += dx * target_c + dy * target_s
    drop_holds_ahead(fleet, v)
    fleet.station_m[v] = station
    fleet.plan[v, 0] = target
    current = target
    for k in range(PAST):
        old = fleet.past[v, k]
        new = -1
        for i in range(roads.lane.before_first[current], roads.lane.before_end[current]):
            before = roads.before[i]
            if new < 0 or before == old or roads.lane.left[before] == old or roads.lane.right[before] == old:
                new = before
        fleet.past[v, k] = new
        if new < 0:
            break
        current = new
    fleet.origin[v] = -side
    fleet.spacing_m[v] = apart
    fleet.lateral_offset_m[v] = dy * target_c - dx * target_s
    fleet.change[v] = 0.0
    fleet.desired_side[v], fleet.indicated_s[v] = 0, 0.0
    plan_ahead(roads, density, fleet, v, seed)
