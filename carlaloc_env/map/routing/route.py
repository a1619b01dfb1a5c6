"""A route: one smooth line over lanes, sampled every half metre.

Projection of a point on a route: where along it, and how far to its left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.elementary_kernels import sin_cos
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.jit import compiled
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.centre_lines import TABLE_STEP_M
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.shortest_paths import LanePosition, path_through
from carlaloc_env.map.routing.smoothing import RouteLine, trace

FitTurns = Callable[[LaneNetwork, RouteLine], tuple[RouteLine, NDArray[np.bool_]]]
"""Fits the tight turns of a line to a car: the new line, and which of its points were fitted."""
_ROUNDS = 3
"""Steps of Newton's method from the nearest sample."""


class Line(NamedTuple):
    """A route for compiled functions; fields as of `Route`."""

    position_m: NDArray[np.float64]
    heading_rad: Array
    curvature_radpm: Array
    step_m: float
    closed: bool


@compiled
def project_on(
    line: Line, x_m: float, y_m: float, low: int, count: int, length_m: float
) -> tuple[float, float]:
    """Distance from the start and offset to the left [m] of a point.

    Args:
        line: The route.
        x_m: East [m].
        y_m: North [m].
        low: First sample to look at; may be below 0 or beyond the last on a closed route.
        count: How many are looked at.
        length_m: Length of the route [m].
    """
    number = len(line.heading_rad)
    nearest, least = 0, np.inf
    for k in range(low, low + count):
        row = k % number
        dx, dy = x_m - line.position_m[row, 0], y_m - line.position_m[row, 1]
        if dx * dx + dy * dy < least:
            nearest, least = row, dx * dx + dy * dy
    s, offset = nearest * line.step_m, 0.0
    for _ in range(_ROUNDS):
        px, py, heading, curvature = _pose(line, s, length_m)
        w, c = sin_cos(heading)
        ex, ey = x_m - px, y_m - py
        offset = c * ey - w * ex
        bend = max(1.0 - curvature * offset, 0.3)
        s += min(max((c * ex + w * ey) / bend, -1.0), 1.0)
        s = s % length_m if line.closed else min(max(s, 0.0), length_m)
    return s, offset


@compiled
def _pose(line: Line, s_m: float, length_m: float) -> tuple[float, float, float, float]:
    """East, north [m], heading [rad] and curvature [1/m] at a distance from the start [m]: as `Route.at`."""
    number, h = len(line.heading_rad), line.step_m
    if line.closed:
        at = s_m % length_m / h
        row = min(int(at), number - 1)
        after = (row + 1) % number
    else:
        at = min(max(s_m / h, 0.0), number - 1.0)
        row = min(int(at), number - 2)
        after = row + 1
    f = at - row
    g = 1.0 - f
    w = f * f * (3.0 - 2.0 * f)
    m0, m1 = h * f * g * g, h * f * f * g
    begin, end = line.heading_rad[row], line.heading_rad[after]
    (north_0, east_0), (north_1, east_1) = sin_cos(begin), sin_cos(end)
    a, b = line.position_m[row], line.position_m[after]
    x = a[0] * (1.0 - w) + b[0] * w + east_0 * m0 - east_1 * m1
    y = a[1] * (1.0 - w) + b[1] * w + north_0 * m0 - north_1 * m1
    turn = (end - begin + np.pi) % (2.0 * np.pi) - np.pi
    curvature = line.curvature_radpm[row] * g + line.curvature_radpm[after] * f
    return x, y, begin + f * turn, curvature


FARTHEST_POINT_M = 15.0
"""Route points farther from every lane are refused."""
_AMBIGUITY_M = 1.0
_BEHIND_M, _AHEAD_M = 20.0, 40.0


