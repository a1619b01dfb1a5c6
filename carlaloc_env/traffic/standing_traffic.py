"""Vehicles and walkers that stand about a town, for its images.

Traffic tables of a town, kept on disk, and the stations at which vehicles may start.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carlaloc_env.assets.catalog import VEHICLES, WALKERS
from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.core.files.array_files import arrays_hash
from carlaloc_env.map.config import SignalTiming
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.network_arrays import to_arrays
from carlaloc_env.map.routing.route import Route
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.town.build import KEPT_FILES
from carlaloc_env.town.town import Town
from carlaloc_env.traffic.population import catalog_of, draw_names, draw_tint
from carlaloc_env.traffic.signals import SignalPlan
from carlaloc_env.traffic.tables import record_arrays
from carlaloc_env.traffic.tables.lane_demand import lane_demand, walker_demand, weighted_order
from carlaloc_env.traffic.tables.lane_tables import Roads, build_roads
from carlaloc_env.traffic.tables.sidewalks import build_walker_network
from carlaloc_env.traffic.tables.walker_network import WalkerNetwork
from carlaloc_env.traffic.vehicles.ego_agent import LaneCells, build_cells
from carlaloc_env.traffic.vehicles.overlapping_lanes import Overlaps, find_overlaps

SPACING_M = 12.0
"""Least distance between two vehicles at the start [m]."""
KEEP_CLEAR_M = 20.0
"""Distance from the ego's start that stays empty [m]."""
PLATOON = 5
"""Vehicles that start one behind the other where roads are fast."""
_FAST_MPS = 70.0 / 3.6
"""Speed limit from which on traffic comes in platoons [m/s]."""
_END_ROOM_M = 7.0
"""Distance from both ends of a lane that stays empty at the start [m]."""
_NARROWEST_M = 2.5
"""Narrower lanes get no vehicle at the start [m]."""


class TownTables(NamedTuple):
    """Tables worked out of a town's lanes and its route."""

    demand: Array
    """Demand for each lane, as `lane_demand` gives it, (N,)."""
    roads: Roads
    """Lanes, junctions and their rules."""
    walker_network: WalkerNetwork
    """Sidewalks and crosswalks."""
    cells: LaneCells
    """Where driving lanes lie."""
    overlaps: Overlaps
    """Where they lie on each other."""


KeepTables = Callable[[Callable[[], TownTables]], TownTables]
"""Gives tables that were kept, or makes them by what it is called with."""


