"""Crossing decisions of walkers: whether to wait at the kerb, when to set out, which lanes to claim."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.tables.lane_tables import TAKEN, WANTED, Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy, index_after
from carlaloc_env.traffic.tables.walker_network import WalkerNetwork
from carlaloc_env.traffic.tables.walker_state import VehicleBoxes, WalkerState
from carlaloc_env.traffic.vehicles.neighbours import find_behind

_WAIT_BEFORE_M = 0.5
"""Distance to the carriageway at which walkers wait [m]."""
_SAFE_S = 1.5
"""Time that must be left when the lane has been crossed [s]."""
_BRAKE_MPS2 = 2.5
"""Walkers set out before vehicles that can stop with this braking [m/s²]."""
_CLAIM_S = 3.0
"""Walking time before a lane from which on it is kept free [s]."""
_HELD_UP_S = 4.0
"""A walker who stands longer on a crosswalk is held up [s]."""
_LEFT_M = 0.1
"""A walker held up and so far past a lane has left it [m]."""


@compiled
def wait_or_go(
    walker_network: WalkerNetwork,
    walkers: WalkerState,
    roads: Roads,
    occupancy: Occupancy,
    boxes: VehicleBoxes,
    signals: NDArray[np.uint8],
    red_for_s: Array,
    w: int,
) -> float:
    """Desired speed of walker w, who comes up to the kerb [m/s]; notes when the crossing begins."""
    if not _at_kerb(walker_network, walkers, w):
        return float(walkers.pace_mps[w])
    if not _may_cross(walker_network, walkers, roads, occupancy, boxes, signals, red_for_s, w):
        return 0.0
    walkers.crossing[w] = True
    return float(walkers.pace_mps[w])


@compiled
def _at_kerb(walker_network: WalkerNetwork, walkers: WalkerState, w: int) -> bool:
    """Whether walker w stands at the kerb, or is past it."""
    kerb_m, station_m = walker_network.path.kerb_m[walkers.path[w]], walkers.station_m[w]
    to_kerb_m = kerb_m[0] - station_m if walkers.path_direction[w] > 0 else station_m - kerb_m[1]
    return bool(to_kerb_m < _WAIT_BEFORE_M + 0.3)


@compiled
def _may_cross(
    walker_network: WalkerNetwork,
    walkers: WalkerState,
    roads: Roads,
    occupancy: Occupancy,
    boxes: VehicleBoxes,
    signals: NDArray[np.uint8],
    red_for_s: Array,
    w: int,
) -> bool:
    """Whether lights hold the traffic for long enough, and vehicles are far away or can stop."""
    paths, crossings, path = walker_network.path, walker_network.lane_crossing, walkers.path[w]
    pace, station_m = walkers.pace_mps[w], walkers.station_m[w]
    across = (paths.kerb_m[path, 1] - paths.kerb_m[path, 0]) / pace
    if _blocked(walker_network, roads, occupancy, path):
        return False
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        for i in range(crossings.head_first[k], crossings.head_end[k]):
            head = walker_network.head[i]
            if signals[head] > 1 or (signals[head] == 1 and red_for_s[head] < across + 0.5):
                return False
        row = crossings.crossing[k]
        lane, enter = roads.crossing.lane[row], roads.crossing.enter_m[row]
        until = (
            crossings.far_m[k] - station_m
            if walkers.path_direction[w] > 0
            else station_m - crossings.near_m[k]
        )
        clear = until / pace + _SAFE_S
        index = index_after(occupancy, lane, enter)
        owner, gap, speed = find_behind(occupancy, roads, lane, index, enter, -1, 0.0)
        if owner < 0 or gap > speed * clear:
            continue
        if boxes.is_ego[owner] or speed * speed > 2.0 * _BRAKE_MPS2 * max(gap - 1.5, 0.05):
            return False
    return True


@compiled
def _blocked(walker_network: WalkerNetwork, roads: Roads, occupancy: Occupancy, path: int) -> bool:
    """Whether a vehicle is on the crosswalk or touches it."""
    paths = walker_network.path
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        row = walker_network.lane_crossing.crossing[k]
        lane = roads.crossing.lane[row]
        enter, leave = roads.crossing.enter_m[row], roads.crossing.leave_m[row]
        for index in range(occupancy.first[lane], occupancy.first[lane + 1]):
            body = occupancy.order[index]
            centre, half = occupancy.body.centre_m[body], occupancy.body.half_m[body]
            if centre + half > enter - 0.3 and centre - half < leave + 0.3:
                return True
    return False


@compiled
def claim_crossings(
    walker_network: WalkerNetwork,
    walkers: WalkerState,
    roads: Roads,
    occupancy: Occupancy,
    taken: NDArray[np.uint8],
    w: int,
) -> None:
    """Claim the crossings that walker w passes soon; without lights, also while it waits for them.

    Writes `taken`, (C,): WANTED or TAKEN.
    """
    paths, crossings = walker_network.path, walker_network.lane_crossing
    path, station_m = walkers.path[w], walkers.station_m[w]
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        to_near, to_far = crossings.near_m[k] - station_m, crossings.far_m[k] - station_m
        if walkers.path_direction[w] < 0:
            to_near, to_far = station_m - crossings.far_m[k], station_m - crossings.near_m[k]
        # A walker held up on the crosswalk keeps the lane free that it stands in, not one it has left.
        held_up = walkers.crossing[w] and walkers.waited_s[w] > _HELD_UP_S
        if to_far < (_LEFT_M if held_up else -0.3) or (held_up and to_near > 0.3):
            continue
        if walkers.crossing[w]:
            if to_near < _CLAIM_S * walkers.pace_mps[w]:
                taken[crossings.crossing[k]] = TAKEN
        elif (
            _at_kerb(walker_network, walkers, w)
            and not _has_lights(walker_network, path)
            and not _blocked(walker_network, roads, occupancy, path)
        ):
            row = crossings.crossing[k]
            taken[row] = max(taken[row], WANTED)


@compiled
def _has_lights(walker_network: WalkerNetwork, path: int) -> bool:
    """Whether lights stop the traffic on a lane that a crosswalk's path crosses."""
    paths, crossings = walker_network.path, walker_network.lane_crossing
    for k in range(paths.lane_crossing_first[path], paths.lane_crossing_end[path]):
        if crossings.head_first[k] < crossings.head_end[k]:
            return True
    return False
