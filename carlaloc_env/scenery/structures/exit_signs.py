"""Direction signs before the exits of fast roads, placed as the German rules for them (RWBA 2000) say.

A board on the verge 1000 m before, a cantilever 500 m before and one where the lanes part, countdown markers
at 300, 200 and 100 m, and a board in the gore. What would come before the preceding exit is left out. Along
raised roads they stand on the parapet.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import partial

import numpy as np
import shapely

from carlaloc_env.assets.direction_signs import cantilever, countdown_marker, verge_sign
from carlaloc_env.assets.texture_atlas import STREET_NAMES
from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.lanes import Lane
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.ground.grade_levels import WALL_M
from carlaloc_env.scenery.ground.height_fields import HeightOf
from carlaloc_env.scenery.meshing.props import PropField
from carlaloc_env.scenery.structures.deck_edges import PARAPET_M
from carlaloc_env.scenery.structures.guard_rails import FAST_MPS

ADVANCE_M, OVERHEAD_M, MARKERS_M = 1000.0, (500.0, 0.0), (300.0, 200.0, 100.0)
"""How far before the lanes part: the board on the verge, cantilevers, countdown markers [m]."""
SHORT_ADVANCE_M = 700.0
"""Where the board on the verge stands when the preceding exit is too near [m]."""
SMALL_M, POST_M, LARGE_M = 1.1, 1.6, 3.6
"""Distances of markers, of cantilevers' posts and of the middles of boards from the road's edge [m]."""
GORE_AWAY_M, GORE_CLEAR_M, GORE_BOARD_M = (2.0, 3.0, 4.0), 1.8, 2.6
"""The gore's board: places beside the ramp, distance of its middle from both roads, and width [m]."""
ARM_M = 9.5
"""How far a cantilever reaches over the road [m]."""
LIFT_M = 1.2
"""Roads that stand farther above the ground carry no signs beside them [m]."""
SHIFTS_M = (0.0, 10.0, -10.0, 20.0, 30.0)
"""How far a sign is moved upstream where it finds no place [m]."""
RIM_M = 0.5
"""Signs stand on parapets only this near to the deck's rim [m]."""
_PARTING_RAD = 0.6
_WIDEST_M = 30.0
_STEP_M = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Exit:
    """A place where a ramp leaves a fast road."""

    ramp: int
    """Lane of the ramp inside the junction."""
    through: int
    """Driving lane before it that is nearest to the kerb."""


def exits(network: LaneNetwork) -> list[Exit]:
    """Exits of all fast roads: a slow road of one lane leaves at a small angle, the fast one goes on."""
    ramps = []
    for lane in network.lanes:
        before = [network.lanes[k] for k in lane.predecessors]
        after = [network.lanes[k] for k in lane.successors]
        if lane.type != "driving" or lane.junction_id is None or not before or not after:
            continue
        if not (_is_fast(before[0]) and not _is_fast(after[0]) and lane.left is None and lane.right is None):
            continue
        ends = network.pose([lane.index] * 2, [0.0, lane.length_m]).heading_rad
        others = [
            network.lanes[k]
            for k in _alongside(network, before[0])
            if network.lanes[k].junction_id is not None and network.lanes[k].road_id != lane.road_id
        ]
        goes_on = any(_is_fast(network.lanes[k]) for other in others for k in other.successors)
        if goes_on and abs(transforms.wrap_angle(ends[1] - ends[0])) < _PARTING_RAD:
            ramps.append(Exit(ramp=lane.index, through=_at_kerb(network, before[0]).index))
    return ramps


