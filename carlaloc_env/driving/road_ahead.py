"""Road ahead of the ego on its route: stop lines, their lights, and the vehicle in front."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_SIZE_M
from carlaloc_env.driving.crossing_traffic import LEADER_SIDE_M, crossing_traffic, standing_gap_m
from carlaloc_env.driving.driver_view import DriverView
from carlaloc_env.driving.narrow_bends import narrow_bend_m
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.route import Route, RoutePose
from carlaloc_env.physics.ego import EgoState
from carlaloc_env.timeline.actors import ActorCatalog, ActorFrame
from carlaloc_env.traffic.stop_lines import stop_lines

_TIGHT_MPS = 6.0
"""Bends in which the front swings out by decimetres are driven more slowly [m/s]."""
SIGHT_M = 100.0
"""How far ahead a driver looks for others and for lights [m]."""
_SAMPLE_M = 1.0
"""Spacing of the points of the route that are looked at [m]."""


class _Sight(NamedTuple):
    """What is in sight, named as in `DriverView`."""

    speed_limit_mps: float
    stop_line_distance_m: float | None
    signal_state: int
    leader_gap_m: float | None
    leader_speed_mps: float


class RoadAhead:
    """Follows the ego along its route.

    Position, actors and lights are known anew every 50 ms, at `follow`; ticks in between see the same.
    """

    def __init__(self, network: LaneNetwork, route: Route) -> None:
        self._route = route
        self.stop_lines = stop_lines(network, route)
        self._stop_s_m, self._stop_heads = self.stop_lines
        self.progress_m = 0.0
        self.offset_m = 0.0
        self._sight: _Sight | None = None

    def start(self, position_m: Array) -> None:
        """Begin at a point of the route [m], world (3,)."""
        self._sight = None
        s, self.offset_m = self._route.project(position_m, None)
        closed_end = self._route.closed and s > self._route.length_m - 5.0
        self.progress_m = s - self._route.length_m if closed_end else s

    def follow(self, position_m: Array) -> None:
        """Take note of where the ego is now [m], world (3,)."""
        self._sight = None
        length = self._route.length_m
        near = self.progress_m % length if self._route.closed else self.progress_m
        s, self.offset_m = self._route.project(position_m, near)
        step = s - near
        if self._route.closed:
            step = (step + 0.5 * length) % length - 0.5 * length
        self.progress_m += step

    def view(
        self,
        *,
        tick: int,
        state: EgoState,
        acceleration_mps2: float,
        actors: ActorFrame,
        catalog: ActorCatalog,
        signals: NDArray[np.uint8],
    ) -> DriverView:
        """View of a driver at the wheel now."""
        if self._sight is None:
            self._sight = self._observe(state.speed_mps, actors, catalog, signals)
        return DriverView(
            tick=tick,
            position_m=state.position_m,
            heading_rad=state.heading_rad,
            speed_mps=state.speed_mps,
            acceleration_mps2=acceleration_mps2,
            route=self._route,
            route_s_m=self.progress_m,
            offset_m=self.offset_m,
            **self._sight._asdict(),
        )

    def _observe(
        self, speed_mps: float, actors: ActorFrame, catalog: ActorCatalog, signals: NDArray[np.uint8]
    ) -> _Sight:
        route = self._route
        s = self.progress_m % route.length_m if route.closed else self.progress_m
        stop_distance, stop_state = self._next_stop(s, signals)
        ahead = np.arange(0.0, SIGHT_M, _SAMPLE_M)
        if not route.closed:
            ahead = ahead[s + ahead <= route.length_m]
        path = route.at(s + ahead)
        gap, leader_speed = self._leader(path, ahead, actors, catalog)
        standing = standing_gap_m(path, ahead, actors, catalog) if speed_mps < _TIGHT_MPS else np.inf
        # A leader's own gap is exact to a sample.
        if standing < (np.inf if gap is None else gap - _SAMPLE_M):
            gap, leader_speed = standing, 0.0
        bend = narrow_bend_m(path, ahead, speed_mps, actors, catalog)
        if bend < (np.inf if gap is None else gap):
            gap, leader_speed = bend, 0.0
        crossing = crossing_traffic(route, s, speed_mps, actors, catalog)
        if crossing is not None and (gap is None or crossing[0] < gap):
            gap, leader_speed = crossing
        return _Sight(
            speed_limit_mps=float(route.at(s).speed_limit_mps[0]),
            stop_line_distance_m=stop_distance,
            signal_state=stop_state,
            leader_gap_m=gap,
            leader_speed_mps=leader_speed,
        )

    def _next_stop(self, s_m: float, signals: NDArray[np.uint8]) -> tuple[float | None, int]:
        """Distance from the front bumper to the next line with a light [m], and what it shows."""
        if not len(self._stop_s_m):
            return None, 0
        ahead = self._stop_s_m - s_m - EGO_FRONT_M
        if self._route.closed:
            ahead = np.where(ahead < -4.0, ahead + self._route.length_m, ahead)
        valid = (ahead > -4.0) & (ahead < SIGHT_M)
        if not valid.any():
            return None, 0
        nearest = int(np.argmin(np.where(valid, ahead, np.inf)))
        return float(ahead[nearest]), int(signals[self._stop_heads[nearest]].max())

    @staticmethod
    def _leader(
        path: RoutePose, ahead: Array, actors: ActorFrame, catalog: ActorCatalog
    ) -> tuple[float | None, float]:
        """Bumper-to-bumper gap to the first vehicle in the ego's path [m], and its speed along the route."""
        if not len(actors):
            return None, 0.0
        half = 0.5 * catalog.size_m[:, :2].astype(np.float64)
        position_m = actors.position_m.astype(np.float64)
        near = np.linalg.norm(position_m[:, :2] - path.position_m[0, :2], axis=-1) < SIGHT_M + 10.0
        if not near.any():
            return None, 0.0
        index = np.flatnonzero(near)
        delta = position_m[index, None, :] - path.position_m[None]
        distance = delta[..., 0] ** 2 + delta[..., 1] ** 2
        closest = np.argmin(distance, axis=1)
        rows = np.arange(len(index))
        angle = actors.heading_rad[index].astype(np.float64) - path.heading_rad[closest]
        cos, sin = elementary.cos(angle), elementary.sin(angle)
        half_width = half[index, 0] * np.abs(sin) + half[index, 1] * np.abs(cos)
        side = np.sqrt(distance[rows, closest])
        in_path = (side < half_width + 0.5 * EGO_SIZE_M[1] + LEADER_SIDE_M) & (
            np.abs(delta[rows, closest, 2]) < 3.0
        )
        in_path &= (closest > 0) & (closest < len(ahead) - 1)
        if not in_path.any():
            return None, 0.0
        along = half[index, 0] * np.abs(cos) + half[index, 1] * np.abs(sin)
        gap = np.where(in_path, ahead[closest] - along - EGO_FRONT_M, np.inf)
        first = int(np.argmin(gap))
        speed = float(actors.speed_mps[index[first]]) * float(cos[first])
        return float(gap[first]), max(speed, 0.0)
