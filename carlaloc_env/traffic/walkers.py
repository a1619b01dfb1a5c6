"""All walkers of the traffic, advanced together by steps of 50 ms.

Step of all walkers: along their paths, past each other, over the road when they may.
"""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.jit import compiled, same_types
from carlaloc_env.traffic.tables.lane_reachability import CROSSWALK, SIDEWALK, WalkerNetwork, weighted_order
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.record_arrays import columns, hash_uniform
from carlaloc_env.traffic.tables.vehicle_state import STEP_S, Drivers, VehicleBoxes, WalkerState
from carlaloc_env.traffic.walker_steering import claim_crossings, move, wait_or_go

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
        boxes: Boxes of vehicles and the ego, (N + 1,).
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
                walkers.sense[w], walkers.waited_s[w] = -walkers.sense[w], 0.0
            claim_crossings(walker_network, walkers, roads, occupancy, taken, w)
        move(walker_network, walkers, boxes, w, desired_mps)
        _follow_path(walker_network, walkers, w, seed)


@compiled
def _follow_path(walker_network: WalkerNetwork, walkers: WalkerState, w: int, seed: int) -> None:
    """Let walker w take crosswalks, go on to the path that follows, turn round where none does."""
    path, sense, station = walkers.path[w], walkers.sense[w], walkers.station_m[w]
    if walker_network.path.kind[path] == SIDEWALK:
        if _take_crosswalk(walker_network, walkers, w, seed):
            return
        over = station - walker_network.path.length_m[path] if sense > 0 else -station
        if over > -0.25:
            _next_sidewalk(walker_network, walkers, w, seed)
        return
    end = 1 if sense > 0 else 0
    left = walker_network.path.length_m[path] - station if sense > 0 else station
    if left < 0.3:
        sidewalk = walker_network.landing[path, end]
        walkers.path[w] = sidewalk
        walkers.station_m[w] = walker_network.landing_m[path, end]
        walkers.sense[w] = 1 if hash_uniform(seed, _TURN, w, walkers.draws[w]) < 0.5 else -1
        walkers.crossing[w] = False
        walkers.draws[w] += 1


@compiled
def _take_crosswalk(walker_network: WalkerNetwork, walkers: WalkerState, w: int, seed: int) -> bool:
    """Let walker w turn onto a crosswalk that it passes in this step, by chance `CROSSES`; whether it did."""
    path, station = walkers.path[w], walkers.station_m[w]
    distance = walkers.pace_mps[w] * STEP_S
    for k in range(walker_network.path.entry_first[path], walker_network.path.entry_end[path]):
        passed = (station - walker_network.entry.station_m[k]) * walkers.sense[w]
        if not 0.0 <= passed < distance:
            continue
        walkers.draws[w] += 1
        if hash_uniform(seed, _CROSS, w, walkers.draws[w]) < CROSSES:
            walkers.path[w] = walker_network.entry.crosswalk[k]
            end = walker_network.entry.end[k]
            walkers.sense[w] = 1 if end == 0 else -1
            walkers.station_m[w] = 0.0 if end == 0 else walker_network.path.length_m[walkers.path[w]]
            walkers.crossing[w] = False
            return True
    return False


@compiled
def _next_sidewalk(walker_network: WalkerNetwork, walkers: WalkerState, w: int, seed: int) -> None:
    """Let walker w go on to a joining sidewalk, drawn by its demand, or stroll back."""
    path = walkers.path[w]
    end = 1 if walkers.sense[w] > 0 else 0
    first, last = walker_network.path.join_first[path, end], walker_network.path.join_end[path, end]
    walkers.draws[w] += 1
    path_demand = walker_network.path.demand
    total = _STROLLS * path_demand[path]
    for k in range(first, last):
        total += path_demand[walker_network.join_path[k]]
    left = hash_uniform(seed, _JOIN, w, walkers.draws[w]) * total - _STROLLS * path_demand[path]
    if first == last or left < 0.0:
        walkers.sense[w] = -walkers.sense[w]
        walkers.station_m[w] = min(max(walkers.station_m[w], 0.3), walker_network.path.length_m[path] - 0.3)
        return
    pick = first
    while pick < last - 1 and left >= path_demand[walker_network.join_path[pick]]:
        left -= path_demand[walker_network.join_path[pick]]
        pick += 1
    walkers.path[w] = walker_network.join_path[pick]
    from_start = walker_network.join_end[pick] == 0
    walkers.sense[w] = 1 if from_start else -1
    walkers.station_m[w] = 0.0 if from_start else walker_network.path.length_m[walkers.path[w]]


