"""Stop lines of a route: where its driver has to obey lights, and when a car comes there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.routing.route import Route

DEPARTURE_S = 3.0
"""When a drive gets going: it begins with two seconds of rest [s]."""
_LATERAL_MPS2 = 2.4
"""Lateral acceleration that a driver accepts in bends [m/s²]."""
_SPEED_UP_MPS2 = 1.5
"""Acceleration and braking that a driver uses between bends [m/s²]."""


class StopLines(NamedTuple):
    """Stop lines of a route that have lights, in the order in which they are passed, L of them."""

    s_m: Array
    """Distances along the route [m], (L,)."""
    heads: list[list[int]]
    """Numbers of the signal heads that count at each."""


def stop_lines(network: LaneNetwork, route: Route) -> StopLines:
    """Stop lines of a route at which lights must be obeyed."""
    heads_at: dict[float, list[int]] = {}
    for index, head in enumerate(network.signals):
        for lane, stop in zip(head.lanes, head.stop_station_m, strict=True):
            on_lane = np.flatnonzero(route.lane == lane)
            if not len(on_lane):
                continue
            # A closed route may pass a lane twice; each run of samples is one passing.
            for run in np.split(on_lane, np.flatnonzero(np.diff(on_lane) > 1) + 1):
                onward = int(route.lane[(run[-1] + 1) % len(route.lane)])
                if head.junction_lanes and onward not in head.junction_lanes:
                    continue
                k = run[np.argmin(np.abs(route.lane_station_m[run] - stop))]
                s = float(k * route.step_m + (stop - route.lane_station_m[k]))
                heads_at.setdefault(round(s, 2), []).append(index)
    stops = sorted(heads_at)
    return StopLines(np.array(stops), [heads_at[s] for s in stops])


def travel_times_s(route: Route, s_m: Array) -> Array:
    """Times that a car needs on a free street to come to distances along its route [s], (L,)."""
    step = route.step_m
    bend_mps = np.sqrt(_LATERAL_MPS2 / np.maximum(np.abs(route.curvature_radpm), 1e-4))
    speed = np.minimum(route.speed_limit_mps, bend_mps)
    speed[0] = min(speed[0], 1.0)
    gain = 2.0 * _SPEED_UP_MPS2 * step
    for k in range(1, len(speed)):
        speed[k] = min(speed[k], np.sqrt(speed[k - 1] ** 2 + gain))
    for k in range(len(speed) - 2, -1, -1):
        speed[k] = min(speed[k], np.sqrt(speed[k + 1] ** 2 + gain))
    time_s = np.concatenate([[0.0], np.cumsum(step / speed)[:-1]])
    times: Array = np.interp(s_m, np.arange(len(speed)) * step, time_s)
    return times