def add_exit_signs(
    props: PropField, network: LaneNetwork, paved: Area, blocked: Area, overhead: Area, floor: HeightOf
) -> Array:
    """Signs of all exits; gives the base points of their posts [m], shape (K, 3).

    Args:
        props: Takes the signs.
        network: Lanes of the town.
        paved: Everything paved, on which no post stands.
        blocked: What else they keep clear of.
        overhead: Raised roads, which have parapets along their rims.
        floor: Height of the ground.
    """
    place = _Placer(network, paved, blocked, overhead, floor)
    bases_m: list[Array] = []
    for number, exit_ in enumerate(exits(network)):
        names = _names(network, exit_, number)
        advance = place.beside(exit_, ADVANCE_M, LARGE_M) or place.beside(exit_, SHORT_ADVANCE_M, LARGE_M)
        if advance is not None:
            bases_m.append(advance.base_m)
            advance.put(props, ("verge sign", *names), partial(verge_sign, *names[1:]))
        for distance in OVERHEAD_M:
            spot = place.beside(exit_, distance, POST_M)
            if spot is not None:
                bases_m.append(spot.base_m)
                arm_m = -network.lanes[exit_.through].kerb_side * ARM_M
                make = partial(cantilever, arm_m, *names, low_m=spot.rise_m)
                spot.put(props, ("cantilever", arm_m, *names, spot.rise_m), make)
        for distance in MARKERS_M:
            spot = place.beside(exit_, distance, SMALL_M)
            if spot is not None:
                bases_m.append(spot.base_m)
                stripes = round(distance / 100.0)
                spot.put(props, ("countdown", stripes), partial(countdown_marker, stripes))
        gore = place.in_gore(exit_)
        if gore is not None:
            bases_m.append(gore.base_m)
            gore.put(props, ("gore sign", names[1]), partial(verge_sign, names[1], width_m=GORE_BOARD_M))
    return np.array(bases_m).reshape(-1, 3)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Spot:
    """A place where a sign stands."""

    base_m: Array
    """Its foot [m], shape (3,)."""
    yaw_rad: float
    """Where its face looks [rad]."""
    rise_m: float = 0.0
    """Height of the road above the foot, to a decimetre [m]."""

    def put(self, props: PropField, key: Hashable, make: Callable[[], Mesh]) -> None:
        props.put(key, make, self.base_m[None], self.yaw_rad)


