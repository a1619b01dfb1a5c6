"""Where drivers want to go: a junction lane for every junction ahead, and the lanes that lead there."""

from __future__ import annotations

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.hash_random import chance
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.vehicle_state import GOALS, HELD, PLAN, Fleet

ROOM_PER_CHANGE_M = 70.0
"""A way is chosen only if there is that much room for each of its lane changes [m]."""
_TURN_RAD, _U_TURN_RAD = 0.5, 2.6
_LEFT_TURNS, _RIGHT_TURNS, _U_TURNS = 0.4, 0.6, 0.05
_CROWDED = 0.15
"""Share of a stretch taken by vehicles at which only half as many choose to go there."""
_QUEUE, _WAITING_MPS, _SERVED = 0.6, 3.0, 0.3
"""Queue at which only half as many choose to join; who waits is slower; where it counts singly lights are
open for that share of the time."""
_TURN, _EXIT = 1, 2


@compiled
def find_way(roads: Roads, lane: int, goal: int) -> int:
    """Row of `roads.way` that leads from a lane to a junction lane, −1 if none does."""
    for row in range(roads.lane.way_first[lane], roads.lane.way_end[lane]):
        if roads.way.goal[row] == goal:
            return row
    return -1


@compiled
def choose_goal(roads: Roads, crowd: Array, lane: int, station_m: float, dice: float, stay: bool) -> int:
    """Junction lane to head for from a lane, −1 where none is in reach.

    Ways without lane changes count more, U-turns, crowded roads and long queues less.

    Args:
        roads: The roads.
        crowd: How full each stretch is, and how much waits for each junction lane, as `measure_crowd` says.
        lane: Present lane.
        station_m: Place on it [m].
        dice: Chance in [0, 1).
        stay: Consider only ways without lane changes.
    """
    ways = roads.way
    rest = roads.lane.length_m[lane] - station_m
    total = 0.0
    best, fewest = -1, 1 << 30
    for step in range(2):
        reach = dice * total
        for row in range(roads.lane.way_first[lane], roads.lane.way_end[lane]):
            changes, goal = ways.changes[row], ways.goal[row]
            if changes < fewest:
                best, fewest = goal, changes
            room = rest + ways.room_m[row]
            if changes > 0 and (stay or room < ROOM_PER_CHANGE_M * changes):
                continue
            weight = 1.0 / (1.0 + changes)
            weight *= _taste(roads.lane.turn_rad[goal])
            exit_lane = (
                roads.after[roads.lane.after_first[goal]]
                if (roads.lane.after_first[goal] < roads.lane.after_end[goal])
                else goal
            )
            full = crowd[roads.lane.stretch[exit_lane]] / _CROWDED
            weight /= 1.0 + full * full * full * full
            queue = crowd[goal] / _QUEUE
            weight /= 1.0 + queue * queue
            if step == 0:
                total += weight
            else:
                reach -= weight
                if reach < 0.0:
                    return int(goal)
    if stay and fewest > 0:
        return -1
    return int(best)


@compiled
def _taste(turn_rad: float) -> float:
    """How often a turn is chosen, straight on = 1."""
    if abs(turn_rad) > _U_TURN_RAD:
        return _U_TURNS
    if turn_rad > _TURN_RAD:
        return _LEFT_TURNS
    return _RIGHT_TURNS if turn_rad < -_TURN_RAD else 1.0


@compiled
def plan_ahead(roads: Roads, crowd: Array, fleet: Fleet, v: int, seed: int) -> None:
    """Fill the plan from the present lane on, choosing goals where none is chosen yet."""
    plan, goals = fleet.plan, fleet.goals
    place = 0
    for hop in range(1, PLAN):
        lane = plan[v, hop - 1]
        following = -1
        if lane >= 0:
            if hop > 1 and roads.lane.junction[lane] < 0 and roads.lane.junction[plan[v, hop - 2]] >= 0:
                place += 1
            serial = fleet.draws[v] + place
            if roads.lane.junction[lane] < 0 and roads.lane.way_first[lane] < roads.lane.way_end[lane]:
                if place < GOALS:
                    if goals[v, place] < 0:
                        station = fleet.station_m[v] if hop == 1 else 0.0
                        dice = chance(seed, _TURN, v, serial)
                        goals[v, place] = choose_goal(roads, crowd, lane, station, dice, False)
                    way = find_way(roads, lane, goals[v, place])
                    if way < 0:
                        dice = chance(seed, _TURN, v, serial + 2_000_003)
                        goals[v, place] = choose_goal(roads, crowd, lane, 0.0, dice, False)
                        for later in range(place + 1, GOALS):
                            goals[v, later] = -1
                        way = find_way(roads, lane, goals[v, place])
                    following = roads.way.onward[way] if way >= 0 else -1
            else:
                following = _any_lasting(roads, lane, chance(seed, _EXIT, v, serial * 65536 + lane))
        plan[v, hop] = following


@compiled
def _any_lasting(roads: Roads, lane: int, dice: float) -> int:
    count = 0
    for k in range(roads.lane.after_first[lane], roads.lane.after_end[lane]):
        count += roads.lane.lasting[roads.after[k]]
    pick = int(dice * count)
    for k in range(roads.lane.after_first[lane], roads.lane.after_end[lane]):
        if roads.lane.lasting[roads.after[k]]:
            if pick == 0:
                return int(roads.after[k])
            pick -= 1
    return -1


@compiled
def reach_goal(fleet: Fleet, v: int) -> None:
    """The vehicle has left a junction: its next goal comes first, those after it are chosen anew."""
    fleet.goals[v, 0] = fleet.goals[v, 1]
    keep = False
    for k in range(HELD):
        keep = keep or (fleet.held_lane[v, k] >= 0 and fleet.held_front_m[v, k] < 0.0)
    for k in range(1 if keep else 0, GOALS):
        fleet.goals[v, k] = -1
    fleet.draws[v] += 1


@compiled
def change_goal(roads: Roads, crowd: Array, fleet: Fleet, v: int, seed: int) -> bool:
    """Give up a goal that takes lane changes for one that takes none; whether there is one."""
    lane = fleet.plan[v, 0]
    dice = chance(seed, _TURN, v, 1_000_003 * (fleet.draws[v] + 1) + int(10.0 * fleet.waited_s[v]))
    goal = choose_goal(roads, crowd, lane, fleet.station_m[v], dice, True)
    if goal < 0:
        return False
    for k in range(GOALS):
        fleet.goals[v, k] = -1
    fleet.goals[v, 0] = goal
    plan_ahead(roads, crowd, fleet, v, seed)
    return True


@compiled
def measure_crowd(
    roads: Roads, fleet: Fleet, length_m: Array, open_share: Array, count: int, crowd: Array
) -> None:
    """How full every stretch is, and how much waits for every junction lane.

    For stretches the share of their lanes that vehicles and their gaps would cover standing; for junction
    lanes the number of those who wait for them, more where the lights are seldom open.
    """
    crowd[:] = 0.0
    for v in range(count):
        lane = fleet.plan[v, 0]
        if roads.lane.junction[lane] < 0:
            crowd[roads.lane.stretch[lane]] += (length_m[v] + 3.0) / max(roads.lane.stretch_m[lane], 10.0)
        goal = fleet.goals[v, 0]
        if goal >= 0 and fleet.speed_mps[v] < _WAITING_MPS:
            crowd[goal] += _SERVED / open_share[goal]
