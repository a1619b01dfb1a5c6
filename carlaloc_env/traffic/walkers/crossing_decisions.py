"""At the kerb: whether to wait, when to set out, and whom that holds up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.crosswalk_tables import TAKEN, WANTED
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Presence, place_after
from carlaloc_env.traffic.tables.sidewalk_tables import Ground
from carlaloc_env.traffic.tables.walker_state import Boxes, Walking
from carlaloc_env.traffic.vehicles.neighbours import who_is_behind

_WAIT_BEFORE_M = 0.5
_SAFE_S = 1.5
_BRAKE_MPS2 = 2.5
_CLAIM_S = 3.0
_HELD_UP_S, _LEFT_M = 4.0, 0.1


@compiled
def wait_or_go(
    ground: Ground,
    walking: Walking,
    roads: Roads,
    there: Presence,
    boxes: Boxes,
    signals: NDArray[np.uint8],
    red_for_s: Array,
    w: int,
) -> float:
    """Speed wished for by a walker who comes up to the kerb [m/s]; notes when the crossing begins."""
    if not _at_kerb(ground, walking, w):
        return float(walking.pace_mps[w])
    if not _may_cross(ground, walking, roads, there, boxes, signals, red_for_s, w):
        return 0.0
    walking.crossing[w] = True
    return float(walking.pace_mps[w])


@compiled
def _kerb_distance(ground: Ground, walking: Walking, w: int) -> float:
    """How far the carriageway lies ahead on a crosswalk's footway [m]."""
    way = walking.way[w]
    if walking.sense[w] > 0:
        return float(ground.way.kerb_m[way, 0] - walking.station_m[w])
    return float(walking.station_m[w] - ground.way.kerb_m[way, 1])


@compiled
def _at_kerb(ground: Ground, walking: Walking, w: int) -> bool:
    return _kerb_distance(ground, walking, w) < _WAIT_BEFORE_M + 0.3


@compiled
def _may_cross(
    ground: Ground,
    walking: Walking,
    roads: Roads,
    there: Presence,
    boxes: Boxes,
    signals: NDArray[np.uint8],
    red_for_s: Array,
    w: int,
) -> bool:
    """Whether lights hold the traffic for long enough, and whoever comes is far away or can stop."""
    way, pace = walking.way[w], walking.pace_mps[w]
    ego = len(boxes.speed_mps) - 1
    across = (ground.way.kerb_m[way, 1] - ground.way.kerb_m[way, 0]) / pace
    if _blocked(ground, roads, there, way):
        return False
    for k in range(ground.way.pass_first[way], ground.way.pass_end[way]):
        for i in range(ground.passage.head_first[k], ground.passage.head_end[k]):
            head = ground.head[i]
            if signals[head] > 1 or (signals[head] == 1 and red_for_s[head] < across + 0.5):
                return False
        row = ground.passage.crossing[k]
        lane, enter = roads.crossing.lane[row], roads.crossing.enter_m[row]
        if walking.sense[w] > 0:
            until = ground.passage.far_m[k] - walking.station_m[w]
        else:
            until = walking.station_m[w] - ground.passage.near_m[k]
        clear = until / pace + _SAFE_S
        owner, gap, speed = who_is_behind(there, roads, lane, place_after(there, lane, enter), enter, -1, 0.0)
        if owner < 0 or gap > speed * clear:
            continue
        if owner == ego or speed * speed > 2.0 * _BRAKE_MPS2 * max(gap - 1.5, 0.05):
            return False
    return True


@compiled
def _blocked(ground: Ground, roads: Roads, there: Presence, way: int) -> bool:
    """Whether a vehicle is on the crosswalk or touches it."""
    for k in range(ground.way.pass_first[way], ground.way.pass_end[way]):
        row = ground.passage.crossing[k]
        lane = roads.crossing.lane[row]
        enter, leave = roads.crossing.enter_m[row], roads.crossing.leave_m[row]
        for place in range(there.first[lane], there.first[lane + 1]):
            body = there.order[place]
            centre, half = there.body.centre_m[body], there.body.half_m[body]
            if centre + half > enter - 0.3 and centre - half < leave + 0.3:
                return True
    return False


@compiled
def claim_crossings(
    ground: Ground, walking: Walking, roads: Roads, there: Presence, taken: NDArray[np.uint8], w: int
) -> None:
    """Take the crossings that one walks over soon; without lights, also while one waits for them."""
    way = walking.way[w]
    for k in range(ground.way.pass_first[way], ground.way.pass_end[way]):
        if walking.sense[w] > 0:
            to_near = ground.passage.near_m[k] - walking.station_m[w]
            to_far = ground.passage.far_m[k] - walking.station_m[w]
        else:
            to_near = walking.station_m[w] - ground.passage.far_m[k]
            to_far = walking.station_m[w] - ground.passage.near_m[k]
        # Who is held up on the way keeps only the lane free that it stands in, not the one that it has left.
        held_up = walking.crossing[w] and walking.waited_s[w] > _HELD_UP_S
        if to_far < (_LEFT_M if held_up else -0.3) or (held_up and to_near > 0.3):
            continue
        if walking.crossing[w]:
            if to_near < _CLAIM_S * walking.pace_mps[w]:
                taken[ground.passage.crossing[k]] = TAKEN
        elif (
            _at_kerb(ground, walking, w)
            and not _has_lights(ground, way)
            and not _blocked(ground, roads, there, way)
        ):
            row = ground.passage.crossing[k]
            taken[row] = max(taken[row], WANTED)


@compiled
def _has_lights(ground: Ground, way: int) -> bool:
    for k in range(ground.way.pass_first[way], ground.way.pass_end[way]):
        if ground.passage.head_first[k] < ground.passage.head_end[k]:
            return True
    return False
