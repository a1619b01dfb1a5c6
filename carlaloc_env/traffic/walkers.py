"""All walkers of the traffic, advanced together by steps of 50 ms."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.core.jit import same_types
from carlaloc_env.traffic.tables.lane_demand import weighted_order
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Occupancy
from carlaloc_env.traffic.tables.record_arrays import columns
from carlaloc_env.traffic.tables.vehicle_state import Drivers
from carlaloc_env.traffic.tables.walker_network import SIDEWALK, WalkerNetwork
from carlaloc_env.traffic.tables.walker_state import VehicleBoxes, WalkerState
from carlaloc_env.traffic.walker_step import walk

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

    def __init__(
        self, walker_network: WalkerNetwork, count: int, seed: int, drivers: Drivers, egos: int
    ) -> None:
        """Put all walkers on sidewalks.

        Args:
            walker_network: Sidewalks and crosswalks.
            count: Number of walkers.
            seed: Seed of their places and paces.
            drivers: Drivers of all vehicles and the egos, (N + C,).
            egos: Number of egos.

        Raises:
            ConfigError: there is no sidewalk, or not room enough.
        """
        self.walker_network = walker_network
        self.seed = seed
        self.state = columns(WalkerState, count)
        self.boxes = columns(VehicleBoxes, len(drivers.length_m))
        self.boxes.half_m[:, 0] = 0.5 * drivers.length_m
        self.boxes.half_m[:, 1] = 0.5 * drivers.width_m
        self.boxes.is_ego[len(drivers.length_m) - egos :] = True
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
        state.path_direction[:] = np.where(draw.random(count) < 0.5, 1, -1)
        state.side_m[:] = draw.uniform(0.2, 0.8, count)
        state.pace_mps[:] = np.clip(draw.normal(1.34, 0.26, count), 0.7, 2.1)
        rows = path.row_first[state.path] + np.minimum(
            (state.station_m / path.row_step_m[state.path]).astype(np.int64), path.row_count[state.path] - 1
        )
        tangent = row.tangent[rows]
        room = np.maximum(0.5 * row.width_m[rows] - 0.4, 0.0)
        lateral_offset = np.minimum(state.side_m, room) * state.path_direction * -path.own_side[state.path]
        state.position_m[...] = row.position_m[rows]
        state.position_m[:, 0] += lateral_offset * tangent[:, 1]
        state.position_m[:, 1] -= lateral_offset * tangent[:, 0]
        state.direction[...] = tangent * state.path_direction[:, None]

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
