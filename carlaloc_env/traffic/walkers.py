"""Walkers on pavements: along sidewalk lanes, to their end and on, or back."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.clock import STEP_NS
from carlaloc_env.errors import ConfigError
from carlaloc_env.geometry import wrap_angle
from carlaloc_env.town.network import LaneNetwork

Array = NDArray[np.float64]

STEP_S = STEP_NS / 1e9
_TURN_RADPS = 2.5
_START_GAP_M = 6.0
_TURN_BACK_M = 0.4


class Walkers:
    """All walkers of the traffic, advanced together by steps of 50 ms.

    Speeds are drawn from N(1.34, 0.26) m/s (Helbing & Molnár 1995, after Weidmann), walkers start
    on the right of the pavement and turn on the spot where it ends.
    """

    def __init__(self, network: LaneNetwork, count: int, seed: int) -> None:
        self._network = network
        self._length = np.array([lane.length_m for lane in network.lanes])
        usable = [lane.index for lane in network.lanes if lane.type == "sidewalk" and lane.length_m > 10.0]
        if count and not usable:
            raise ConfigError(f"{count} walkers, but the map has no sidewalk; ask for 0 walkers")
        draw = rng.stream(seed, "traffic/walkers")
        slots = [
            (lane, 3.0 + k * _START_GAP_M)
            for lane in usable
            for k in range(int((self._length[lane] - 6.0) // _START_GAP_M))
        ]
        if count > len(slots):
            raise ConfigError(f"{count} walkers do not fit on the pavements; ask for at most {len(slots)}")
        chosen = draw.permutation(len(slots))[:count]
        self._lane = np.array([slots[k][0] for k in chosen], np.int64)
        self._station = np.array([slots[k][1] for k in chosen], np.float64)
        self._way = np.where(draw.random(count) < 0.5, 1, -1)
        self._side_m = -self._way * draw.uniform(0.25, 0.7, count)
        self._pace_mps = np.clip(draw.normal(1.34, 0.26, count), 0.7, 2.1)
        self.travelled_m = np.zeros(count)
        self.speed_mps = self._pace_mps.copy()
        self.heading_rad = self._wanted_heading() if count else np.zeros(0)

    def step(self) -> None:
        """Advance by 50 ms."""
        if not len(self._lane):
            return
        wanted = self._wanted_heading()
        error = wrap_angle(wanted - self.heading_rad)
        self.heading_rad = self.heading_rad + np.clip(error, -_TURN_RADPS * STEP_S, _TURN_RADPS * STEP_S)
        self.speed_mps = np.where(np.abs(error) < 0.6, self._pace_mps, 0.0)
        path = self.speed_mps * STEP_S
        self._station = self._station + self._way * path
        self.travelled_m = self.travelled_m + path
        for walker in np.flatnonzero(
            (self._station < _TURN_BACK_M) | (self._station > self._length[self._lane] - _TURN_BACK_M)
        ):
            self._go_on(int(walker))

    def poses(self) -> tuple[Array, Array, Array]:
        """Foot point [m] (N, 3), heading [rad] (N,), pitch [rad] (N,) of all walkers."""
        if not len(self._lane):
            return np.zeros((0, 3)), np.zeros(0), np.zeros(0)
        pose = self._network.pose(self._lane, self._station)
        left = np.stack([-np.sin(pose.heading_rad), np.cos(pose.heading_rad)], axis=-1)
        position = pose.position_m.copy()
        width = self._network.width_m(self._lane, self._station)
        room = np.maximum(0.5 * width - 0.4, 0.0)
        side = np.clip(self._side_m, -room, room)
        position[:, :2] += side[:, None] * left
        return position, self.heading_rad, np.zeros(len(self._lane))

    def _wanted_heading(self) -> Array:
        heading = self._network.pose(self._lane, self._station).heading_rad
        result: Array = np.where(self._way > 0, heading, heading + np.pi)
        return result

    def _go_on(self, w: int) -> None:
        lane = self._network.lanes[self._lane[w]]
        ahead = lane.successors if self._way[w] > 0 else lane.predecessors
        nexts = [index for index in ahead if self._network.lanes[index].type == "sidewalk"]
        nexts = [index for index in nexts if self._length[index] > 1.0]
        length = self._length[self._lane[w]]
        over = -self._station[w] if self._way[w] < 0 else self._station[w] - length
        if nexts and over > 0:
            self._lane[w] = nexts[0]
            self._station[w] = over if self._way[w] > 0 else self._length[nexts[0]] - over
        elif not nexts and over > -_TURN_BACK_M:
            self._station[w] = np.clip(self._station[w], _TURN_BACK_M, length - _TURN_BACK_M)
            self._way[w] = -self._way[w]
