"""All vehicles of the traffic, advanced together by steps of 50 ms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled
from carlaloc_env.traffic.junctions.approach import collect
from carlaloc_env.traffic.junctions.conflict_yielding import release_passed, wait_inside
from carlaloc_env.traffic.junctions.right_of_way import admit
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Presence, empty_presence, gather, sort_bodies
from carlaloc_env.traffic.tables.reservations import Requests, empty_requests, list_holders
from carlaloc_env.traffic.tables.vehicle_state import Drivers, Fleet, Habits, empty_fleet
from carlaloc_env.traffic.traffic_tables import TrafficTables
from carlaloc_env.traffic.vehicles.ego_agent import Cells, place_ego
from carlaloc_env.traffic.vehicles.lane_changes import think_of_changes
from carlaloc_env.traffic.vehicles.lane_plans import measure_crowd, plan_ahead
from carlaloc_env.traffic.vehicles.lateral_motion import move_aside
from carlaloc_env.traffic.vehicles.longitudinal import (
    be_courteous,
    drive,
    enter_lanes,
    look_ahead,
    stop_where_needed,
)
from carlaloc_env.traffic.vehicles.map_entries import pass_gates
from carlaloc_env.traffic.vehicles.overlapping_lanes import Comers, Overlaps, empty_comers, mind_overlaps
from carlaloc_env.traffic.vehicles.poses import put_poses
from carlaloc_env.traffic.vehicles.vehicle_lights import put_lights
from carlaloc_env.traffic.vehicles.yield_to_walkers import mind_walkers

_CROWD_EVERY = 20


@compiled
def _step(
    roads: Roads,
    overlaps: Overlaps,
    cells: Cells,
    drivers: Drivers,
    habits: Habits,
    fleet: Fleet,
    there: Presence,
    asks: Requests,
    comers: Comers,
    taken_by_walkers: NDArray[np.uint8],
    signals: NDArray[np.uint8],
    red_in_s: Array,
    ego: Array,
    open_share: Array,
    crowd: Array,
    last_change: Index,
    wanted: Array,
    step: int,
) -> None:
    """Everything that happens in 50 ms."""
    count = len(fleet.speed_mps) - 1
    if step % _CROWD_EVERY == 0:
        measure_crowd(roads, fleet, drivers.length_m, open_share, count, crowd)
    gather(there, roads, drivers, fleet, count)
    place_ego(there, cells, roads, fleet, ego)
    sort_bodies(there)
    list_holders(asks, fleet)
    look_ahead(there, roads, drivers, fleet, habits, wanted, count, step)
    be_courteous(there, roads, drivers, fleet, wanted, count)
    collect(asks, roads, drivers, fleet, habits, signals, red_in_s, count)
    admit(asks, there, roads, drivers, fleet)
    wait_inside(asks, roads, drivers, fleet, count)
    mind_overlaps(comers, overlaps, there, roads, drivers, fleet)
    mind_walkers(taken_by_walkers, roads, drivers, fleet, habits, count, step)
    stop_where_needed(drivers, fleet, wanted, count)
    think_of_changes(there, roads, drivers, fleet, habits, crowd, last_change, count, step)
    drive(fleet, wanted, count)
    move_aside(roads, drivers, fleet, count)
    enter_lanes(roads, crowd, fleet, count, habits.seed)
    pass_gates(there, roads, drivers, fleet, crowd, last_change, count, step, habits.seed)
    release_passed(roads, drivers, fleet, count)


@compiled
def _plan_all(roads: Roads, crowd: Array, fleet: Fleet, count: int, seed: int) -> None:
    for v in range(count):
        plan_ahead(roads, crowd, fleet, v, seed)


class Vehicles:
    """All vehicles of the traffic, advanced together by steps of 50 ms."""

    def __init__(self, tables: TrafficTables, drivers: Drivers, habits: Habits, open_share: Array) -> None:
        self.tables = tables
        self.drivers = drivers
        self.habits = habits
        self._open_share = open_share
        self.count = len(drivers.length_m) - 1
        self._position_m = np.zeros((self.count, 3))
        self._heading_rad = np.zeros(self.count)
        self._pitch_rad = np.zeros(self.count)
        self._roll_rad = np.zeros(self.count)
        self._steer_rad = np.zeros(self.count)
        self._lights = np.zeros(self.count, np.uint8)

    def place(self, lane: Index, station_m: Array) -> None:
        """Stand the vehicles at stations [m] of lanes, shape (N,), at rest."""
        roads, lanes = self.tables.roads, len(self.tables.roads.lane.length_m)
        self.fleet = empty_fleet(self.count)
        self.there = empty_presence(self.count, lanes)
        self._asks = empty_requests(self.count, lanes)
        self._comers = empty_comers(self.count)
        self._crowd = np.zeros(lanes)
        self._last_change = np.full(lanes, -(10**9), np.int64)
        self._wanted = np.zeros(self.count + 1)
        self.fleet.plan[: self.count, 0] = lane
        self.fleet.station_m[: self.count] = station_m
        before = roads.lane.before_first[lane]
        has_before = before < roads.lane.before_end[lane]
        self.fleet.past[: self.count, 0][has_before] = roads.before[before[has_before]]
        measure_crowd(roads, self.fleet, self.drivers.length_m, self._open_share, self.count, self._crowd)
        _plan_all(roads, self._crowd, self.fleet, self.count, self.habits.seed)

    def step(
        self,
        ego: Array,
        signals: NDArray[np.uint8],
        red_in_s: Array,
        taken_by_walkers: NDArray[np.uint8],
        step: int,
    ) -> None:
        """Advance by 50 ms.

        Args:
            ego: The ego in numbers, as `EgoView.numbers` gives them.
            signals: State of all signal heads.
            red_in_s: Time until each of them turns red [s].
            taken_by_walkers: What walkers do with each crossing: 0, WANTED or TAKEN.
            step: Number of the step.
        """
        tables = self.tables
        _step(
            tables.roads,
            tables.overlaps,
            tables.cells,
            self.drivers,
            self.habits,
            self.fleet,
            self.there,
            self._asks,
            self._comers,
            taken_by_walkers,
            signals,
            red_in_s,
            ego,
            self._open_share,
            self._crowd,
            self._last_change,
            self._wanted,
            step,
        )

    def lights(self) -> NDArray[np.uint8]:
        """Bits of lit lights, (N,)."""
        put_lights(self.tables.roads, self.fleet, self.count, self._lights)
        return self._lights.copy()

    def poses(self) -> tuple[Array, Array, Array, Array, Array]:
        """Box centre on the ground [m] (N, 3), heading, pitch, roll and steering angle [rad] (N,)."""
        put_poses(
            self.tables.roads,
            self.drivers,
            self.fleet,
            self.count,
            self._position_m,
            self._heading_rad,
            self._pitch_rad,
            self._roll_rad,
            self._steer_rad,
            np.empty(6),
            np.empty(6),
        )
        return self._position_m, self._heading_rad, self._pitch_rad, self._roll_rad, self._steer_rad
