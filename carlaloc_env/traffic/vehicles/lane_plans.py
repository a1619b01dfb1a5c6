"""Lane plans of drivers: a junction lane for every junction ahead, and the lanes that lead there."""

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.conflict_zones import TURN_RAD
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.uniform_draws import hash_uniform
from carlaloc_env.traffic.tables.vehicle_state import GOALS, HELD, PLAN, Fleet

ROOM_PER_CHANGE_M = 70.0
"""A path is chosen only if there is that much room for each of its lane changes [m]."""
_U_TURN_RAD = 2.6
"""Change of heading from which it is a U-turn [rad]."""
_ACROSS_WEIGHT = 0.4
"""How often drivers turn across the oncoming traffic, straight on = 1."""
_KERB_WEIGHT = 0.6
"""How often they turn to the kerb's side."""
_U_TURN_WEIGHT = 0.05
"""How often they make a U-turn."""
_CROWDED = 0.15
"""Fraction of a stretch taken by vehicles at which only half as many choose to go there."""
_QUEUE, _WAITING_MPS, _SERVED = 0.6, 3.0, 0.3
"""Queue at which only half as many choose to join; speed below which a vehicle waits; fraction of time with
open lights at which each waiting vehicle counts as one."""
_DRAW_TURN = 1
"""Purpose of the draw for a goal."""
_DRAW_EXIT = 2
"""Purpose of the draw for one of several lanes that follow."""


@compiled
def find_goal_path(roads: Roads, lane: int, goal: int) -> int:
    """Row of `roads.path` that leads from a lane to a junction lane, −1 if none does."""
    for row in range(roads.lane.path_first[lane], roads.lane.path_end[lane]):
        if roads.path.goal[row] == goal:
            return row
    return -1


@compiled
def choose_goal(roads: Roads, density: Array, lane: int, station_m: float, uniform: float, stay: bool) -> int:
    """Junction lane to head for from a lane, −1 where there is none.

    Paths without lane changes and main streets count more, U-turns, crowded roads and long queues less.

    Args:
        roads: The roads.
        density: Density of stretches and queues of junction lanes, as `measure_density` says, (lanes,).
        lane: Present lane.
        station_m: Station on it [m].
        uniform: Uniform draw in [0, 1).
        stay: Consider only paths without lane changes.
    """
    paths = roads.path
    rest = roads.lane.length_m[lane] - station_m
    total = 0.0
    best, fewest = -1, 1 << 30
    for step in range(2):
        remaining = uniform * total
        for row in range(roads.lane.path_first[lane], roads.lane.path_end[lane]):
            changes, goal = paths.changes[row], paths.goal[row]
            if changes < fewest:
                best, fewest = goal, changes
            room = rest + paths.room_m[row]
            if changes > 0 and (stay or room < ROOM_PER_CHANGE_M * changes):
                continue
            weight = 1.0 / (1.0 + changes)
            weight *= _turn_weight(roads.lane.kerb_side[goal] * roads.lane.turn_rad[goal])
            first = roads.lane.after_first[goal]
            exit_lane = roads.after[first] if first < roads.lane.after_end[goal] else goal
            weight *= roads.lane.demand[exit_lane]
            fullness = density[roads.lane.stretch[exit_lane]] / _CROWDED
            weight /= 1.0 + fullness * fullness * fullness * fullness
            queue = density[goal] / _QUEUE
            weight /= 1.0 + queue * queue
            if step == 0:
                total += weight
            else:
                remaining -= weight
                if remaining < 0.0:
                    return int(goal)
    if stay and fewest > 0:
        return -1
    return int(best)


@compiled
def _turn_weight(turn_rad: float) -> float:
    """How often a turn is chosen that is positive towards the kerb, straight on = 1."""
    if abs(turn_rad) > _U_TURN_RAD:
        return _U_TURN_WEIGHT
    if turn_rad < -TURN_RAD:
        return _ACROSS_WEIGHT
    return _KERB_WEIGHT if turn_rad > TURN_RAD else 1.0


