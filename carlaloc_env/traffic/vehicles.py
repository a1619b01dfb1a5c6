"""Vehicles on lanes: plans, reservations, car following, and the poses that come of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.clock import STEP_NS
from carlaloc_env.town.network import LaneNetwork
from carlaloc_env.traffic.car_following import COMFORT_BRAKING_MPS2, idm_plus
from carlaloc_env.traffic.ego_view import EgoLanes, EgoView, find_ego_lanes
from carlaloc_env.traffic.junctions import Request, Reservations
from carlaloc_env.traffic.leaders import Occupancy, find_leaders
from carlaloc_env.traffic.signal_plan import SignalState
from carlaloc_env.traffic.tables import TrafficTables

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STEP_S = STEP_NS / 1e9
_PLAN = 7
_EGO = -1
_YELLOW_BRAKING_MPS2 = 3.0
_STANDING_MPS = 0.1
_GREEN, _YELLOW = int(SignalState.GREEN), int(SignalState.YELLOW)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drivers:
    """Fixed properties of N vehicles and their drivers."""

    length_m: Array
    """Vehicle length [m], shape (N,)."""
    wheelbase_m: Array
    """Wheelbase [m], shape (N,)."""
    speed_factor: Array
    """Desired speed over the limit, 0.8–1.2, shape (N,)."""
    headway_s: Array
    """Time headway [s], shape (N,)."""
    standstill_m: Array
    """Gap kept when standing [m], shape (N,)."""
    acceleration_mps2: Array
    """Greatest acceleration [m/s²], shape (N,)."""
    braking_mps2: Array
    """Comfortable braking [m/s²], shape (N,)."""


class Vehicles:
    """All vehicles of the traffic, advanced together by steps of 50 ms."""

    def __init__(self, network: LaneNetwork, tables: TrafficTables, drivers: Drivers, seed: int) -> None:
        self._network = network
        self.drivers = drivers
        self._seed = seed
        self._length = np.array([lane.length_m for lane in network.lanes])
        self._speeds = tables.speeds
        self.junctions = tables.junctions
        self.reservations = Reservations(self.junctions)
        self._onward = tables.onward
        self._turn_rad = tables.turn_rad
        self._heads: list[list[int]] = [[] for _ in network.lanes]
        self._stop_m = self._length - 1.0
        for index, head in enumerate(network.signals):
            for lane, stop in zip(head.lanes, head.stop_station_m, strict=True):
                self._heads[lane].append(index)
                self._stop_m[lane] = min(self._stop_m[lane], stop)
            for lane in head.junction_lanes:
                self._heads[lane].append(index)

    def place(self, lane: Index, station_m: Array) -> None:
        """Stand the vehicles at stations [m] of lanes, shape (N,), at rest."""
        count = len(lane)
        self.lane_before = np.full(count, -1, np.int64)
        self.station_m = station_m.astype(np.float64)
        self.speed_mps = np.zeros(count)
        self.acceleration_mps2 = np.zeros(count)
        self.travelled_m = np.zeros(count)
        self._waited_s = np.zeros(count)
        self._turns = np.zeros(count, np.int64)
        self.plan = np.full((count, _PLAN), -1, np.int64)
        self.plan[:, 0] = lane
        self._held: list[list[int]] = [[] for _ in range(count)]
        self.reservations.clear()
        for vehicle in range(count):
            self._extend(vehicle)
            if self.junctions.is_junction[lane[vehicle]]:
                self._hold(vehicle, int(lane[vehicle]))

    def step(self, ego: EgoView, signals: NDArray[np.uint8]) -> None:
        """Advance by 50 ms."""
        d = self.drivers
        ego_lanes = find_ego_lanes(self._network, self._length, ego)
        occupancy = self._occupancy(ego, ego_lanes)
        self._reserve_for_ego(ego, ego_lanes)
        gap, leader = find_leaders(occupancy, len(d.length_m), self.plan, self._length)
        stop_gap = self._stop_gaps(occupancy, signals)
        desired = self._desired_speed()
        law = {
            "headway_s": d.headway_s,
            "acceleration_mps2": d.acceleration_mps2,
            "braking_mps2": d.braking_mps2,
        }
        follow = idm_plus(self.speed_mps, desired, gap, leader, standstill_m=d.standstill_m, **law)
        line = idm_plus(
            self.speed_mps, desired, stop_gap, np.zeros_like(gap), standstill_m=np.full_like(gap, 0.5), **law
        )
        self._integrate(np.minimum(follow, line))
        self._advance_lanes()

    def poses(self) -> tuple[Array, Array, Array]:
        """Box centre on the ground [m] (N, 3), heading [rad] (N,), pitch [rad] (N,).

        Both axles lie on the lane's centre line, which gives natural yaw and off-tracking.
        """
        half = 0.5 * self.drivers.wheelbase_m
        front, rear = self._points(np.stack([half, -half]))
        delta = front - rear
        flat = np.hypot(delta[:, 0], delta[:, 1])
        heading = np.array([math.atan2(y, x) for x, y in zip(delta[:, 0], delta[:, 1], strict=True)])
        pitch = np.array([math.atan2(z, f) for z, f in zip(delta[:, 2], flat, strict=True)])
        return 0.5 * (front + rear), heading, pitch

    def turn_ahead(self) -> Array:
        """Heading change of the next junction lane within 35 m [rad], 0 if there is none, shape (N,)."""
        result = np.zeros(len(self.station_m))
        for hop in (0, 1):
            lane = self.plan[:, hop]
            near = (
                self.junctions.is_junction[lane]
                & (lane >= 0)
                & ((hop == 0) | (self._length[self.plan[:, 0]] - self.station_m < 35.0))
            )
            if near.any():
                result[near] = self._turn_rad[lane[near]]
        return result

    def _occupancy(self, ego: EgoView, where: EgoLanes) -> Occupancy:
        half = 0.5 * self.drivers.length_m
        tail = (self.lane_before >= 0) & (self.station_m < half + 1.0)
        before = self.lane_before[tail]
        return Occupancy(
            lane=np.concatenate([self.plan[:, 0], before, where.lane]),
            station_m=np.concatenate(
                [self.station_m, self._length[before] + self.station_m[tail], where.station_m]
            ),
            half_m=np.concatenate([half, half[tail], np.full(len(where.lane), 0.5 * ego.length_m)]),
            speed_mps=np.concatenate([self.speed_mps, self.speed_mps[tail], where.speed_mps]),
        )

    def _reserve_for_ego(self, ego: EgoView, where: EgoLanes) -> None:
        for holders in self.reservations.held.values():
            holders.pop(_EGO, None)
        for lane, station in where.ahead:
            if self.junctions.is_junction[lane]:
                held = self.reservations.held[lane]
                held[_EGO] = min(held.get(_EGO, math.inf), station - 0.5 * ego.length_m)

    def _desired_speed(self) -> Array:
        d = self.drivers
        limit = self._speeds.at(self.plan[:, 0], self.station_m)
        ahead = self._length[self.plan[:, 0]] - self.station_m
        for hop in range(1, _PLAN):
            lane = self.plan[:, hop]
            entry = self._speeds.entry_mps[lane]
            reach = np.sqrt(entry * entry + 2.0 * COMFORT_BRAKING_MPS2 * np.maximum(ahead, 0.0))
            limit = np.where(lane >= 0, np.minimum(limit, reach), limit)
            ahead = ahead + np.where(lane >= 0, self._length[lane], 0.0)
        return limit * d.speed_factor

    def _stop_gaps(self, occupancy: Occupancy, signals: NDArray[np.uint8]) -> Array:
        """Distance to the line at which each vehicle has to stop [m], inf if it may drive on."""
        requests, gaps = self._requests(occupancy, signals)
        self.reservations.admit(requests)
        result = np.full(len(self.station_m), np.inf)
        for request, gap in zip(requests, gaps, strict=True):
            if self.reservations.holds(request.vehicle, request.lane):
                self._held[request.vehicle].append(request.lane)
            else:
                result[request.vehicle] = gap
        for vehicle in np.flatnonzero(self.plan[:, 1] < 0):
            result[vehicle] = self._length[self.plan[vehicle, 0]] - self._front(int(vehicle)) - 1.0
        return result

    def _requests(
        self, occupancy: Occupancy, signals: NDArray[np.uint8]
    ) -> tuple[list[Request], list[float]]:
        rear, rear_speed = occupancy.rearmost(len(self._length))
        bound = self._bound_for()
        reach = np.maximum(30.0, self.speed_mps * self.speed_mps / (2 * COMFORT_BRAKING_MPS2) + 12.0)
        hops, distances = self._next_junctions()
        near = (self._length[self.plan[:, 0]] - self.station_m < reach) & (hops >= 0) & (distances <= reach)
        next_lane = np.where(hops >= 0, self.plan[np.arange(len(hops)), hops], -1).tolist()
        queues = self._queues()
        shown = signals.tolist()
        requests: list[Request] = []
        gaps: list[float] = []
        for v in np.flatnonzero(near).tolist():
            hop, distance, lane = int(hops[v]), float(distances[v]), next_lane[v]
            approach = int(self.plan[v, hop - 1])
            to_line = float(distance - (self._length[approach] - self._stop_m[approach]))
            heads = self._heads[lane] or self._heads[approach]
            speed = float(self.speed_mps[v])
            permitted = _is_permitted([shown[head] for head in heads], to_line, speed)
            if self.reservations.holds(v, lane):
                if permitted or to_line < 0.5:
                    continue
                self.reservations.release(v, lane)
                self._held[v].remove(lane)
            gaps.append(to_line if to_line > -1.0 else max(distance - 0.3, 0.0))
            requests.append(
                Request(
                    vehicle=v,
                    lane=lane,
                    distance_m=distance,
                    speed_mps=speed,
                    waited_s=float(self._waited_s[v]),
                    permitted=permitted,
                    has_room=self._may_follow(v, hop, queues, next_lane)
                    and self._has_room(v, hop, rear, rear_speed, bound),
                )
            )
        return requests, gaps

    def _queues(self) -> dict[int, list[int]]:
        """Vehicles of each lane."""
        queues: dict[int, list[int]] = {}
        for vehicle, lane in enumerate(self.plan[:, 0].tolist()):
            queues.setdefault(lane, []).append(vehicle)
        return queues

    def _may_follow(self, v: int, hop: int, queues: dict[int, list[int]], next_lane: list[int]) -> bool:
        """Whether all who stand between the vehicle and the junction have been admitted themselves.

        Args:
            v: The vehicle.
            hop: Place of the junction in its plan.
            queues: Vehicles of each lane.
            next_lane: Junction lane that each vehicle comes to next, −1 = none in sight.
        """
        for k in range(hop):
            for other in queues.get(int(self.plan[v, k]), ()):
                ahead = k > 0 or self.station_m[other] > self.station_m[v]
                waits = next_lane[other] >= 0 and next_lane[other] not in self._held[other]
                if ahead and other != v and waits:
                    return False
        return True

    def _next_junctions(self) -> tuple[Index, Array]:
        """Hop of the junction lane that each vehicle enters next, −1 = none, and the distance to it [m]."""
        distance = self._length[self.plan[:, 0]] - (self.station_m + 0.5 * self.drivers.length_m)
        hops = np.full(len(distance), -1, np.int64)
        searching = np.ones(len(distance), dtype=bool)
        for hop in range(1, _PLAN):
            lane = self.plan[:, hop]
            searching = searching & (lane >= 0)
            found = searching & self.junctions.is_junction[lane]
            hops[found] = hop
            searching &= ~found
            distance = np.where(searching, distance + self._length[lane], distance)
        return hops, distance

    def _bound_for(self) -> dict[int, float]:
        """Length claimed on the lane behind each held junction lane [m]."""
        claimed: dict[int, float] = {}
        for vehicle, lanes in enumerate(self._held):
            for lane in lanes:
                row = np.flatnonzero(self.plan[vehicle, :-1] == lane)
                if len(row):
                    target = int(self.plan[vehicle, row[0] + 1])
                    claimed[target] = claimed.get(target, 0.0) + float(self.drivers.length_m[vehicle]) + 2.0
        return claimed

    def _has_room(self, v: int, hop: int, rear: Array, rear_speed: Array, bound: dict[int, float]) -> bool:
        need = float(self.drivers.length_m[v]) + 2.0
        free = 0.0
        for lane in self.plan[v, hop + 1 :]:
            if lane < 0:
                return True
            free -= bound.get(int(lane), 0.0)
            if np.isfinite(rear[lane]):
                return bool(free + rear[lane] >= need or rear_speed[lane] > 4.0)
            free += float(self._length[lane])
            if free >= need:
                return True
        return True

    def _integrate(self, wanted_mps2: Array) -> None:
        a = self.acceleration_mps2
        rise = np.where(wanted_mps2 < -3.0, 60.0, 8.0)
        a = np.clip(wanted_mps2, a - rise * STEP_S, a + 2.5 * STEP_S)
        v = self.speed_mps + a * STEP_S
        halt = v < 0.0
        safe = np.where(a < -1e-6, a, -1.0)
        path = np.where(
            halt,
            self.speed_mps * self.speed_mps / (-2.0 * safe),
            self.speed_mps * STEP_S + 0.5 * a * STEP_S * STEP_S,
        )
        self.acceleration_mps2 = np.where(halt, 0.0, a)
        self.speed_mps = np.where(halt, 0.0, v)
        self.station_m = self.station_m + path
        self.travelled_m = self.travelled_m + path
        self._waited_s = np.where(self.speed_mps < _STANDING_MPS, self._waited_s + STEP_S, 0.0)

    def _advance_lanes(self) -> None:
        for vehicle in np.flatnonzero(self.station_m >= self._length[self.plan[:, 0]]):
            v = int(vehicle)
            if self.plan[v, 1] < 0:
                self.station_m[v] = self._length[self.plan[v, 0]]
                continue
            self.lane_before[v] = self.plan[v, 0]
            self.station_m[v] -= self._length[self.plan[v, 0]]
            self.plan[v, :-1] = self.plan[v, 1:]
            self.plan[v, -1] = -1
            self._extend(v)
        for v, lanes in enumerate(self._held):
            for lane in tuple(lanes):
                tail = self._tail_on(v, lane)
                if tail > self._length[lane]:
                    self.reservations.release(v, lane)
                    lanes.remove(lane)
                else:
                    self.reservations.held[lane][v] = tail

    def _tail_on(self, v: int, lane: int) -> float:
        """Station of the vehicle's tail on a lane it holds [m]."""
        tail = float(self.station_m[v] - 0.5 * self.drivers.length_m[v])
        if self.plan[v, 0] == lane:
            return tail
        if lane in self.plan[v, 1:]:
            return -1.0
        if self.lane_before[v] == lane:
            return float(self._length[lane]) + tail
        return math.inf if self.station_m[v] > 0.5 * self.drivers.length_m[v] else float(self._length[lane])

    def _hold(self, v: int, lane: int) -> None:
        self.reservations.held[lane][v] = self._tail_on(v, lane)
        self._held[v].append(lane)

    def _front(self, v: int) -> float:
        return float(self.station_m[v] + 0.5 * self.drivers.length_m[v])

    def _extend(self, v: int) -> None:
        """Fill the plan with turns drawn by (seed, vehicle, number of the turn)."""
        for hop in range(1, _PLAN):
            if self.plan[v, hop] >= 0:
                continue
            options = [
                lane
                for lane in self._network.lanes[self.plan[v, hop - 1]].successors
                if self._onward[lane] and self._network.lanes[lane].type == "driving"
            ]
            if not options:
                return
            draw = rng.stream(self._seed, "traffic/turn", int(self._turns[v]), v).integers(len(options))
            self.plan[v, hop] = options[int(draw)]
            self._turns[v] += 1

    def _points(self, ahead_m: Array) -> Array:
        """Points on the path that far ahead of the vehicles' centres [m], (K, N) distances, (K, N, 3)."""
        station = self.station_m + ahead_m
        lane = np.broadcast_to(self.plan[:, 0], station.shape)
        behind = (station < 0) & (self.lane_before >= 0)
        lane = np.where(behind, self.lane_before, lane)
        station = np.where(behind, station + self._length[lane], station)
        for hop in range(1, 4):
            beyond = (station > self._length[lane]) & (self.plan[:, hop] >= 0) & ~behind
            station = np.where(beyond, station - self._length[lane], station)
            lane = np.where(beyond, self.plan[:, hop], lane)
        on_lane = np.clip(station, 0.0, self._length[lane])
        pose = self._network.pose(lane.ravel(), on_lane.ravel())
        heading = pose.heading_rad.reshape(station.shape)
        along = np.stack([np.cos(heading), np.sin(heading), 0 * station], axis=-1)
        beyond_m = (station - on_lane)[..., None]
        points: Array = pose.position_m.reshape(*station.shape, 3) + beyond_m * along
        return points


def _is_permitted(states: list[int], to_line_m: float, speed_mps: float) -> bool:
    """Whether the lights that count let a vehicle go that far before their line [m]."""
    if not states or to_line_m < -1.0 or _GREEN in states or not any(states):
        return True
    must_brake = speed_mps * speed_mps / (2 * max(to_line_m, 0.1))
    return _YELLOW in states and must_brake > _YELLOW_BRAKING_MPS2
