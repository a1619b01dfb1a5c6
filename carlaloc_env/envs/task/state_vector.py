"""State vector: the car, the road and the others as one vector of numbers between −1 and 1."""

import math
from typing import NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.ego import EGO_FRONT_M
from carlaloc_env.core.jit import compiled, same_types
from carlaloc_env.envs.task.road_users import (
    COLUMNS,
    Ego,
    ego_of,
    first_in_path,
    put_neighbours,
)
from carlaloc_env.envs.task.task_world import TaskWorld
from carlaloc_env.map.routing.route import Route
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.traffic.signals import SignalState

ROUTE_AHEAD_M = (2.0, 4.0, 7.0, 11.0, 16.0, 22.0, 30.0, 40.0, 55.0, 75.0)
"""Distances along the route of its points in the vector [m]."""
SIGHT_M = 100.0
"""Distance up to which lights and vehicles ahead count [m]."""
NEAR_M = 20.0
"""A finer scale, for the nearer of them once more [m]: over 100 m, one metre and two look alike."""
_SHORTEST_BRAKING_M = 0.5
"""Shorter distances do not make the needed deceleration greater [m]."""
NEIGHBOURS = 16
"""Road users in the vector, the nearest first."""
_STEP_S = STEP_NS * 1e-9
_BACK_M = 4.0
"""A stop line counts until the front bumper is so far beyond it [m]."""
_KINDS = {Tag.PEDESTRIAN: 2, Tag.RIDER: 1, Tag.MOTORCYCLE: 1, Tag.BICYCLE: 1}
"""Kind of a road user by its tag: 0 car, van, lorry or bus, 1 on two wheels, 2 on foot."""
_RoadUsers = tuple[F32, F32, F32, Array]
"""Positions [m], headings [rad], speeds [m/s] and sizes [m] of road users, as `put_neighbours` takes them."""
BRAKING_MPS2, LATERAL_MPS2, MARGIN_M = 2.5, 2.0, 1.0
"""Comfortable braking, and acceleration in curves, of `safe_speed` and `corner_speed`; gap when standing."""


class Entry(NamedTuple):
    """A number of the state vector."""

    name: str
    """Its name; the number of a point or of a road user follows it."""
    scale: float
    """The entry is the quantity over this, cut to −1…1."""
    unit: str
    """Unit of quantity and scale."""
    meaning: str
    """What it is."""


EGO = (
    Entry("speed", 40.0, "m/s", "forward speed"),
    Entry("yaw_rate", 1.5, "rad/s", "turning to the left"),
    Entry("road_wheel", 0.6, "rad", "angle of the front wheels, left positive"),
    Entry("acceleration", 10.0, "m/s²", "change of the forward speed over the last step"),
    Entry("lateral_acceleration", 10.0, "m/s²", "speed times yaw rate"),
    Entry("lateral_offset", 5.0, "m", "distance to the left of the route"),
    Entry("heading_error_sin", 1.0, "", "sine of the heading less the route's"),
    Entry("heading_error_cos", 1.0, "", "cosine of the same"),
    Entry("speed_limit", 40.0, "m/s", "limit here"),
    Entry("speed_over_limit", 10.0, "m/s", "speed less the limit"),
    Entry("standing", 60.0, "s", "time for which the car has been standing"),
    Entry("to_go", 1000.0, "m", "distance to the end of the route"),
)
"""Of the car and the place where it is."""
ROUTE = (
    Entry("route_forward", 1.0, "", "distance ahead of the car over the distance along the route"),
    Entry("route_left", 1.0, "", "distance to the left of the car over the distance along the route"),
    Entry("route_curvature", 0.2, "1/m", "curvature, left positive"),
    Entry("route_limit", 40.0, "m/s", "speed limit"),
)
"""Of every point of the route ahead, at `ROUTE_AHEAD_M`."""
AHEAD = (
    Entry("light_distance", SIGHT_M, "m", "from the front bumper to the next line with a light; 1 without"),
    Entry("light_red", 1.0, "", "1 if it is red"),
    Entry("light_yellow", 1.0, "", "1 if it is yellow"),
    Entry("light_green", 1.0, "", "1 if it is green"),
    Entry("gap", SIGHT_M, "m", "from the front bumper to the first road user in the route's path; 1 without"),
    Entry("gap_closing", 20.0, "m/s", "speed of the car less the speed of that road user along the route"),
    Entry("room", NEAR_M, "m", "the gap, or the distance to the next line if it is red or yellow and nearer"),
    Entry("braking", 8.0, "m/s²", "deceleration that stops the car before that line and the vehicle ahead"),
    Entry("safe_speed", 1.0, "", "share of the limit from which 2.5 m/s² stops it there, with 1 m to spare"),
    Entry("corner_speed", 1.0, "", "share of the limit at which no curve ahead takes more than 2 m/s²"),
)
"""Of what lies ahead on the route."""
NEIGHBOUR = (
    Entry("forward", 50.0, "m", "centre, ahead of the car's centre"),
    Entry("left", 50.0, "m", "centre, to the left"),
    Entry("forward_velocity", 20.0, "m/s", "velocity relative to the car, ahead"),
    Entry("left_velocity", 20.0, "m/s", "velocity relative to the car, to the left"),
    Entry("heading_cos", 1.0, "", "cosine of its heading less the car's"),
    Entry("heading_sin", 1.0, "", "sine of the same"),
    Entry("length", 15.0, "m", "length"),
    Entry("width", 3.0, "m", "width"),
    Entry("is_vehicle", 1.0, "", "1 for cars, vans, lorries and buses"),
    Entry("is_two_wheeler", 1.0, "", "1 for motorcycles and bicycles"),
    Entry("is_walker", 1.0, "", "1 for people on foot"),
)
"""Of every one of the nearest road users; all 0 where there are fewer."""
assert len(NEIGHBOUR) == COLUMNS


