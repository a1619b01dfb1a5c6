"""All walkers of the traffic, advanced together by steps of 50 ms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import rng
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.traffic.tables.lane_tables import Roads
from carlaloc_env.traffic.tables.occupancy import Presence
from carlaloc_env.traffic.tables.record_arrays import columns
from carlaloc_env.traffic.tables.sidewalk_tables import PAVEMENT, Ground
from carlaloc_env.traffic.tables.vehicle_state import Drivers, Fleet
from carlaloc_env.traffic.tables.walker_state import Boxes, Walking
from carlaloc_env.traffic.vehicles.poses import angle_of
from carlaloc_env.traffic.walkers.step import walk

_START_GAP_M = 5.0
_END_ROOM_M = 3.0
_LEAST_WIDTH_M = 0.9


class Walkers:
    """All walkers of the traffic.

    Speeds are drawn from N(1.34, 0.26) m/s (Helbing & Molnár 1995, after Weidmann). Walkers keep to
    the right of the pavement, cross at crosswalks and turn where a pavement ends.
    """

    def __init__(self, ground: Ground, count: int, seed: int, drivers: Drivers) -> None:
        """Put everybody on a pavement.

        Raises:
            ConfigError: there is no pavement, or not room enough.
        """
        self.ground = ground
        self.seed = seed
        self.state = columns(Walking, count)
        self.boxes = columns(Boxes, len(drivers.length_m))
        self.boxes.half_m[:, 0] = 0.5 * drivers.length_m
        self.boxes.half_m[:, 1] = 0.5 * drivers.width_m
        self._place(count)

    def _place(self, count: int) -> None:
        way, state = self.ground.way, self.state
        wide = np.minimum.reduceat(self.ground.row.width_m, way.row_first) if len(way.kind) else np.zeros(0)
        usable = np.flatnonzero((way.kind == PAVEMENT) & (way.length_m > 10.0) & (wide > _LEAST_WIDTH_M))
        if count and not len(usable):
            raise ConfigError(f"{count} walkers, but the map has no sidewalk; ask for 0 walkers")
        slots = [
            (int(k), _END_ROOM_M + place * _START_GAP_M)
            for k in usable
            for place in range(int((way.length_m[k] - 2 * _END_ROOM_M) // _START_GAP_M) + 1)
        ]
        if count > len(slots):
            raise ConfigError(f"{count} walkers do not fit on the pavements; ask for at most {len(slots)}")
        draw = rng.stream(self.seed, "traffic/walkers")
        chosen = draw.permutation(len(slots))[:count]
        state.way[:] = [slots[k][0] for k in chosen]
        state.station_m[:] = [slots[k][1] for k in chosen]
        state.sense[:] = np.where(draw.random(count) < 0.5, 1, -1)
        state.side_m[:] = draw.uniform(0.2, 0.8, count)
        state.pace_mps[:] = np.clip(draw.normal(1.34, 0.26, count), 0.7, 2.1)
        rows = way.row_first[state.way] + np.minimum(
            (state.station_m / way.row_step_m[state.way]).astype(np.int64), way.row_count[state.way] - 1
        )
        tangent = self.ground.row.tangent[rows]
        room = np.maximum(0.5 * self.ground.row.width_m[rows] - 0.4, 0.0)
        aside = np.minimum(state.side_m, room) * state.sense
        state.position_m[...] = self.ground.row.position_m[rows]
        state.position_m[:, 0] += aside * tangent[:, 1]
        state.position_m[:, 1] -= aside * tangent[:, 0]
        state.direction[...] = tangent * state.sense[:, None]

    def see_vehicles(self, fleet: Fleet, position_m: Array, heading_rad: Array, ego: Array) -> None:
        """Tell the walkers where vehicles and the ego are now."""
        boxes = self.boxes
        boxes.position_m[:-1] = position_m[:, :2]
        boxes.height_m[:-1] = position_m[:, 2]
        boxes.direction[:-1, 0] = np.cos(heading_rad)
        boxes.direction[:-1, 1] = np.sin(heading_rad)
        boxes.speed_mps[:-1] = fleet.speed_mps[:-1]
        boxes.position_m[-1] = ego[:2]
        boxes.height_m[-1] = ego[2]
        boxes.direction[-1] = ego[3:5]
        boxes.speed_mps[-1] = ego[5]
        boxes.half_m[-1] = ego[6:8]

    def step(
        self,
        roads: Roads,
        there: Presence,
        taken: NDArray[np.uint8],
        signals: NDArray[np.uint8],
        red_for_s: Array,
    ) -> None:
        """Advance by 50 ms; writes which crossings are taken, as `walk` says."""
        walk(self.ground, self.state, self.boxes, roads, there, taken, signals, red_for_s, self.seed)

    def poses(self) -> tuple[Array, Array, Array]:
        """Foot point [m] (W, 3), heading [rad] (W,), speed [m/s] (W,)."""
        state = self.state
        heading = np.array([angle_of(y, x) for x, y in state.direction.tolist()])
        velocity = state.velocity_mps
        return state.position_m.copy(), heading, np.sqrt(velocity[:, 0] ** 2 + velocity[:, 1] ** 2)
