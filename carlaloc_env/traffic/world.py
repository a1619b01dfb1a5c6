"""Traffic of a town: vehicles, walkers and signals, advanced by steps of 50 ms.

State of all actors in the arrays of a frame: one compiled pass in place of many small ones.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

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
from carlaloc_env.traffic.tables.record_arrays import columns
from carlaloc_env.traffic.tables.vehicle_state import Fleet
from carlaloc_env.traffic.tables.walker_state import VehicleBoxes, WalkerState
from carlaloc_env.traffic.traffic_config import TrafficConfig
from carlaloc_env.traffic.vehicle_step import StepInput, Vehicles
from carlaloc_env.traffic.vehicles.ego_agent import EgoBoxes, EgoView
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
def put_boxes(fleet: Fleet, poses: VehiclePoses, egos: EgoBoxes, out: VehicleBoxes) -> None:
    """Write where N vehicles and C egos, the last rows, are for walkers."""
    vehicles = len(poses.heading_rad)
    for v in range(vehicles):
        out.position_m[v, 0], out.position_m[v, 1] = poses.position_m[v, 0], poses.position_m[v, 1]
        out.height_m[v] = poses.position_m[v, 2]
        sine, cosine = sin_cos(poses.heading_rad[v])
        out.direction[v, 0], out.direction[v, 1] = cosine, sine
        out.speed_mps[v] = fleet.speed_mps[v]
    for c in range(len(egos.speed_mps)):
        row = vehicles + c
        out.position_m[row, 0], out.position_m[row, 1] = egos.x_m[c], egos.y_m[c]
        out.height_m[row] = egos.z_m[c]
        out.direction[row, 0], out.direction[row, 1] = egos.cos[c], egos.sin[c]
        out.speed_mps[row] = egos.speed_mps[c]
        out.half_m[row, 0], out.half_m[row, 1] = egos.half_length_m[c], egos.half_width_m[c]


_NOWHERE = EgoView(position_m=(1e6, 1e6, 0.0), heading_rad=0.0, speed_mps=0.0)
"""An ego that is nowhere near the map."""


class TrafficWorld:
    """Vehicles, walkers and signals of one town.

    `reset` places all actors; each `step` moves them by 50 ms and returns their state.
    """

    def __init__(
        self,
        network: LaneNetwork,
        config: TrafficConfig,
        tables: TrafficTables | None = None,
        *,
        egos: int = 1,
    ) -> None:
        self._network = network
        self._config = config
        self._egos: Any = columns(EgoBoxes, egos)
        names, tints = draw_vehicles(config)
        self._tables = tables or TrafficTables(network)
        self.signal_plan = self._tables.signal_plan(config.timing)
        drivers, parameters = draw_drivers(names, config, egos), config.driver_parameters()
        open_fraction = self.signal_plan.open_fraction(self._tables.roads)
        self._vehicles = Vehicles(self._tables, drivers, parameters, open_fraction, egos)
        self.catalog = draw_catalog(names, tints, config)
        self._put_actors, self._put_boxes = same_types(put_actors), same_types(put_boxes)

    def reset(self, *egos: EgoView) -> ActorFrame:
        """State of all actors at time 0, after the warm-up; without egos, these are nowhere near.

        Raises:
            ConfigError: the vehicles or walkers do not fit on the map.
        """
        config = self._config
        keep_clear = np.array([ego.position_m for ego in egos]).reshape(-1, 3)
        lane, station = self._tables.starting_positions(config.seed, keep_clear)
        if len(lane) < config.vehicles:
            raise ConfigError(
                f"{config.vehicles} vehicles do not fit here; give --traffic dynamic,vehicles={len(lane)}"
            )
        self._vehicles.reset(lane[: config.vehicles], station[: config.vehicles])
        network, drivers = self._tables.walker_network, self._vehicles.drivers
        self._walkers = Walkers(network, config.walkers, config.seed, drivers, len(self._egos))
        self._taken = np.zeros(len(self._tables.roads.crossing.lane), np.uint8)
        self._step = -round(config.warm_up_s * 1e9) // STEP_NS
        seen = egos or (_NOWHERE,) * len(self._egos)
        while self._step < 0:
            self._advance(seen)
        self._vehicles.fleet.travelled_m[:] = 0.0
        self._walkers.state.travelled_m[:] = 0.0
        return self._frame()

    def step(self, *egos: EgoView) -> ActorFrame:
        """State of all actors 50 ms later; they see the egos where they are now."""
        self._advance(egos)
        return self._frame()

    def signals(self, stamp_ns: int) -> NDArray[np.uint8]:
        """`SignalState` of every head at a time [ns]."""
        return self.signal_plan.at(stamp_ns).state

    def changing_lanes(self) -> NDArray[np.bool_]:
        """Whether each vehicle is moving from one lane to another, (N,)."""
        result: NDArray[np.bool_] = self._vehicles.fleet.change[: self._vehicles.count] < 1.0
        return result

    def speed_limits_mps(self) -> Array:
        """Speed limit where each vehicle drives [m/s], (N,)."""
        fleet, count = self._vehicles.fleet, self._vehicles.count
        return self._network.speed_limit_mps(fleet.plan[:count, 0], fleet.station_m[:count])

    def _advance(self, egos: Sequence[EgoView]) -> None:
        signals, vehicles, walkers = self.signal_plan.at(self._step * STEP_NS), self._vehicles, self._walkers
        for c, ego in enumerate(egos):
            self._egos[c] = ego.box()
        if self._config.walkers:
            self._put_boxes(vehicles.fleet, vehicles.poses, self._egos, walkers.boxes)
            walkers.step(
                self._tables.roads, vehicles.occupancy, self._taken, signals.state, signals.until_green_s
            )
        vehicles.step(StepInput(self._egos, signals.state, signals.until_red_s, self._taken, self._step))
        self._step += 1

    def _frame(self) -> ActorFrame:
        walkers, lights = self._walkers.state, self._vehicles.lights()
        frame = new_arrays(len(self.catalog))
        self._put_actors(self._vehicles.fleet, self._vehicles.poses, walkers, frame)
        dark = np.zeros(len(self.catalog) - len(lights), np.uint8)
        return ActorFrame(**frame._asdict(), lights=np.concatenate([lights, dark]))