class RoutePose(NamedTuple):
    """Poses along a route, world frame, each field (M, …)."""

    position_m: NDArray[np.float64]
    heading_rad: Array
    pitch_rad: Array
    """Nose up positive."""
    curvature_radpm: Array
    speed_limit_mps: Array
    lane: Index


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Route:
    """Equally spaced samples of a route; the line between them is a cubic."""

    position_m: NDArray[np.float64]
    """(K, 3); a closed route does not repeat its first point."""
    heading_rad: Array
    """In (−π, π], (K,)."""
    slope: Array
    """Rise per metre, (K,)."""
    curvature_radpm: Array
    """Left positive, (K,)."""
    speed_limit_mps: Array
    """(K,)."""
    lane: Index
    """Lane that each sample lies on, (K,)."""
    lane_station_m: Array
    """Its station there, (K,)."""
    length_m: float
    closed: bool
    fitted: NDArray[np.bool_] | None = None
    """Where the line was fitted to the car already, (K,); None for nowhere."""

    @property
    def step_m(self) -> float:
        """Distance between samples."""
        return self.length_m / (len(self.position_m) if self.closed else len(self.position_m) - 1)

    def at(self, s_m: ArrayLike) -> RoutePose:
        """Poses at distances from the start [m], (M,); closed routes go round, open ones end."""
        row, after, f = self._locate(np.atleast_1d(np.asarray(s_m, dtype=np.float64)))
        g, h = 1.0 - f, self.step_m
        w = f * f * (3.0 - 2.0 * f)
        m0, m1 = h * f * g * g, h * f * f * g
        tangents = self._tangents
        position = (
            self.position_m[row] * (1.0 - w)[:, None]
            + self.position_m[after] * w[:, None]
            + tangents(row) * m0[:, None]
            - tangents(after) * m1[:, None]
        )
        heading = self.heading_rad[row] + f * wrap_angle(self.heading_rad[after] - self.heading_rad[row])
        return RoutePose(
            position,
            wrap_angle(heading),
            elementary.arctan(self.slope[row] * g + self.slope[after] * f),
            self.curvature_radpm[row] * g + self.curvature_radpm[after] * f,
            self.speed_limit_mps[row],
            self.lane[row],
        )

    def row_at(self, s_m: float) -> int:
        """Number of the last sample at or before a distance from the start [m]."""
        row = int(s_m / self.step_m)
        number = len(self.position_m)
        return row % number if self.closed else min(max(row, 0), number - 1)

    def project(self, position_m: ArrayLike, near_s_m: float | None = None) -> tuple[float, float]:
        """Distance from the start and offset to the left [m] of a point (2|3,).

        Args:
            position_m: The point; a height is ignored.
            near_s_m: Where the answer was a moment ago: only 20 m back to 40 m on are searched, so that
                a route that crosses itself stays on its own branch.
        """
        x, y = (float(value) for value in np.asarray(position_m, dtype=np.float64)[:2])
        low, count = self._window(near_s_m)
        line = Line(self.position_m, self.heading_rad, self.curvature_radpm, self.step_m, self.closed)
        s, offset = project_on(line, x, y, low, count, self.length_m)
        return float(s), float(offset)

    def starting_at(self, position_m: ArrayLike) -> Route:
        """The same closed route, begun at its sample nearest to a point (2,).

        Raises:
            MapError: The route is open.
        """
        if not self.closed:
            raise MapError("only a loop can start anywhere; set loop = true or move the first route point")
        first = round(self.project(position_m)[0] / self.step_m)
        return self._taking(np.roll(np.arange(len(self.position_m)), -first), self.length_m)

    def cut_start(self, length_m: float) -> Route:
        """The last `length_m` metres of an open route, to the nearest sample."""
        first = max(len(self.position_m) - 1 - round(length_m / self.step_m), 0)
        return self._taking(np.arange(first, len(self.position_m)), self.length_m - first * self.step_m)

    def _taking(self, rows: Index, length_m: float) -> Route:
        """A route of some of the samples, in their new order."""
        samples = {name: getattr(self, name) for name in _SAMPLES}
        taken = {name: value[rows] for name, value in samples.items() if value is not None}
        return replace(self, length_m=length_m, **taken)

    def is_fitted(self, s_m: ArrayLike) -> NDArray[np.bool_]:
        """Whether the line leaves the lane's middle there for the car to fit round a tight turn, (M,)."""
        row, _, _ = self._locate(np.atleast_1d(np.asarray(s_m, dtype=np.float64)))
        return np.zeros(len(row), dtype=bool) if self.fitted is None else self.fitted[row]

    def _tangents(self, rows: Index) -> NDArray[np.float64]:
        heading = self.heading_rad[rows]
        return np.stack([elementary.cos(heading), elementary.sin(heading), self.slope[rows]], axis=-1)

    def _locate(self, s_m: Array) -> tuple[Index, Index, Array]:
        number = len(self.position_m)
        if self.closed:
            at = np.mod(s_m, self.length_m) / self.step_m
            row = np.minimum(at.astype(np.int64), number - 1)
            return row, (row + 1) % number, at - row
        at = np.clip(s_m / self.step_m, 0.0, number - 1.0)
        row = np.minimum(at.astype(np.int64), number - 2)
        return row, row + 1, at - row

    def _window(self, near_s_m: float | None) -> tuple[int, int]:
        """First sample to look at, and how many; those of a closed route go round."""
        number = len(self.position_m)
        if near_s_m is None or (self.closed and self.length_m < _BEHIND_M + _AHEAD_M):
            return 0, number
        low = int((near_s_m - _BEHIND_M) / self.step_m)
        high = int((near_s_m + _AHEAD_M) / self.step_m) + 1
        if self.closed:
            return low, high - low
        low = min(max(low, 0), number - 1)
        return low, min(max(high, low + 1), number) - low


_SAMPLES = tuple(field.name for field in fields(Route) if field.name not in ("length_m", "closed"))
"""Fields of a route that have a row for each sample."""