@compiled
def plan_ahead(roads: Roads, density: Array, fleet: Fleet, v: int, seed: int) -> None:
    """Fill the plan of vehicle v from its present lane on; choose goals where none is chosen yet.

    Writes `fleet.plan[v]`, (PLAN,), and `fleet.goals[v]`, (GOALS,).

    Args:
        roads: The roads.
        density: As `measure_density` says, (lanes,).
        fleet: State, (N + C,).
        v: The vehicle.
        seed: Seed of all draws.
    """
    plan, goals = fleet.plan, fleet.goals
    goal_index = 0
    for hop in range(1, PLAN):
        lane = plan[v, hop - 1]
        following = -1
        if lane >= 0:
            if hop > 1 and roads.lane.junction[lane] < 0 and roads.lane.junction[plan[v, hop - 2]] >= 0:
                goal_index += 1
            serial = fleet.draws[v] + goal_index
            if roads.lane.junction[lane] < 0 and roads.lane.path_first[lane] < roads.lane.path_end[lane]:
                if goal_index < GOALS:
                    if goals[v, goal_index] < 0:
                        station = fleet.station_m[v] if hop == 1 else 0.0
                        uniform = hash_uniform(seed, _DRAW_TURN, v, serial)
                        goals[v, goal_index] = choose_goal(roads, density, lane, station, uniform, False)
                    path = find_goal_path(roads, lane, goals[v, goal_index])
                    if path < 0:
                        uniform = hash_uniform(seed, _DRAW_TURN, v, serial + 2_000_003)
                        goals[v, goal_index] = choose_goal(roads, density, lane, 0.0, uniform, False)
                        for later in range(goal_index + 1, GOALS):
                            goals[v, later] = -1
                        path = find_goal_path(roads, lane, goals[v, goal_index])
                    following = roads.path.onward[path] if path >= 0 else -1
            else:
                uniform = hash_uniform(seed, _DRAW_EXIT, v, serial * 65536 + lane)
                following = _any_lasting(roads, lane, uniform)
        plan[v, hop] = following


@compiled
def _any_lasting(roads: Roads, lane: int, uniform: float) -> int:
    """One of the lanes that follow a lane and do not end, by a uniform draw; −1 without one."""
    count = 0
    for k in range(roads.lane.after_first[lane], roads.lane.after_end[lane]):
        count += roads.lane.lasting[roads.after[k]]
    pick = int(uniform * count)
    for k in range(roads.lane.after_first[lane], roads.lane.after_end[lane]):
        if roads.lane.lasting[roads.after[k]]:
            if pick == 0:
                return int(roads.after[k])
            pick -= 1
    return -1


@compiled
def advance_goals(fleet: Fleet, v: int) -> None:
    """Take the next goal of vehicle v, which has left a junction; later goals are chosen anew unless held."""
    fleet.goals[v, 0] = fleet.goals[v, 1]
    keep = False
    for k in range(HELD):
        keep = keep or (fleet.held_lane[v, k] >= 0 and fleet.held_front_m[v, k] < 0.0)
    for k in range(1 if keep else 0, GOALS):
        fleet.goals[v, k] = -1
    fleet.draws[v] += 1


@compiled
def change_goal(roads: Roads, density: Array, fleet: Fleet, v: int, seed: int) -> bool:
    """Replace a goal of vehicle v that takes lane changes by one that takes none; False without one."""
    lane = fleet.plan[v, 0]
    serial = 1_000_003 * (fleet.draws[v] + 1) + int(10.0 * fleet.waited_s[v])
    uniform = hash_uniform(seed, _DRAW_TURN, v, serial)
    goal = choose_goal(roads, density, lane, fleet.station_m[v], uniform, True)
    if goal < 0:
        return False
    fleet.goals[v, :] = -1
    fleet.goals[v, 0] = goal
    plan_ahead(roads, density, fleet, v, seed)
    return True


@compiled
def measure_density(
    roads: Roads, fleet: Fleet, length_m: Array, open_fraction: Array, count: int, density: Array
) -> None:
    """Density of every stretch, and queue before every junction lane; writes `density`, (lanes,).

    For stretches the fraction of their lanes that vehicles and their gaps would cover standing; for junction
    lanes the number of vehicles that wait for them, more where the lights are seldom open.
    """
    density[:] = 0.0
    for v in range(count):
        lane = fleet.plan[v, 0]
        if roads.lane.junction[lane] < 0:
            density[roads.lane.stretch[lane]] += (length_m[v] + 3.0) / max(roads.lane.stretch_m[lane], 10.0)
        goal = fleet.goals[v, 0]
        if goal >= 0 and fleet.speed_mps[v] < _WAITING_MPS:
            density[goal] += _SERVED / open_fraction[goal]
