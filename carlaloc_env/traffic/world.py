"""Traffic of a town: vehicles, walkers and signals, advanced by steps of 50 ms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.jit import same_types
from carlaloc_env.timeline.timeline import ActorFrame
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.traffic.actor_frames import new_arrays, put_actors, put_boxes
from carlaloc_env.traffic.config import TrafficConfig as TrafficConfig
from carlaloc_env.traffic.config import traffic_of_town as traffic_of_town
from carlaloc_env.traffic.population import draw_catalog, draw_drivers, draw_vehicles
from carlaloc_env.traffic.traffic_tables import TrafficTables
from carlaloc_env.traffic.vehicle_step import StepInput, Vehicles
from carlaloc_env.traffic.vehicles.ego_agent import EgoView
from carlaloc_env.traffic.walkers.walkers import Walkers

_NOWHERE = EgoView(position_m=(1e6, 1e6, 0.0), heading_rad=0.0, speed_mps=0.0)
"""An ego that is nowhere near the map."""


class TrafficWorld:
    """Vehicles, walkers and signals of one town.

    `reset` places all actors; each `step` moves them by 50 ms and returns their state.
    """

    def __init__(
        self, network: LaneNetwork, config: TrafficConfig, tables: TrafficTables | None = None
    ) -> None:
        self._network = network
        self._config = config
        names, tints = draw_vehicles(config)
        self._tables = tables or TrafficTables(network)
        self.signal_plan = self._tables.signal_plan(config.timing)
        drivers, parameters = draw_drivers(names, config), config.driver_parameters()
        open_fraction = self.signal_plan.open_fraction(self._tables.roads)
        self._vehicles = Vehicles(self._tables, drivers, parameters, open_fraction)
        self.catalog = draw_catalog(names, tints, config)
        self._put_actors, self._put_boxes = same_types(put_actors), same_types(put_boxes)

    def reset(self, ego: EgoView | None = None) -> ActorFrame:
        """State of all actors at time 0, after the warm-up.

        Raises:
            ConfigError: the vehicles or walkers do not fit on the map.
        """
        config = self._config
        keep_clear = np.array([ego.position_m]) if ego is not None else np.zeros((0, 3))
        lane, station = self._tables.starting_positions(config.seed, keep_clear)
        if len(lane) < config.vehicles:
            raise ConfigError(
                f"{config.vehicles} vehicles do not fit here; give --traffic dynamic,vehicles={len(lane)}"
            )
        self._vehicles.reset(lane[: config.vehicles], station[: config.vehicles])
        network, drivers = self._tables.walker_network, self._vehicles.drivers
        self._walkers = Walkers(network, config.walkers, config.seed, drivers)
        self._taken = np.zeros(len(self._tables.roads.crossing.lane), np.uint8)
        self._step = -round(config.warm_up_s * 1e9) // STEP_NS
        seen_ego = ego or _NOWHERE
        while self._step < 0:
            self._advance(seen_ego)
        self._vehicles.fleet.travelled_m[:] = 0.0
        self._walkers.state.travelled_m[:] = 0.0
        return self._frame()

    def step(self, ego: EgoView) -> ActorFrame:
        """State of all actors 50 ms later; they see the ego where it is now."""
        self._advance(ego)
        return self._frame()

    def signals(self, stamp_ns: int) -> NDArray[np.uint8]:
        """`SignalState` of every head at a time [ns]."""
        return self.signal_plan.at(stamp_ns).state

    def changing_lanes(self) -> NDArray[np.bool_]:
        """Which vehicles are moving from one lane to another, (N,)."""
        result: NDArray[np.bool_] = self._vehicles.fleet.change[:-1] < 1.0
        return result

    def speed_limits_mps(self) -> Array:
        """Speed limit where each vehicle drives [m/s], (N,)."""
        fleet = self._vehicles.fleet
        return self._network.speed_limit_mps(fleet.plan[:-1, 0], fleet.station_m[:-1])

    def _advance(self, ego: EgoView) -> None:
        signals, vehicles, walkers = self.signal_plan.at(self._step * STEP_NS), self._vehicles, self._walkers
        box = ego.box()
        if self._config.walkers:
            self._put_boxes(vehicles.fleet, vehicles.poses, box, walkers.boxes)
            walkers.step(
                self._tables.roads, vehicles.occupancy, self._taken, signals.state, signals.until_green_s
            )
        vehicles.step(StepInput(box, signals.state, signals.until_red_s, self._taken, self._step))
        self._step += 1

    def _frame(self) -> ActorFrame:
        walkers, lights = self._walkers.state, self._vehicles.lights()
        frame = new_arrays(len(self.catalog))
        self._put_actors(self._vehicles.fleet, self._vehicles.poses, walkers, frame)
        dark = np.zeros(len(self.catalog) - len(lights), np.uint8)
        return ActorFrame(**frame._asdict(), lights=np.concatenate([lights, dark]))