def state_entries() -> dict[str, Entry]:
    """All numbers of the vector by name, in order."""
    route = {f"{entry.name}_{point}": entry for point in range(len(ROUTE_AHEAD_M)) for entry in ROUTE}
    others = {f"neighbour_{k}_{entry.name}": entry for k in range(NEIGHBOURS) for entry in NEIGHBOUR}
    own, ahead = ({entry.name: entry for entry in entries} for entries in (EGO, AHEAD))
    return own | route | ahead | others


def state_names() -> tuple[str, ...]:
    """Names of all numbers of the vector, in order."""
    return tuple(state_entries())


def state_space() -> spaces.Box:
    """Space of the vector."""
    return spaces.Box(-1.0, 1.0, (len(state_names()),), np.float32)


class StateVector:
    """The state of one drive as a vector; keeps what does not change from step to step."""

    def __init__(self, world: TaskWorld) -> None:
        """Begin a drive in a world that has just been reset."""
        self._world = world
        catalog = world.timeline.catalog
        self._kind = np.array([_KINDS.get(Tag(tag), 0) for tag in catalog.tag.tolist()], np.int64)
        self._size_m = np.ascontiguousarray(catalog.size_m[:, :2], np.float64)
        self._distance_m = np.zeros(NEIGHBOURS)
        self._ahead_m = np.array(ROUTE_AHEAD_M)
        self._scale: Array = np.array([entry.scale for entry in state_entries().values()])
        self._values = np.zeros(len(self._scale))
        counts = len(EGO), len(ROUTE) * len(ROUTE_AHEAD_M), len(AHEAD)
        self._of_ego, points, self._of_ahead, neighbours = np.split(self._values, np.cumsum(counts))
        self._points, self._neighbours = points.reshape(-1, len(ROUTE)), neighbours.reshape(-1, COLUMNS)
        self._put_points, self._put_neighbours = same_types(_put_route_points), same_types(put_neighbours)
        self._first_in_path = same_types(first_in_path)
        self._corner_mps = corner_speeds(world.route)
        self._lines_m = world.stop_lines.s_m.tolist()
        self._speed_mps = self._speed_before_mps = world.state.speed_mps

    def follow(self) -> None:
        """Take note of 50 ms that have been driven."""
        self._speed_before_mps, self._speed_mps = self._speed_mps, self._world.state.speed_mps

    def observe(self, standing_s: float) -> NDArray[np.float32]:
        """The vector now, each number in −1…1, shape (`len(state_names())`,).

        Args:
            standing_s: For how long the car has been standing [s].
        """
        world, route = self._world, self._world.route
        s, ego = world.route_s_m, ego_of(world.state)
        line = route.position_m, route.curvature_radpm, route.speed_limit_mps, route.step_m, route.closed
        self._put_points(*line, s, self._ahead_m, ego, self._points)
        actors = world.actors()
        others = actors.position_m, actors.heading_rad, actors.speed_mps, self._size_m
        self._put_neighbours(*others, self._kind, ego, self._distance_m, self._neighbours)
        self._of_ego[:] = self._ego(standing_s)
        self._of_ahead[:] = self._ahead(others, ego)
        return (self._values / self._scale).clip(-1.0, 1.0).astype(np.float32)

    def _ego(self, standing_s: float) -> tuple[float, ...]:
        world, state, route = self._world, self._world.state, self._world.route
        row = route.row_at(world.route_s_m)
        limit = float(route.speed_limit_mps[row])
        error = state.heading_rad - float(route.heading_rad[row])
        yaw_rate = float(state.omega_body_radps[2])
        to_go = route.length_m - world.route_s_m
        return (
            state.speed_mps,
            yaw_rate,
            state.road_wheel_rad,
            (state.speed_mps - self._speed_before_mps) / _STEP_S,
            state.speed_mps * yaw_rate,
            world.route_offset_m,
            np.sin(error),
            np.cos(error),
            limit,
            state.speed_mps - limit,
            standing_s,
            to_go,
        )

    def _ahead(self, others: _RoadUsers, ego: Ego) -> tuple[float, ...]:
        """Next light, and the first road user in the path."""
        route, s_m = self._world.route, self._world.route_s_m
        line_m, shown = self._next_light(s_m)
        row = route.row_at(s_m)
        beyond_m = (s_m % route.length_m if route.closed else s_m) - row * route.step_m
        line = route.position_m, route.heading_rad, row, beyond_m, route.step_m, route.closed
        gap_m, speed_mps = self._first_in_path(*line, *others, SIGHT_M, ego)
        lit = [float(shown == state) for state in (SignalState.RED, SignalState.YELLOW, SignalState.GREEN)]
        closing = ego.speed_mps - speed_mps
        room, braking = gap_m, _deceleration(closing, gap_m)
        safe_mps = max(speed_mps, 0.0) + _stopping_speed(gap_m)
        if (lit[0] or lit[1]) and line_m > 0.0:
            room, braking = min(room, line_m), max(braking, _deceleration(ego.speed_mps, line_m))
            safe_mps = min(safe_mps, _stopping_speed(line_m))
        limit = max(float(route.speed_limit_mps[row]), 1.0)
        shares = safe_mps / limit, float(self._corner_mps[row]) / limit
        return line_m, *lit, gap_m, closing, room, braking, *shares

    def _next_light(self, s_m: float) -> tuple[float, int]:
        route = self._world.route
        at_m, lap_m = (s_m % route.length_m, route.length_m) if route.closed else (s_m, math.inf)
        away = [line_m - at_m - EGO_FRONT_M for line_m in self._lines_m]
        # Beyond a loop's end its lines come again.
        ahead = [m + lap_m if m < -_BACK_M else m for m in away]
        nearest_m = min(ahead, default=math.inf)
        if nearest_m > SIGHT_M:
            return SIGHT_M, 0
        heads = self._world.stop_lines.heads[ahead.index(nearest_m)]
        return nearest_m, int(self._world.signals()[heads].max())