class TrafficTables:
    """Tables that are computed once per town and shared by all drives in it.

    Args:
        network: The lanes.
        route: The town's route: its streets are the town's main streets, and its lights are coordinated.
        keep: Gives the tables that were kept of them, or what it is handed makes anew.
    """

    def __init__(
        self, network: LaneNetwork, route: Route | None = None, *, keep: KeepTables | None = None
    ) -> None:
        self.network = network
        self.route = route
        self.route_m = None if route is None else route.position_m
        self._driving = np.array([lane.type == "driving" for lane in network.lanes], dtype=bool)
        self._demand, self.roads, self.walker_network, self.cells, self.overlaps = (
            self._made() if keep is None else keep(self._made)
        )
        self._plans: dict[SignalTiming, SignalPlan] = {}

    def _made(self) -> TownTables:
        network, driving = self.network, self._driving
        demand = lane_demand(network, self.route_m)
        roads = build_roads(network, demand)
        walker_network = build_walker_network(network, roads)
        walker_network.path.demand[:] = walker_demand(walker_network, self.route_m)
        after = [[n for n in lane.successors if driving[n]] for lane in network.lanes]
        return TownTables(
            demand=demand,
            roads=roads,
            walker_network=walker_network,
            cells=build_cells(roads, driving),
            overlaps=find_overlaps(network, driving, roads.lane.junction, after),
        )

    def signal_plan(self, timing: SignalTiming) -> SignalPlan:
        """Plan of the signals, worked out once for all beginnings of a timing."""
        at_once = replace(timing, offset_s=0.0)
        if at_once not in self._plans:
            self._plans[at_once] = SignalPlan.from_network(self.network, at_once, self.route, self._demand)
        return self._plans[at_once].later(timing.offset_s)

    def starting_positions(self, seed: int, keep_clear_m: Array) -> tuple[Index, Array]:
        """Lanes and stations [m] at which vehicles may start, in the order in which they are taken.

        They lie outside junctions, on lanes that lead into no dead end; those of main streets come first more
        often, by their lanes' demand. On fast roads they are taken by `PLATOON`, with the road between left
        empty.

        Args:
            seed: Seed of the traffic.
            keep_clear_m: Points [m] (K, 3) whose surroundings stay empty: the ego's start.
        """
        slots: list[tuple[int, float]] = []
        usable = self._driving & (self.roads.lane.junction < 0) & self.roads.lane.lasting
        for lane in np.flatnonzero(usable).tolist():
            room = float(self.roads.lane.length_m[lane]) - 2 * _END_ROOM_M
            for k in range(int(room // SPACING_M) + 1 if room > 0 else 0):
                slots.append((lane, _END_ROOM_M + k * SPACING_M))
        lanes = np.array([lane for lane, _ in slots], np.int64)
        stations = np.array([station for _, station in slots])
        if not len(lanes):
            return lanes, stations
        slot = np.round((stations - _END_ROOM_M) / SPACING_M).astype(np.int64)
        fast = self.network.speed_limit_mps(lanes, stations) > _FAST_MPS - 0.1
        first_of_platoon = np.arange(len(lanes)) - slot % PLATOON
        group = np.where(fast, np.maximum(first_of_platoon, 0), np.arange(len(lanes)))
        order = weighted_order(clock.stream(seed, "traffic/place"), self._demand[lanes], group)
        lanes, stations = lanes[order], stations[order]
        keep = self.network.width_m(lanes, stations) > _NARROWEST_M
        if len(keep_clear_m):
            away = self.network.pose(lanes, stations).position_m[:, None] - keep_clear_m[None]
            keep &= np.min(np.linalg.norm(away, axis=-1), axis=1) > KEEP_CLEAR_M
        return lanes[keep], stations[keep]


def kept_tables(town: Town, *, folder: Path | None = None) -> TrafficTables:
    """Tables of a town, from the cache when the same code made them of the same lanes and route before.

    Working them out takes an eighth of the time of making an environment.

    Args:
        town: The town.
        folder: Where files lie; the default cache when left out.
    """
    made_of = to_arrays(town.network)
    if town.route is not None:
        made_of["route_m"] = town.route.position_m
    return TrafficTables(
        town.network,
        town.route,
        keep=lambda make: cached(
            town.name,
            "traffic",
            module=__name__,
            make=make,
            to_arrays=record_arrays.to_arrays,
            from_arrays=partial(record_arrays.from_arrays, TownTables),
            content=arrays_hash(made_of),
            kept_files=KEPT_FILES,
            folder=folder,
        ),
    )


_PER_SIDEWALK_M = 45.0
"""Metres of sidewalk per walker."""


def standing_traffic(
    network: LaneNetwork, vehicles: int, *, seed: int = 0
) -> tuple[ActorCatalog, ActorFrame]:
    """Vehicles at the places where traffic starts, and walkers in mid-stride on the sidewalks.

    Args:
        network: Lanes of the town.
        vehicles: How many vehicles at most.
        seed: What stands where.
    """
    lanes, stations = TrafficTables(network).starting_positions(seed, np.zeros((0, 3)))
    drivers = network.pose(lanes[:vehicles], stations[:vehicles])
    draw = clock.stream(seed, "preview/traffic")
    names = draw_names(draw, {n: m.weight for n, m in VEHICLES.items()}, len(drivers.heading_rad))
    sidewalk = np.array(network.sidewalks, dtype=np.intp)
    length = network.tables.length_m[sidewalk] if len(sidewalk) else np.zeros(0)
    count = np.floor(length / _PER_SIDEWALK_M + draw.uniform(size=len(length))).astype(np.intp)
    strolled = np.repeat(sidewalk, count)
    people = network.pose(strolled, draw.uniform(size=len(strolled)) * np.repeat(length, count))
    walkers = draw_names(draw, {n: m.weight for n, m in WALKERS.items()}, len(strolled))
    tints = [draw_tint(draw, VEHICLES[n].tints) for n in names]
    tints += [draw_tint(draw, WALKERS[n].tints) for n in walkers]
    catalog = catalog_of(names, walkers, np.array(tints, np.uint8).reshape(-1, 3))
    about = np.where(draw.uniform(size=len(walkers)) < 0.5, np.pi, 0.0)
    frame = ActorFrame(
        position_m=np.concatenate([drivers.position_m, people.position_m]).astype(np.float32),
        heading_rad=np.concatenate([drivers.heading_rad, people.heading_rad + about]).astype(np.float32),
        pitch_rad=np.concatenate([drivers.pitch_rad, np.zeros(len(walkers))]).astype(np.float32),
        speed_mps=np.ones(len(tints), np.float32),
        travelled_m=draw.uniform(0.0, 20.0, len(tints)).astype(np.float32),
        steer_rad=np.zeros(len(tints), np.float32),
        lights=np.zeros(len(tints), np.uint8),
    )
    return catalog, frame
