"""One step of all walkers: along their footways, past each other, over the road when they may."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.hash_random import chance
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Presence
from carlaloc_env.traffic.tables.sidewalk_tables import CROSSWALK, PAVEMENT, Ground
from carlaloc_env.traffic.tables.walker_state import STEP_S, Boxes, Walking
from carlaloc_env.traffic.walkers.crossing_decisions import claim_crossings, wait_or_go
from carlaloc_env.traffic.walkers.steering import move

CROSSES = 0.45
"""Chance that a walker who comes past a crosswalk crosses."""
_TURNS_BACK_S = 15.0
_DOOR, _WAY, _JOIN = 31, 32, 33


@compiled
def walk(
    ground: Ground,
    walking: Walking,
    boxes: Boxes,
    roads: Roads,
    there: Presence,
    taken: NDArray[np.uint8],
    signals: NDArray[np.uint8],
    red_for_s: Array,
    seed: int,
) -> None:
    """Move all walkers by 50 ms, and write which crossings they take.

    Args:
        ground: Footways.
        walking: State, changed in place.
        boxes: Vehicles.
        roads: The roads.
        there: What stands on the lanes.
        taken: Written: crossings that walkers use or are about to use.
        signals: State of all heads.
        red_for_s: For how long each head will not be green [s].
        seed: Seed of all chance.
    """
    taken[:] = 0
    for w in range(len(walking.way)):
        wanted = walking.pace_mps[w]
        way = walking.way[w]
        if ground.way.kind[way] == CROSSWALK:
            if not walking.crossing[w]:
                wanted = wait_or_go(ground, walking, roads, there, boxes, signals, red_for_s, w)
            elif walking.waited_s[w] > _TURNS_BACK_S:
                # Whoever stands in the way may itself wait for the lane that this walker stands in.
                walking.sense[w], walking.waited_s[w] = -walking.sense[w], 0.0
            claim_crossings(ground, walking, roads, there, taken, w)
        move(ground, walking, boxes, w, wanted)
        _follow_way(ground, walking, w, seed)


@compiled
def _follow_way(ground: Ground, walking: Walking, w: int, seed: int) -> None:
    """Take to crosswalks, go on to the next footway at the end of one, turn round where none follows."""
    way, sense, station = walking.way[w], walking.sense[w], walking.station_m[w]
    if ground.way.kind[way] == PAVEMENT:
        if _take_door(ground, walking, w, seed):
            return
        over = station - ground.way.length_m[way] if sense > 0 else -station
        if over > -0.25:
            _next_pavement(ground, walking, w, seed)
        return
    end = 1 if sense > 0 else 0
    left = ground.way.length_m[way] - station if sense > 0 else station
    if left < 0.3:
        pavement = ground.land[way, end]
        walking.way[w] = pavement
        walking.station_m[w] = ground.land_m[way, end]
        walking.sense[w] = 1 if chance(seed, _WAY, w, walking.draws[w]) < 0.5 else -1
        walking.crossing[w] = False
        walking.draws[w] += 1


@compiled
def _take_door(ground: Ground, walking: Walking, w: int, seed: int) -> bool:
    way, station = walking.way[w], walking.station_m[w]
    path = walking.pace_mps[w] * STEP_S
    for k in range(ground.way.door_first[way], ground.way.door_end[way]):
        passed = (station - ground.door.station_m[k]) * walking.sense[w]
        if not 0.0 <= passed < path:
            continue
        walking.draws[w] += 1
        if chance(seed, _DOOR, w, walking.draws[w]) < CROSSES:
            walking.way[w] = ground.door.crosswalk[k]
            end = ground.door.end[k]
            walking.sense[w] = 1 if end == 0 else -1
            walking.station_m[w] = 0.0 if end == 0 else ground.way.length_m[walking.way[w]]
            walking.crossing[w] = False
            return True
    return False


@compiled
def _next_pavement(ground: Ground, walking: Walking, w: int, seed: int) -> None:
    way = walking.way[w]
    end = 1 if walking.sense[w] > 0 else 0
    first, last = ground.way.join_first[way, end], ground.way.join_end[way, end]
    walking.draws[w] += 1
    if first == last:
        walking.sense[w] = -walking.sense[w]
        walking.station_m[w] = min(max(walking.station_m[w], 0.3), ground.way.length_m[way] - 0.3)
        return
    pick = first + int(chance(seed, _JOIN, w, walking.draws[w]) * (last - first))
    walking.way[w] = ground.join_way[pick]
    walking.sense[w] = 1 if ground.join_end[pick] == 0 else -1
    walking.station_m[w] = 0.0 if ground.join_end[pick] == 0 else ground.way.length_m[walking.way[w]]
