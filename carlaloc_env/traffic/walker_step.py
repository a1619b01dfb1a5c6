"""Step of all walkers: along their paths, past each other, over the road when they may."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.uniform_draws import hash_uniform
from carlaloc_env.traffic.tables.vehicle_state import STEP_S
from carlaloc_env.traffic.tables.walker_network import CROSSWALK, SIDEWALK, WalkerNetwork
from carlaloc_env.traffic.tables.walker_state import VehicleBoxes, WalkerState
from carlaloc_env.traffic.walker_crossing import claim_crossings, wait_or_go
from carlaloc_env.traffic.walker_steering import move

CROSSES = 0.45
"""Chance that a walker who comes past a crosswalk crosses."""
_STROLLS = 0.2
"""How much more seldom walkers stroll back along a sidewalk that ends than go on to one of equal demand."""
_TURNS_BACK_S = 15.0
"""A walker who stands longer on a crosswalk turns back [s]."""
_CROSS = 31
"""Purpose of the draw for taking a crosswalk."""
_TURN = 32
"""Purpose of the draw for a direction behind one."""
_JOIN = 33
"""Purpose of the draw for one of several sidewalks that follow."""


@compiled
def walk(
    walker_network: WalkerNetwork,
    walkers: WalkerState,
    boxes: VehicleBoxes,
    roads: Roads,
    occupancy: Occupancy,
    taken: NDArray[np.uint8],
    signals: NDArray[np.uint8],
    red_for_s: Array,
    seed: int,
) -> None:
    """Move all walkers by 50 ms, and write which crossings they take.

    Args:
        walker_network: Sidewalks and crosswalks.
        walkers: State of W walkers, changed in place.
        boxes: Boxes of vehicles and the egos, (N + C,).
        roads: The roads.
        occupancy: Bodies on every lane.
        taken: Written: 0, WANTED or TAKEN for each crossing, (C,).
        signals: `SignalState` of each head, (S,).
        red_for_s: Time until each head turns green [s], (S,).
        seed: Seed of all draws.
    """
    taken[:] = 0
    for w in range(len(walkers.path)):
        desired_mps = walkers.pace_mps[w]
        path = walkers.path[w]
        if walker_network.path.kind[path] == CROSSWALK:
            if not walkers.crossing[w]:
                desired_mps = wait_or_go(
                    walker_network, walkers, roads, occupancy, boxes, signals, red_for_s, w
                )
            elif walkers.waited_s[w] > _TURNS_BACK_S:
                # The vehicle in its path may itself wait for the lane that this walker stands in.
                walkers.path_direction[w], walkers.waited_s[w] = -walkers.path_direction[w], 0.0
            claim_crossings(walker_network, walkers, roads, occupancy, taken, w)
        move(walker_network, walkers, boxes, w, desired_mps)
        _follow_path(walker_network, walkers, w, seed)


@compiled
def _follow_path(walker_network: WalkerNetwork, walkers: WalkerState, w: int, seed: int) -> None:
    """Let walker w take crosswalks, go on to the path that follows, turn round where none does."""
    path, path_direction, station = walkers.path[w], walkers.path_direction[w], walkers.station_m[w]
    if walker_network.path.kind[path] == SIDEWALK:
        if _take_crosswalk(walker_network, walkers, w, seed):
            return
        over = station - walker_network.path.length_m[path] if path_direction > 0 else -station
        if over > -0.25:
            _next_sidewalk(walker_network, walkers, w, seed)
        return
    end = 1 if path_direction > 0 else 0
    left = walker_network.path.length_m[path] - station if path_direction > 0 else station
    if left < 0.3:
        sidewalk = walker_network.landing[path, end]
        walkers.path[w] = sidewalk
        walkers.station_m[w] = walker_network.landing_m[path, end]
        walkers.path_direction[w] = 1 if hash_uniform(seed, _TURN, w, walkers.draws[w]) < 0.5 else -1
        walkers.crossing[w] = False
        walkers.draws[w] += 1


@compiled
def _take_crosswalk(walker_network: WalkerNetwork, walkers: WalkerState, w: int, seed: int) -> bool:
    """Let walker w turn onto a crosswalk that it passes in this step, by chance `CROSSES`; whether it did."""
    path, station = walkers.path[w], walkers.station_m[w]
    distance = walkers.pace_mps[w] * STEP_S
    for k in range(walker_network.path.entry_first[path], walker_network.path.entry_end[path]):
        passed = (station - walker_network.entry.station_m[k]) * walkers.path_direction[w]
        if not 0.0 <= passed < distance:
            continue
        walkers.draws[w] += 1
        if hash_uniform(seed, _CROSS, w, walkers.draws[w]) < CROSSES:
            walkers.path[w] = walker_network.entry.crosswalk[k]
            end = walker_network.entry.end[k]
            walkers.path_direction[w] = 1 if end == 0 else -1
            walkers.station_m[w] = 0.0 if end == 0 else walker_network.path.length_m[walkers.path[w]]
            walkers.crossing[w] = False
            return True
    return False


@compiled
def _next_sidewalk(walker_network: WalkerNetwork, walkers: WalkerState, w: int, seed: int) -> None:
    """Let walker w go on to a joining sidewalk, drawn by its demand, or stroll back."""
    path = walkers.path[w]
    end = 1 if walkers.path_direction[w] > 0 else 0
    first, last = walker_network.path.join_first[path, end], walker_network.path.join_end[path, end]
    walkers.draws[w] += 1
    path_demand = walker_network.path.demand
    total = _STROLLS * path_demand[path]
    for k in range(first, last):
        total += path_demand[walker_network.join_path[k]]
    left = hash_uniform(seed, _JOIN, w, walkers.draws[w]) * total - _STROLLS * path_demand[path]
    if first == last or left < 0.0:
        walkers.path_direction[w] = -walkers.path_direction[w]
        walkers.station_m[w] = min(max(walkers.station_m[w], 0.3), walker_network.path.length_m[path] - 0.3)
        return
    pick = first
    while pick < last - 1 and left >= path_demand[walker_network.join_path[pick]]:
        left -= path_demand[walker_network.join_path[pick]]
        pick += 1
    walkers.path[w] = walker_network.join_path[pick]
    from_start = walker_network.join_end[pick] == 0
    walkers.path_direction[w] = 1 if from_start else -1
    walkers.station_m[w] = 0.0 if from_start else walker_network.path.length_m[walkers.path[w]]
