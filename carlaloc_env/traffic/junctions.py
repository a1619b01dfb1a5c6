"""Who may enter a junction: a lane through it is reserved as a whole, conflicts are known beforehand.

A vehicle is admitted to a junction lane when its signal permits, no conflicting reservation is in
the way, no vehicle of higher rank would arrive within the accepted gap, and the lane behind the
junction has room for it. It keeps the reservation until its tail has left.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.geometry import wrap_angle
from carlaloc_env.town.network import LaneNetwork

Array = NDArray[np.float64]

_SAMPLE_M = 0.5
_CLEAR_M = 2.5
"""Centre lines closer than this conflict: two swept widths of 2.2 m and a margin [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conflict:
    """Where another junction lane crosses or touches this one."""

    lane: int
    """The other lane."""
    enter_m: float
    """First station of this lane that lies in the conflict [m]."""
    leave_other_m: float
    """Station of the other lane behind which its traffic is out of the way [m]."""


class JunctionTable:
    """Junction lanes, their conflicts and their rank, computed once per town."""

    def __init__(self, network: LaneNetwork) -> None:
        lanes = network.lanes
        self.is_junction = np.array(
            [lane.junction_id is not None and lane.type == "driving" for lane in lanes], dtype=bool
        )
        self.conflicts: dict[int, tuple[Conflict, ...]] = {}
        by_junction: dict[str, list[int]] = defaultdict(list)
        for lane in lanes:
            if self.is_junction[lane.index] and lane.junction_id is not None:
                by_junction[lane.junction_id].append(lane.index)
        for members in by_junction.values():
            self._add_conflicts(network, members)
        self.rank = self._ranks(network)

    def _add_conflicts(self, network: LaneNetwork, members: list[int]) -> None:
        trees, stations, points = [], [], []
        for index in members:
            length = network.lanes[index].length_m
            s = np.linspace(0.0, length, max(2, int(length / _SAMPLE_M) + 1))
            xyz = network.pose(np.full(len(s), index), s).position_m
            stations.append(s)
            points.append(xyz)
            trees.append(cKDTree(xyz))
        found: dict[int, list[Conflict]] = {index: [] for index in members}
        for a, lane_a in enumerate(members):
            for b, lane_b in enumerate(members):
                if a == b:
                    continue
                near_a = np.asarray(trees[b].query(points[a])[0]) < _CLEAR_M
                near_b = np.asarray(trees[a].query(points[b])[0]) < _CLEAR_M
                if near_a.any() and near_b.any():
                    found[lane_a].append(
                        Conflict(
                            lane=lane_b,
                            enter_m=float(stations[a][near_a][0]),
                            leave_other_m=float(stations[b][near_b][-1]),
                        )
                    )
        self.conflicts.update({index: tuple(rows) for index, rows in found.items()})

    def _ranks(self, network: LaneNetwork) -> NDArray[np.int64]:
        """3 straight on, 2 right, 1 left, 0 behind a stop or yield sign."""
        rank = np.zeros(len(network.lanes), np.int64)
        minor = {
            lane for sign in network.static_signs if sign.kind in ("stop", "yield") for lane in sign.lanes
        }
        for lane in network.lanes:
            if not self.is_junction[lane.index]:
                continue
            ends = network.pose(np.full(2, lane.index), np.array([0.0, lane.length_m])).heading_rad
            turn = float(wrap_angle(ends[1] - ends[0]))
            rank[lane.index] = 3 if abs(turn) < 0.5 else 2 if turn < 0 else 1
            if minor.intersection(lane.predecessors) or lane.index in minor:
                rank[lane.index] = 0
        return rank


@dataclass(slots=True, kw_only=True)
class Request:
    """A vehicle that comes up to a junction lane and wants in."""

    vehicle: int
    lane: int
    """Junction lane asked for."""
    distance_m: float
    """From the front bumper to the lane's start [m]."""
    speed_mps: float
    waited_s: float
    """How long it has stood [s]."""
    permitted: bool
    """Whether its signal lets it go."""
    has_room: bool
    """Whether the lane behind the junction has room for it."""


class Reservations:
    """Junction lanes held by vehicles, and the decision to hold one more."""

    def __init__(self, table: JunctionTable) -> None:
        self._table = table
        self.held: dict[int, dict[int, float]] = defaultdict(dict)
        """Lane → vehicle → station of its tail on that lane [m], negative before it entered."""

    def clear(self) -> None:
        """Drop all reservations."""
        self.held.clear()

    def holds(self, vehicle: int, lane: int) -> bool:
        """Whether the vehicle has been admitted to the lane."""
        return vehicle in self.held[lane]

    def release(self, vehicle: int, lane: int) -> None:
        """The vehicle's tail has left the lane."""
        self.held[lane].pop(vehicle, None)

    def admit(self, requests: list[Request]) -> None:
        """Grant what can be granted, higher rank and earlier arrival first."""
        rank = self._table.rank
        order = sorted(
            requests,
            key=lambda r: (-int(rank[r.lane]), r.distance_m / max(r.speed_mps, 1.0), r.vehicle),
        )
        for request in order:
            if request.permitted and request.has_room and self._is_free(request, requests):
                self.held[request.lane][request.vehicle] = -request.distance_m

    def _is_free(self, request: Request, requests: list[Request]) -> bool:
        for conflict in self._table.conflicts[request.lane]:
            for vehicle, tail_m in self.held[conflict.lane].items():
                if vehicle != request.vehicle and tail_m < conflict.leave_other_m:
                    return False
        rank = self._table.rank
        rivals = {conflict.lane for conflict in self._table.conflicts[request.lane]}
        gap_s = max(2.0, 4.5 - 0.1 * request.waited_s)
        for other in requests:
            if (
                other.lane in rivals
                and rank[other.lane] > rank[request.lane]
                and other.permitted
                and other.has_room
                and request.waited_s < 20.0
                and other.distance_m / max(other.speed_mps, 0.5) < gap_s
            ):
                return False
        return True
