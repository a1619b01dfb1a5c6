"""Plans a route: the cheapest way over driving lanes through points, sampled every half metre."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array, Index
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.transforms import wrap_angle
from carlaloc_env.map.lanes.centre_lines import TABLE_STEP_M
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.lanes.shortest_paths import LanePosition, path_through
from carlaloc_env.map.routing.route import Route
from carlaloc_env.map.routing.smoothing import RouteLine, trace

FitTurns = Callable[[LaneNetwork, RouteLine], tuple[RouteLine, NDArray[np.bool_]]]
"""Fits the tight turns of a line to a car: the new line, and which of its points were fitted."""
FARTHEST_POINT_M = 15.0
"""Route points farther from every lane are refused."""
_AMBIGUITY_M = 1.0


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