def plan_route(
    network: LaneNetwork,
    points_m: Sequence[tuple[float, float]],
    *,
    loop: bool = False,
    length_m: float | None = None,
    fit_turns: FitTurns | None = None,
) -> Route:
    """The cheapest route over driving lanes through points; lane changes count as 60 m of detour.

    Args:
        network: The lanes.
        points_m: World points (x, y) near the lanes to drive on, in order.
        loop: Drive on from the last point to the first.
        length_m: Length that an open route is cut to, at its start.
        fit_turns: Leaves the lanes' middle in turns that are too tight for a car there; None: no turn does.

    Raises:
        MapError: A point lies off the lanes, no way exists, or the route is shorter than asked.
    """
    if len(points_m) < 2:
        raise MapError("a route needs at least two points; add one")
    stops = [_positions(network, number, point) for number, point in enumerate(points_m)]
    if loop:
        # A loop must end where it began, so the first point keeps one lane.
        stops = [stops[0][:1], *stops[1:], stops[0][:1]]
    line = trace(network, path_through(network, stops))
    fitted = np.zeros(len(line.lane), dtype=bool)
    if fit_turns is not None:
        line, fitted = fit_turns(network, line)
    route = _sampled(network, line, fitted, loop)
    if length_m is None or loop:
        return route
    if route.length_m < length_m - 0.5:
        raise MapError(
            f"the route is {route.length_m:.0f} m long, {length_m:.0f} m are asked; add or move a point"
        )
    return route.cut_start(length_m)


def _positions(network: LaneNetwork, number: int, point: tuple[float, float]) -> list[LanePosition]:
    """Lanes that a route point may mean, the nearest first."""
    x, y = (float(v) for v in point)
    if not (np.isfinite(x) and np.isfinite(y)):
        raise MapError(f"route point {number + 1} is not finite; write two numbers")
    nearest = network.nearest([(x, y)])
    least = float(nearest.distance_m[0])
    if least > FARTHEST_POINT_M:
        raise MapError(
            f"route point {number + 1} ({x:.1f}, {y:.1f}) is {least:.0f} m off every lane; move it"
        )
    near = network.within((x, y), least + _AMBIGUITY_M)
    return [LanePosition(int(n), float(s)) for n, s in zip(near.lane, near.station_m, strict=True)]


def _sampled(network: LaneNetwork, line: RouteLine, fitted: NDArray[np.bool_], loop: bool) -> Route:
    if loop:
        # The last point is the first one again: keep it as the far end of the last piece.
        around = np.append(np.arange(len(line.lane) - 1), 0)
        line = line.taking(around)
    p = line.position_m
    chord = np.hypot(np.diff(p[:, 0]), np.diff(p[:, 1]))
    turn = wrap_angle(np.diff(line.heading_rad))
    half = 0.5 * turn
    # Arc over chord, which keeps the length of curves.
    arc = chord / np.maximum(elementary.sinc(np.clip(half, -1.0, 1.0) / np.pi), 0.5)
    total = np.concatenate([[0.0], np.cumsum(arc)])
    length = float(total[-1])
    if length < 2.0 * TABLE_STEP_M:
        raise MapError("the route is shorter than a metre; move its points apart")
    intervals = max(2, round(length / TABLE_STEP_M))
    s = np.arange(intervals if loop else intervals + 1) * (length / intervals)
    row = np.clip(np.searchsorted(total, s, side="right") - 1, 0, len(arc) - 1)
    span = np.maximum(arc[row], 1e-12)
    f = np.clip((s - total[row]) / span, 0.0, 1.0)
    g = 1.0 - f
    w = f * f * (3.0 - 2.0 * f)
    tangent = np.stack(
        [elementary.cos(line.heading_rad), elementary.sin(line.heading_rad), line.slope], axis=-1
    )
    position = (
        p[row] * (1.0 - w)[:, None]
        + p[row + 1] * w[:, None]
        + tangent[row] * (span * f * g * g)[:, None]
        - tangent[row + 1] * (span * f * f * g)[:, None]
    )
    heading = line.heading_rad[row] + f * turn[row]
    lane, station = _lane_of(network, line, row, f * span, g * span)
    return Route(
        position_m=position,
        heading_rad=wrap_angle(heading),
        slope=line.slope[row] * g + line.slope[row + 1] * f,
        curvature_radpm=_curvature(heading, length / intervals, loop),
        speed_limit_mps=network.speed_limit_mps(lane, station),
        lane=lane,
        lane_station_m=station,
        length_m=length,
        closed=loop,
        fitted=fitted[row] if fitted.any() else None,
    )


def _lane_of(
    network: LaneNetwork, line: RouteLine, row: Index, behind_m: Array, ahead_m: Array
) -> tuple[Index, Array]:
    """Lane and station of samples between two points; past the end of a lane, the next one."""
    lane, station = line.lane[row], line.station_m[row] + behind_m
    over = (line.lane[row + 1] != lane) & (station > network.tables.length_m[lane])
    after = np.maximum(line.station_m[row + 1] - ahead_m, 0.0)
    return np.where(over, line.lane[row + 1], lane), np.where(over, after, station)


def _curvature(heading_rad: Array, step_m: float, loop: bool) -> Array:
    """Central differences of the heading [1/m]."""
    if loop:
        return wrap_angle(np.roll(heading_rad, -1) - np.roll(heading_rad, 1)) / (2.0 * step_m)
    turn = wrap_angle(np.diff(heading_rad)) / step_m
    return np.concatenate([turn[:1], 0.5 * (turn[1:] + turn[:-1]), turn[-1:]])