_START_GAP_M = 5.0
"""Distance between two walkers at the start [m]."""
_END_ROOM_M = 3.0
"""Distance from a sidewalk's ends that stays empty at the start [m]."""
_LEAST_WIDTH_M = 0.9
"""Narrower sidewalks get no walker at the start [m]."""


class Walkers:
    """All walkers of the traffic.

    Speeds are drawn from N(1.34, 0.26) m/s (Helbing & Molnár 1995, after Weidmann). Walkers keep to
    the right of the sidewalk, or to the left as cars do, cross at crosswalks and turn where a sidewalk ends.
    """

    def __init__(self, walker_network: WalkerNetwork, count: int, seed: int, drivers: Drivers) -> None:
        """Put all walkers on sidewalks.

        Args:
            walker_network: Sidewalks and crosswalks.
            count: Number of walkers.
            seed: Seed of their places and paces.
            drivers: Drivers of all vehicles and the ego, (N + 1,).

        Raises:
            ConfigError: there is no sidewalk, or not room enough.
        """
        self.walker_network = walker_network
        self.seed = seed
        self.state = columns(WalkerState, count)
        self.boxes = columns(VehicleBoxes, len(drivers.length_m))
        self.boxes.half_m[:, 0] = 0.5 * drivers.length_m
        self.boxes.half_m[:, 1] = 0.5 * drivers.width_m
        self._walk = same_types(walk)
        self._start(count)

    def _start(self, count: int) -> None:
        path, row, state = self.walker_network.path, self.walker_network.row, self.state
        wide = np.minimum.reduceat(row.width_m, path.row_first) if len(path.kind) else np.zeros(0)
        usable = np.flatnonzero((path.kind == SIDEWALK) & (path.length_m > 10.0) & (wide > _LEAST_WIDTH_M))
        if count and not len(usable):
            raise ConfigError(
                f"{count} walkers, but no sidewalk on the map; give --traffic dynamic,walkers=0"
            )
        slots = [
            (int(k), _END_ROOM_M + slot * _START_GAP_M)
            for k in usable
            for slot in range(int((path.length_m[k] - 2 * _END_ROOM_M) // _START_GAP_M) + 1)
        ]
        if count > len(slots):
            raise ConfigError(
                f"{count} walkers do not fit on the sidewalks; give --traffic dynamic,walkers={len(slots)}"
            )
        draw = clock.stream(self.seed, "traffic/walkers")
        demand = path.demand[np.array([k for k, _ in slots], np.int64)]
        chosen = weighted_order(draw, demand)[:count]
        state.path[:] = [slots[k][0] for k in chosen]
        state.station_m[:] = [slots[k][1] for k in chosen]
        state.sense[:] = np.where(draw.random(count) < 0.5, 1, -1)
        state.side_m[:] = draw.uniform(0.2, 0.8, count)
        state.pace_mps[:] = np.clip(draw.normal(1.34, 0.26, count), 0.7, 2.1)
        rows = path.row_first[state.path] + np.minimum(
            (state.station_m / path.row_step_m[state.path]).astype(np.int64), path.row_count[state.path] - 1
        )
        tangent = row.tangent[rows]
        room = np.maximum(0.5 * row.width_m[rows] - 0.4, 0.0)
        lateral_offset = np.minimum(state.side_m, room) * state.sense * -path.own_side[state.path]
        state.position_m[...] = row.position_m[rows]
        state.position_m[:, 0] += lateral_offset * tangent[:, 1]
        state.position_m[:, 1] -= lateral_offset * tangent[:, 0]
        state.direction[...] = tangent * state.sense[:, None]

    def step(
        self,
        roads: Roads,
        occupancy: Occupancy,
        taken: NDArray[np.uint8],
        signals: NDArray[np.uint8],
        red_for_s: Array,
    ) -> None:
        """Advance by 50 ms; writes which crossings are taken, as `walk` says."""
        walkers = self.walker_network, self.state, self.boxes
        self._walk(*walkers, roads, occupancy, taken, signals, red_for_s, self.seed)
