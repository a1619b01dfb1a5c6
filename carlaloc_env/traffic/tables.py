"""What traffic needs to know of a town, and where its vehicles may start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.town.route_choice import lanes_that_go_on
from carlaloc_env.traffic.car_following import SpeedTables
from carlaloc_env.traffic.junctions import JunctionTable

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SPACING_M = 14.0
"""Least distance between two vehicles at the start [m]."""
KEEP_CLEAR_M = 20.0
"""Distance from the ego's start that stays empty [m]."""
_END_ROOM_M = 6.0


class TrafficTables:
    """Computed once per town and shared by all drives in it."""

    def __init__(self, network: LaneNetwork) -> None:
        self.network = network
        self.speeds = SpeedTables(network)
        self.junctions = JunctionTable(network)
        self.onward = lanes_that_go_on(network)
        self.turn_rad = _turns(network)

    def starting_places(self, seed: int, keep_clear_m: Array) -> tuple[Index, Array]:
        """Lanes and stations [m] at which vehicles may start, in the order in which they are taken.

        They lie outside junctions, on lanes that lead into no dead end.

        Args:
            seed: Seed of the traffic.
            keep_clear_m: Points [m] (K, 3) whose surroundings stay empty: the ego's start.
        """
        slots: list[tuple[int, float]] = []
        for lane in self.network.lanes:
            if lane.junction_id is not None or not self.onward[lane.index]:
                continue
            room = lane.length_m - 2 * _END_ROOM_M
            for k in range(int(room // SPACING_M) + 1 if room > 0 else 0):
                slots.append((lane.index, _END_ROOM_M + k * SPACING_M))
        order = rng.stream(seed, "traffic/place").permutation(len(slots))
        lanes = np.array([slots[k][0] for k in order], np.int64)
        stations = np.array([slots[k][1] for k in order])
        if len(keep_clear_m) and len(lanes):
            where = self.network.pose(lanes, stations).position_m
            distance = np.min(np.linalg.norm(where[:, None] - keep_clear_m[None], axis=-1), axis=1)
            lanes, stations = lanes[distance > KEEP_CLEAR_M], stations[distance > KEEP_CLEAR_M]
        return lanes, stations


def _turns(network: LaneNetwork) -> Array:
    """Heading change along every lane [rad], −π…π."""
    lane = np.arange(len(network.lanes))
    length = np.array([lane.length_m for lane in network.lanes])
    change = network.pose(lane, length).heading_rad - network.pose(lane, np.zeros(len(lane))).heading_rad
    result: Array = np.mod(change + np.pi, 2 * np.pi) - np.pi
    return result
