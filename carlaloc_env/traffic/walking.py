"""One step of all walkers: along their footways, past each other, over the road when they may."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.clock import STEP_NS
from carlaloc_env.compiled import compiled
from carlaloc_env.traffic.columns import Array, Flags, Index
from carlaloc_env.traffic.crossings import TAKEN, WANTED
from carlaloc_env.traffic.dice import chance
from carlaloc_env.traffic.footways import CROSSWALK, PAVEMENT, Ground
from carlaloc_env.traffic.leaders import who_is_behind
from carlaloc_env.traffic.presence import Presence, place_after
from carlaloc_env.traffic.roads import Roads

STEP_S = STEP_NS / 1e9
RADIUS_M = 0.3
"""Half the width of a walker [m]."""
CROSSES = 0.45
"""Chance that a walker who comes past a crosswalk crosses."""
_AHEAD_M = 1.0
_RELAX_S = 0.5
_PUSH_MPS2, _PUSH_M = 5.0, 1.6
_WAIT_BEFORE_M = 0.5
_KERB_STOP_M = 1.0
_SAFE_S = 1.5
_BRAKE_MPS2 = 2.5
_CLAIM_S = 3.0
_HELD_UP_S = 4.0
_BACK_MPS = 1.5
_VEHICLE_NEAR_M = 9.0
_DOOR, _WAY, _JOIN = 31, 32, 33


class Walking:
    """State of all walkers, W rows."""

    way: Index
    """Footway."""
    station_m: Array
    """Station on it [m]."""
    sense: Index
    """1 towards its end, −1 towards its start."""
    side_m: Array
    """How far right of the middle it likes to walk [m]."""
    position_m: Annotated[Array, 3]
    """World [m]."""
    velocity_mps: Annotated[Array, 2]
    """World [m/s]."""
    direction: Annotated[Array, 2]
    """Cosine and sine of where it looks."""
    pace_mps: Array
    """Speed it likes to walk at [m/s]."""
    travelled_m: Array
    """Distance walked [m]."""
    waited_s: Array
    """How long it has waited at the kerb or for somebody in the way [s]."""
    crossing: Flags
    """Whether it has set out over the road."""
    draws: Index
    """Decisions taken."""


class Boxes:
    """Vehicles as walkers see them, and the ego in the last row."""

    position_m: Annotated[Array, 2]
    """Centre [m]."""
    direction: Annotated[Array, 2]
    """Cosine and sine of the heading."""
    half_m: Annotated[Array, 2]
    """Half length and half width [m]."""
    speed_mps: Array
    """Speed [m/s]."""
    height_m: Array
    """Height above the sea [m]."""


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
                wanted = _wait_or_go(ground, walking, roads, there, boxes, signals, red_for_s, w)
            _claim(ground, walking, taken, w)
        _move(ground, walking, boxes, w, wanted)
        _follow_way(ground, walking, w, seed)


@compiled
def _wait_or_go(
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
    for k in range(ground.way.pass_first[way], ground.way.pass_end[way]):
        for i in range(ground.passage.head_first[k], ground.passage.head_end[k]):
            head = ground.head[i]
            if signals[head] > 1 or (signals[head] == 1 and red_for_s[head] < across + 0.5):
                return False
        row = ground.passage.crossing[k]
        lane, enter, leave = (
            roads.crossing.lane[row],
            roads.crossing.enter_m[row],
            roads.crossing.leave_m[row],
        )
        for place in range(there.first[lane], there.first[lane + 1]):
            body = there.order[place]
            centre, half = there.body.centre_m[body], there.body.half_m[body]
            if centre + half > enter - 0.3 and centre - half < leave + 0.3:
                return False
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
def _claim(ground: Ground, walking: Walking, taken: NDArray[np.uint8], w: int) -> None:
    """Take the crossings that one walks over soon; without lights, also while one waits for them."""
    way = walking.way[w]
    for k in range(ground.way.pass_first[way], ground.way.pass_end[way]):
        if walking.sense[w] > 0:
            to_near = ground.passage.near_m[k] - walking.station_m[w]
            to_far = ground.passage.far_m[k] - walking.station_m[w]
        else:
            to_near = walking.station_m[w] - ground.passage.far_m[k]
            to_far = walking.station_m[w] - ground.passage.near_m[k]
        # Who is held up on the way keeps only the lane free that it stands in.
        held_up = walking.crossing[w] and walking.waited_s[w] > _HELD_UP_S and to_near > 0.3
        if to_far < -0.3 or held_up:
            continue
        if walking.crossing[w]:
            if to_near < _CLAIM_S * walking.pace_mps[w]:
                taken[ground.passage.crossing[k]] = TAKEN
        elif _at_kerb(ground, walking, w) and not _has_lights(ground, way):
            row = ground.passage.crossing[k]
            taken[row] = max(taken[row], WANTED)


@compiled
def _has_lights(ground: Ground, way: int) -> bool:
    for k in range(ground.way.pass_first[way], ground.way.pass_end[way]):
        if ground.passage.head_first[k] < ground.passage.head_end[k]:
            return True
    return False


@compiled
def _row(ground: Ground, way: int, station_m: float) -> int:
    at = int(station_m / ground.way.row_step_m[way] + 0.5)
    return int(ground.way.row_first[way] + min(max(at, 0), ground.way.row_count[way] - 1))


@compiled
def _move(ground: Ground, walking: Walking, boxes: Boxes, w: int, wanted_mps: float) -> None:
    """Walk towards a point a little ahead, pushed aside by others, stopped by vehicles, held on the way."""
    way, sense = walking.way[w], walking.sense[w]
    x, y = walking.position_m[w, 0], walking.position_m[w, 1]
    row = _row(ground, way, walking.station_m[w] + sense * _AHEAD_M)
    c, s = ground.row.tangent[row, 0], ground.row.tangent[row, 1]
    room = max(0.5 * ground.row.width_m[row] - RADIUS_M - 0.1, 0.0)
    side = min(walking.side_m[w], room) * sense
    ahead = sense * _AHEAD_M - (_station_of(ground, way, row) - walking.station_m[w])
    gx = ground.row.position_m[row, 0] + ahead * c + side * s - x
    gy = ground.row.position_m[row, 1] + ahead * s - side * c - y
    far = np.sqrt(gx * gx + gy * gy) + 1e-6
    gx, gy = gx / far, gy / far
    px, py, slow = _others(walking, w, gx, gy)
    if _vehicle_ahead(walking, boxes, w, gx, gy):
        wanted_mps = 0.0
    wanted_mps *= slow
    vx, vy = walking.velocity_mps[w, 0], walking.velocity_mps[w, 1]
    vx += ((gx * wanted_mps - vx) / _RELAX_S + px * min(wanted_mps, 1.0)) * STEP_S
    vy += ((gy * wanted_mps - vy) / _RELAX_S + py * min(wanted_mps, 1.0)) * STEP_S
    speed = np.sqrt(vx * vx + vy * vy)
    most = 1.3 * walking.pace_mps[w]
    if speed > most:
        vx, vy, speed = vx * most / speed, vy * most / speed, most
    if wanted_mps == 0.0 and speed < 0.05:
        vx, vy, speed = 0.0, 0.0, 0.0
    walking.waited_s[w] = walking.waited_s[w] + STEP_S if speed < 0.1 else 0.0
    walking.velocity_mps[w, 0], walking.velocity_mps[w, 1] = vx, vy
    _keep_on_way(ground, walking, w, x + vx * STEP_S, y + vy * STEP_S)
    dx, dy = walking.position_m[w, 0] - x, walking.position_m[w, 1] - y
    walking.travelled_m[w] += np.sqrt(dx * dx + dy * dy)
    if speed > 0.15:
        # The look turns towards the way that is walked.
        tx = walking.direction[w, 0] + 0.3 * vx / speed
        ty = walking.direction[w, 1] + 0.3 * vy / speed
        norm = np.sqrt(tx * tx + ty * ty)
        if norm < 0.05:
            tx, ty, norm = -vy / speed, vx / speed, 1.0
        walking.direction[w, 0], walking.direction[w, 1] = tx / norm, ty / norm


@compiled
def _station_of(ground: Ground, way: int, row: int) -> float:
    return float((row - ground.way.row_first[way]) * ground.way.row_step_m[way])


@compiled
def _keep_on_way(ground: Ground, walking: Walking, w: int, x: float, y: float) -> None:
    """Put the walker at a point, moved gently back if that lies beside its footway."""
    way = walking.way[w]
    row = _row(ground, way, walking.station_m[w])
    c, s = ground.row.tangent[row, 0], ground.row.tangent[row, 1]
    dx, dy = x - ground.row.position_m[row, 0], y - ground.row.position_m[row, 1]
    along, aside = dx * c + dy * s, dy * c - dx * s
    room = max(0.5 * ground.row.width_m[row] - RADIUS_M, 0.05)
    back = min(max(aside, -room), room) - aside
    back = min(max(back, -_BACK_MPS * STEP_S), _BACK_MPS * STEP_S)
    x, y = x - back * s, y + back * c
    station = _station_of(ground, way, row) + along
    # Near a bend's inside, projections jump: the station moves no faster than twice the pace.
    most = 2.6 * walking.pace_mps[w] * STEP_S
    change = min(max(station - walking.station_m[w], -most), most)
    walking.station_m[w] += change
    walking.position_m[w, 0], walking.position_m[w, 1] = x, y
    near = _row(ground, way, walking.station_m[w])
    z = ground.row.position_m[near, 2]
    walking.position_m[w, 2] += min(max(z - walking.position_m[w, 2], -0.03), 0.03)


@compiled
def _others(walking: Walking, w: int, gx: float, gy: float) -> tuple[float, float, float]:
    """Push of other walkers [m/s²], (x, y), and the share of speed left when one walks right ahead.

    A simple social force after Helbing & Molnár, "Social force model for pedestrian dynamics",
    Phys. Rev. E 51 (1995): repulsion that falls with distance, half as strong from behind, and a
    step to the right for those who meet head on.
    """
    px, py, slow = 0.0, 0.0, 1.0
    x, y = walking.position_m[w, 0], walking.position_m[w, 1]
    for o in range(len(walking.way)):
        dx, dy = x - walking.position_m[o, 0], y - walking.position_m[o, 1]
        if o == w or abs(dx) > _PUSH_M or abs(dy) > _PUSH_M:
            continue
        far = np.sqrt(dx * dx + dy * dy) + 1e-6
        if far > _PUSH_M or abs(walking.position_m[w, 2] - walking.position_m[o, 2]) > 2.0:
            continue
        near = 1.0 - far / _PUSH_M
        ahead = -(dx * gx + dy * gy) / far
        force = _PUSH_MPS2 * near * near * (1.0 if ahead > 0.0 else 0.5)
        px += force * (dx / far + (0.6 * gy if ahead > 0.5 else 0.0))
        py += force * (dy / far - (0.6 * gx if ahead > 0.5 else 0.0))
        along = walking.velocity_mps[o, 0] * gx + walking.velocity_mps[o, 1] * gy
        if ahead > 0.8 and far < 2.6 * RADIUS_M and along > -0.1 and o < w:
            slow = min(slow, 0.3)
    return px, py, slow


@compiled
def _vehicle_ahead(walking: Walking, boxes: Boxes, w: int, gx: float, gy: float) -> bool:
    """Whether the next step leads into a vehicle's box, or one comes across it at once."""
    x, y = walking.position_m[w, 0], walking.position_m[w, 1]
    for v in range(len(boxes.speed_mps)):
        dx, dy = boxes.position_m[v, 0] - x, boxes.position_m[v, 1] - y
        if abs(dx) > _VEHICLE_NEAR_M or abs(dy) > _VEHICLE_NEAR_M:
            continue
        if abs(boxes.height_m[v] - walking.position_m[w, 2]) > 2.5:
            continue
        c, s = boxes.direction[v, 0], boxes.direction[v, 1]
        now = _gap(dx, dy, c, s, boxes.half_m[v, 0], boxes.half_m[v, 1])
        for look in (0.4, 0.8):
            move = 0.3 * boxes.speed_mps[v]
            ex, ey = dx + move * c - look * gx, dy + move * s - look * gy
            then = _gap(ex, ey, c, s, boxes.half_m[v, 0] + move, boxes.half_m[v, 1])
            if then < RADIUS_M + 0.15 and then < now:
                return True
    return False


@compiled
def _gap(dx: float, dy: float, c: float, s: float, half_length_m: float, half_width_m: float) -> float:
    """Distance of a point from a box [m]; (dx, dy) leads from the point to the box's centre."""
    along = max(abs(dx * c + dy * s) - half_length_m, 0.0)
    aside = max(abs(dy * c - dx * s) - half_width_m, 0.0)
    return float(np.sqrt(along * along + aside * aside))


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
