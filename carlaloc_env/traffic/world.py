"""Traffic of a town: vehicles, walkers and signals, advanced by steps of 50 ms.

State of all actors in the arrays of a frame: one compiled pass in place of many small ones.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.jit import compiled, same_types
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.timeline.actors import ActorFrame
from carlaloc_env.traffic.population import draw_catalog, draw_drivers, draw_vehicles
from carlaloc_env.traffic.standing_traffic import TrafficTables
from carlaloc_env.traffic.tables.vehicle_state import Fleet
from carlaloc_env.traffic.tables.walker_state import VehicleBoxes, WalkerState
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicle_step import StepInput, Vehicles
from carlaloc_env.traffic.vehicles.ego_agent import EgoBox, EgoView
from carlaloc_env.traffic.vehicles.poses import VehiclePoses, angle_of
from carlaloc_env.traffic.walkers import Walkers


class FrameArrays(NamedTuple):
    """Arrays of an `ActorFrame`, named as there: N vehicles, then W walkers."""

    position_m: NDArray[np.float32]
    """(N + W, 3)."""
    heading_rad: NDArray[np.float32]
    pitch_rad: NDArray[np.float32]
    roll_rad: NDArray[np.float32]
    speed_mps: NDArray[np.float32]
    travelled_m: NDArray[np.float32]
    steer_rad: NDArray[np.float32]


def new_arrays(count: int) -> FrameArrays:
    """Zeros for so many actors."""
    return FrameArrays(np.zeros((count, 3), np.float32), *(np.zeros(count, np.float32) for _ in range(6)))


@compiled
def put_actors(fleet: Fleet, poses: VehiclePoses, walkers: WalkerState, out: FrameArrays) -> None:
    """Write the state of N vehicles and W walkers; pitch, roll and steering of walkers stay as they are."""
    vehicles = len(poses.heading_rad)
    for v in range(vehicles):
        for k in range(3):
            out.position_m[v, k] = poses.position_m[v, k]
        out.heading_rad[v] = poses.heading_rad[v]
        out.pitch_rad[v] = poses.pitch_rad[v]
        out.roll_rad[v] = poses.roll_rad[v]
        out.speed_mps[v] = fleet.speed_mps[v]
        out.travelled_m[v] = fleet.travelled_m[v]
        out.steer_rad[v] = poses.steer_rad[v]
    for w in range(len(walkers.path)):
        row = vehicles + w
        for k in range(3):
            out.position_m[row, k] = walkers.position_m[w, k]
        out.heading_rad[row] = angle_of(walkers.direction[w, 1], walkers.direction[w, 0])
        east, north = walkers.velocity_mps[w, 0], walkers.velocity_mps[w, 1]
        out.speed_mps[row] = np.sqrt(east * east + north * north)
        out.travelled_m[row] = walkers.travelled_m[w]


@compiled
def put_boxes(fleet: Fleet, poses: VehiclePoses, ego: EgoBox, out: VehicleBoxes) -> None:
    """Write where N vehicles and the ego, the last row, are for walkers."""
    vehicles = len(poses.heading_rad)
    for v in range(vehicles):
        out.position_m[v, 0], out.position_m[v, 1] = poses.position_m[v, 0], poses.position_m[v, 1]
        out.height_m[v] = poses.position_m[v, 2]
        sine, cosine = sin_cos(poses.heading_rad[v])
        out.direction[v, 0], out.direction[v, 1] = cosine, sine
        out.speed_mps[v] = fleet.speed_mps[v]
    out.position_m[vehicles, 0], out.position_m[vehicles, 1] = ego.x_m, ego.y_m
    out.height_m[vehicles] = ego.z_m
    out.direction[vehicles, 0], out.direction[vehicles, 1] = ego.cos, ego.sin
    out.speed_mps[vehicles] = ego.speed_mps
    out.half_m[vehicles, 0], out.half_m[vehicles, 1] = ego.half_length_m, ego.half_width_m


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
        """Whether each vehicle is moving from one lane to another, (N,)."""
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