def _deceleration(closing_mps: float, distance_m: float) -> float:
    """Constant deceleration [m/s²] that takes a closing speed away within a distance: v² / (2 d)."""
    return max(closing_mps, 0.0) ** 2 / (2.0 * max(distance_m, _SHORTEST_BRAKING_M))


def _stopping_speed(distance_m: float) -> float:
    """Speed [m/s] from which `BRAKING_MPS2` stops `MARGIN_M` before a distance: √(2 a d)."""
    return math.sqrt(2.0 * BRAKING_MPS2 * max(distance_m - MARGIN_M, 0.0))


def corner_speeds(route: Route) -> Array:
    """Speed [m/s] at each point of a route from which `BRAKING_MPS2` leads to `LATERAL_MPS2` in every curve.

    With the squares of speeds u that the curves allow: the least u(t) + 2 a (t - s) over all t from s on.
    """
    allowed = LATERAL_MPS2 / np.maximum(np.abs(route.curvature_radpm), 1e-4)
    laps = 2 if route.closed else 1
    gained = 2.0 * BRAKING_MPS2 * route.step_m * np.arange(laps * len(allowed))
    least = np.minimum.accumulate((np.tile(allowed, laps) + gained)[::-1])[::-1] - gained
    speeds: Array = np.sqrt(least[: len(allowed)])
    return speeds


@compiled
def _put_route_points(
    route_m: Array,
    curvature_radpm: Array,
    limit_mps: Array,
    step_m: float,
    closed: bool,
    s_m: float,
    ahead_m: Array,
    ego: Ego,
    out: Array,
) -> None:
    """Write rows of `ROUTE`, (P, 4), at distances ahead (P,); past an open route's end, its last point."""
    number = len(route_m)
    for k in range(len(ahead_m)):
        at = (s_m + ahead_m[k]) / step_m
        row = int(at)
        f = at - row
        row, after = (row % number, (row + 1) % number) if closed else (row, row + 1)
        row, after = min(row, number - 1), min(after, number - 1)
        dx = route_m[row, 0] + f * (route_m[after, 0] - route_m[row, 0]) - ego.x
        dy = route_m[row, 1] + f * (route_m[after, 1] - route_m[row, 1]) - ego.y
        out[k, 0] = (ego.cos * dx + ego.sin * dy) / ahead_m[k]
        out[k, 1] = (ego.cos * dy - ego.sin * dx) / ahead_m[k]
        out[k, 2], out[k, 3] = curvature_radpm[row], limit_mps[row]
