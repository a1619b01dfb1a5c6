"""Vehicles of the traffic, advanced together by steps of 50 ms."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.jit import compiled, same_types
from carlaloc_env.traffic.junction_requests import collect_requests
from carlaloc_env.traffic.right_of_way import admit
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy, empty_occupancy, gather_bodies, sort_bodies
from carlaloc_env.traffic.tables.record_arrays import columns
from carlaloc_env.traffic.tables.request_queue import Requests, empty_requests, list_holders
from carlaloc_env.traffic.tables.vehicle_state import (
    DriverParameters,
    Drivers,
    Fleet,
    empty_fleet,
)
from carlaloc_env.traffic.vehicles.ego_agent import EgoBoxes, LaneCells, add_ego, box_of
from carlaloc_env.traffic.vehicles.lane_changes import decide_lane_changes
from carlaloc_env.traffic.vehicles.lane_plans import measure_density, plan_ahead
from carlaloc_env.traffic.vehicles.lateral import move_laterally
from carlaloc_env.traffic.vehicles.lights import put_lights
from carlaloc_env.traffic.vehicles.longitudinal import (
    advance_lanes,
    brake_for_stops,
    follow_leaders,
    integrate_motion,
    make_room_for_changes,
)
from carlaloc_env.traffic.vehicles.map_entries import reenter_map
from carlaloc_env.traffic.vehicles.overlapping_lanes import (
    Approaches,
    Overlaps,
    empty_approaches,
    gather_approaches,
    yield_at_overlaps,
)
from carlaloc_env.traffic.vehicles.poses import VehiclePoses, put_poses
from carlaloc_env.traffic.vehicles.walker_priority import yield_to_walkers
from carlaloc_env.traffic.yielding import release_passed, wait_inside

DENSITY_EVERY = 20
"""Steps between two measurements of traffic density: one second."""


class VehicleMap(NamedTuple):
    """Tables of a town that vehicles read; fixed."""

    roads: Roads
    """Lanes, their samples, paths, zones and crossings."""
    overlaps: Overlaps
    """Pieces of lanes on which another lane lies."""
    cells: LaneCells
    """Samples of driving lanes by square cells."""
    open_fraction: Array
    """Fraction of time for which lights let vehicles into each lane, (lanes,)."""


class Traffic(NamedTuple):
    """Vehicles, their drivers, and what one step works out about them; arrays are written in place."""

    drivers: Drivers
    """Fixed properties, the egos in the last rows, (N + C,)."""
    parameters: DriverParameters
    """What applies to all drivers."""
    fleet: Fleet
    """State, the egos in the last rows, (N + C,)."""
    occupancy: Occupancy
    """Bodies on every lane."""
    requests: Requests
    """Requests to enter junctions, and the vehicles admitted."""
    approaches: Approaches
    """Vehicles that come up to lanes that lie on each other."""
    density: Array
    """Density of each stretch and queue of each junction lane, as `measure_density` says, (lanes,)."""
    last_change: Index
    """Step at which a vehicle last moved into each lane, (lanes,)."""
    desired_mps2: Array
    """Acceleration that each driver wants [m/s²], (N + C,)."""


class StepInput(NamedTuple):
    """Rest of the world as vehicles see it in one step."""

    egos: EgoBoxes
    """Boxes of the egos, (C,)."""
    signals: NDArray[np.uint8]
    """`SignalState` of each head, (S,)."""
    red_in_s: Array
    """Time until each head turns red [s], (S,)."""
    taken_by_walkers: NDArray[np.uint8]
    """What walkers do with each crossing: 0, WANTED or TAKEN, (C,)."""
    step: int
    """Number of the step, of 50 ms."""


@compiled
def _observe(area: VehicleMap, traffic: Traffic, seen: StepInput) -> bool:
    """List bodies on lanes and approaches to overlaps; False when their tables have too few rows.

    It changes nothing that it reads, so that it can be repeated with larger tables.
    """
    roads, drivers, fleet, occupancy = area.roads, traffic.drivers, traffic.fleet, traffic.occupancy
    count = len(fleet.speed_mps) - len(seen.egos.speed_mps)
    if seen.step % DENSITY_EVERY == 0:
        measure_density(roads, fleet, drivers.length_m, area.open_fraction, count, traffic.density)
    gather_bodies(occupancy, roads, drivers, fleet, count)
    for ego in range(len(seen.egos.speed_mps)):
        add_ego(occupancy, area.cells, roads, fleet, count + ego, box_of(seen.egos, ego))
    if occupancy.used[0] > len(occupancy.order):
        return False
    sort_bodies(occupancy)
    gather_approaches(traffic.approaches, area.overlaps, occupancy, roads, drivers, fleet, count)
    return bool(traffic.approaches.used[0] <= len(traffic.approaches.entry.row))


@compiled
def _advance(area: VehicleMap, traffic: Traffic, seen: StepInput) -> None:
    """Decide and move all vehicles by 50 ms."""
    roads, drivers, parameters, fleet = area.roads, traffic.drivers, traffic.parameters, traffic.fleet
    occupancy, requests, density = traffic.occupancy, traffic.requests, traffic.density
    desired, last_change, step = traffic.desired_mps2, traffic.last_change, seen.step
    count = len(fleet.speed_mps) - len(seen.egos.speed_mps)
    list_holders(requests, fleet)
    follow_leaders(occupancy, roads, drivers, fleet, parameters, desired, count, step)
    make_room_for_changes(occupancy, roads, drivers, fleet, desired, count)
    collect_requests(requests, roads, drivers, fleet, parameters, seen.signals, seen.red_in_s, count)
    admit(requests, occupancy, roads, drivers, fleet)
    wait_inside(requests, roads, drivers, fleet, seen.egos, count)
    yield_at_overlaps(traffic.approaches, area.overlaps, fleet)
    yield_to_walkers(seen.taken_by_walkers, roads, drivers, fleet, parameters, count, step)
    brake_for_stops(drivers, fleet, desired, count)
    decide_lane_changes(occupancy, roads, drivers, fleet, parameters, density, last_change, count, step)
    integrate_motion(fleet, desired, count)
    move_laterally(roads, drivers, fleet, count)
    advance_lanes(roads, density, fleet, count, parameters.seed)
    reenter_map(occupancy, roads, drivers, fleet, density, last_change, count, step, parameters.seed)
    release_passed(roads, drivers, fleet, count)


@compiled
def _step(
    area: VehicleMap, traffic: Traffic, seen: StepInput, poses: VehiclePoses, lights: NDArray[np.uint8]
) -> bool:
    """Advance all vehicles by 50 ms, unless a table has too few rows; write their poses and lights."""
    if not _observe(area, traffic, seen):
        return False
    _advance(area, traffic, seen)
    _show(area, traffic, poses, lights)
    return True


@compiled
def _show(area: VehicleMap, traffic: Traffic, poses: VehiclePoses, lights: NDArray[np.uint8]) -> None:
    """Write poses and lights of all vehicles."""
    put_poses(area.roads, traffic.drivers, traffic.fleet, poses)
    put_lights(area.roads, traffic.fleet, len(lights), lights)


@compiled
def _plan_all(roads: Roads, density: Array, fleet: Fleet, count: int, seed: int) -> None:
    """Plan the lanes ahead of the first `count` vehicles."""
    for v in range(count):
        plan_ahead(roads, density, fleet, v, seed)


class Vehicles:
    """Vehicles of the traffic, advanced together by steps of 50 ms."""

    def __init__(
        self,
        tables: TrafficTables,
        drivers: Drivers,
        parameters: DriverParameters,
        open_fraction: Array,
        egos: int,
    ) -> None:
        self.tables = tables
        self.drivers = drivers
        self.parameters = parameters
        self.count = len(drivers.length_m) - egos
        self._map = VehicleMap(tables.roads, tables.overlaps, tables.cells, open_fraction)
        self.poses = columns(VehiclePoses, self.count)
        """Poses of all vehicles, (N,); the next step writes them anew."""
        self._lights = np.zeros(self.count, np.uint8)
        self._step = same_types(_step)

    @property
    def fleet(self) -> Fleet:
        """State of the vehicles; the last rows are the egos, (N + C,)."""
        return self.traffic.fleet

    @property
    def occupancy(self) -> Occupancy:
        """Bodies on every lane, as of the last step."""
        return self.traffic.occupancy

    def reset(self, lane: Index, station_m: Array) -> None:
        """Stand the vehicles at stations [m] of lanes, (N,) each, at rest."""
        roads, lanes = self.tables.roads, len(self.tables.roads.lane.length_m)
        egos = len(self.drivers.length_m) - self.count
        fleet, density = empty_fleet(self.count, egos), np.zeros(lanes)
        self.traffic = Traffic(
            drivers=self.drivers,
            parameters=self.parameters,
            fleet=fleet,
            occupancy=empty_occupancy(self.count, lanes),
            requests=empty_requests(self.count, egos, lanes),
            approaches=empty_approaches(self.count),
            density=density,
            last_change=np.full(lanes, -(10**9), np.int64),
            desired_mps2=np.zeros(len(fleet.speed_mps)),
        )
        fleet.plan[: self.count, 0] = lane
        fleet.station_m[: self.count] = station_m
        before = roads.lane.before_first[lane]
        has_before = before < roads.lane.before_end[lane]
        fleet.past[: self.count, 0][has_before] = roads.before[before[has_before]]
        open_fraction = self._map.open_fraction
        measure_density(roads, fleet, self.drivers.length_m, open_fraction, self.count, density)
        _plan_all(roads, density, fleet, self.count, self.parameters.seed)
        _show(self._map, self.traffic, self.poses, self._lights)

    def step(self, seen: StepInput) -> None:
        """Advance by 50 ms; tables of bodies and approaches grow when they are full."""
        while not self._step(self._map, self.traffic, seen, self.poses, self._lights):
            self._grow()

    def _grow(self) -> None:
        """Give the table that was too small twice the rows that it needs."""
        traffic, lanes = self.traffic, len(self.traffic.density)
        bodies, approaches = int(traffic.occupancy.used[0]), int(traffic.approaches.used[0])
        if bodies > len(traffic.occupancy.order):
            self.traffic = traffic._replace(occupancy=empty_occupancy(self.count, lanes, 2 * bodies))
        else:
            self.traffic = traffic._replace(approaches=empty_approaches(self.count, 2 * approaches))

    def lights(self) -> NDArray[np.uint8]:
        """Bits of lit lights, (N,)."""
        return self._lights.copy()