class _Placer:
    """Finds ground for signs beside lanes."""

    def __init__(
        self, network: LaneNetwork, paved: Area, blocked: Area, overhead: Area, floor: HeightOf
    ) -> None:
        self._network, self._paved, self._blocked, self._floor = network, paved, blocked, floor
        self._overhead, self._rim = overhead, shapely.boundary(overhead)
        for area in (paved, blocked, overhead, self._rim):
            shapely.prepare(area)

    def beside(self, exit_: Exit, distance_m: float, away_m: float) -> _Spot | None:
        """On the verge, or on a parapet, some distance [m] before an exit and away from the road's edge."""
        for shift in SHIFTS_M:
            lane, station = self._upstream(exit_.through, distance_m + shift)
            if lane is None:
                return None
            pose = self._network.pose([lane], [station])
            heading, at = float(pose.heading_rad[0]), pose.position_m[0]
            left = np.array([-elementary.sin(heading), elementary.cos(heading)])
            kerb = self._network.lanes[lane].kerb_side * left
            line = at[:2] + np.arange(1.0, _WIDEST_M, _STEP_M)[:, None] * kerb
            off = shapely.distance(self._paved, shapely.points(line)) > 0.05
            if not off.any():
                continue
            edge = line[np.argmax(off)] - 0.5 * _STEP_M * kerb
            base_m = edge + away_m * kerb
            z = float(self._floor(base_m[None])[0])
            if self._is_free(base_m, away_m) and abs(at[2] - z) < LIFT_M:
                rise = max(round(float(at[2]) - z, 1), 0.0)
                return _Spot(base_m=np.append(base_m, z - 0.05), yaw_rad=heading + np.pi, rise_m=rise)
            base_m = edge + 0.5 * WALL_M * kerb
            if away_m < LARGE_M and self._is_on_parapet(base_m):
                top = float(at[2]) + PARAPET_M - 0.02
                return _Spot(base_m=np.append(base_m, top), yaw_rad=heading + np.pi, rise_m=-PARAPET_M)
        return None

    def in_gore(self, exit_: Exit) -> _Spot | None:
        """Between the ramp and the road, where both leave room."""
        lane = exit_.ramp
        for _ in range(2):
            info = self._network.lanes[lane]
            station = np.arange(0.0, info.length_m, 1.0)
            pose = self._network.pose([lane] * len(station), station)
            left = np.stack([-elementary.sin(pose.heading_rad), elementary.cos(pose.heading_rad)], axis=-1)
            inward = -info.kerb_side * left
            half = 0.5 * self._network.width_m([lane] * len(station), station)
            for away in GORE_AWAY_M:
                xy = pose.position_m[:, :2] + (half + away)[:, None] * inward
                z = self._floor(xy)
                free = shapely.distance(self._paved, shapely.points(xy)) > GORE_CLEAR_M
                free &= np.abs(pose.position_m[:, 2] - z) < LIFT_M
                if free.any():
                    row = int(np.argmax(free))
                    yaw = float(pose.heading_rad[row]) + np.pi
                    return _Spot(base_m=np.append(xy[row], z[row] - 0.05), yaw_rad=yaw)
            if not info.successors:
                return None
            lane = info.successors[0]
        return None

    def _is_free(self, base_m: Array, away_m: float) -> bool:
        point = shapely.points(base_m)
        if shapely.distance(self._overhead, point) < 1.0 or shapely.distance(self._blocked, point) < 1.0:
            return False
        return bool(shapely.distance(self._paved, point) > min(0.8 * away_m, 2.5))

    def _is_on_parapet(self, base_m: Array) -> bool:
        point = shapely.points(base_m)
        return bool(
            shapely.distance(self._rim, point) < RIM_M and shapely.distance(self._blocked, point) > 0.5
        )

    def _upstream(self, lane: int, distance_m: float) -> tuple[int | None, float]:
        """Lane and station at a distance [m] before a lane's end; None beyond the last exit or the map."""
        network, left = self._network, distance_m
        while True:
            info = network.lanes[lane]
            if left <= info.length_m:
                return lane, info.length_m - left
            left -= info.length_m
            # The deceleration lane begins somewhere; its neighbour comes from farther.
            while not info.predecessors and (inner := _beside(info, -info.kerb_side)) is not None:
                info = network.lanes[inner]
            before = [k for k in info.predecessors if _is_fast(network.lanes[k])]
            if not before or left > 2.0 * ADVANCE_M:
                return None, 0.0
            lane = _at_kerb(network, network.lanes[before[0]]).index
            ahead = {network.lanes[k].road_id for k in _alongside(network, network.lanes[lane])}
            if network.lanes[lane].junction_id is None and len(ahead) > 1:
                return None, 0.0


def _is_fast(lane: Lane) -> bool:
    return lane.type == "driving" and lane.speed_limit_mps >= FAST_MPS


def _alongside(network: LaneNetwork, lane: Lane) -> list[int]:
    """Successors of a lane and of all its neighbours of one direction."""
    first = lane
    while first.left is not None:
        first = network.lanes[first.left]
    successors = list(first.successors)
    while first.right is not None:
        first = network.lanes[first.right]
        successors += first.successors
    return successors


def _at_kerb(network: LaneNetwork, lane: Lane) -> Lane:
    while (outer := _beside(lane, lane.kerb_side)) is not None:
        lane = network.lanes[outer]
    return lane


def _beside(lane: Lane, side: int) -> int | None:
    """Lane of the same direction on a side: −1 right, 1 left."""
    return lane.left if side > 0 else lane.right


def _names(network: LaneNetwork, exit_: Exit, number: int) -> tuple[int, int, int]:
    """Rows of `STREET_NAMES`: where the fast road goes, and both places of the exit."""
    target = network.lanes[exit_.ramp].road_id
    first = (sum(target.encode()) + number) % len(STREET_NAMES)
    return (first + 3) % len(STREET_NAMES), first, (first + 5) % len(STREET_NAMES)
