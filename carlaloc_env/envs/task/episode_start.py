"""How an episode begins: the options of a reset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from carlaloc_env.core.errors import ConfigError, MapError, unknown_name
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.routing.default_route import lanes_that_go_on
from carlaloc_env.town.routing.route import Route, plan_route
from carlaloc_env.town.town import Town
from carlaloc_env.weather.schedule import Weather, weather_of

OPTIONS = ("route", "spawn", "goal", "weather", "traffic")
"""Options of a reset."""
ROUTES = ("town", "random")
"""Routes by name: the town's own, and one drawn by the seed."""
RANDOM_ROUTE_M = (100.0, 600.0)
"""Lengths between which random routes lie, where the map has room for them [m]."""
_TRIES, _SHORT_TRIES = 200, 40
"""Draws for such a route, and then for one as long as a smaller map allows."""
_LANE_LEAST_M = 20.0
"""Shorter lanes are no place to begin or to end at, where others are [m]."""
_SHORTEST_M = 2.0
"""No route is shorter [m]."""

Point = tuple[float, float]
"""East and north [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeStart:
    """What a reset asks for."""

    route: str | tuple[Point, ...] = "town"
    """`town`, `random`, or points near lanes that it leads through [m]."""
    spawn: Point | None = None
    """Where it begins [m]."""
    goal: Point | None = None
    """Where it ends [m]."""
    weather: Weather | None = None
    """Weather; the environment's own when left out."""
    traffic: str | float | None = None
    """Level of traffic; the environment's own when left out."""

    @classmethod
    def of(cls, options: Mapping[str, Any] | None) -> EpisodeStart:
        """Options as users give them.

        Raises:
            ConfigError: an option is unknown, or a value does not fit.
        """
        for name in options or {}:
            if name not in OPTIONS:
                raise ConfigError("reset: " + unknown_name("option", str(name), OPTIONS))
        given = dict(options or {})
        if given.get("weather") is not None:
            given["weather"] = weather_of(given["weather"])
        for name in ("spawn", "goal"):
            if given.get(name) is not None:
                given[name] = _point(name, given[name])
        route = given.get("route")
        if isinstance(route, str):
            if route not in ROUTES:
                raise ConfigError("reset: " + unknown_name("route", route, ROUTES) + ", or points (x, y)")
        elif route is not None:
            given["route"] = _points(route)
        if isinstance(route, str) and route == "random" and given.get("goal") is not None:
            raise ConfigError("reset: a random route has no goal; leave one of the two out")
        return cls(**{name: value for name, value in given.items() if value is not None})


def route_of(start: EpisodeStart, town: Town, rng: np.random.Generator) -> Route:
    """The route of an episode.

    Args:
        start: What is asked for.
        town: Where.
        rng: Draws random routes.

    Raises:
        ConfigError: the town has no route of its own, or none can be drawn.
        MapError: a point lies off the lanes, or no way leads from one to the next.
    """
    if start.route == "random":
        return _random_route(town, rng, start.spawn)
    points = start.route if isinstance(start.route, tuple) else ()
    if not points and start.spawn is None and start.goal is None:
        return _own_route(town)
    if not points:
        own = None if start.spawn and start.goal else _own_route(town).position_m
        begin = start.spawn if own is None or start.spawn else (float(own[0, 0]), float(own[0, 1]))
        end = start.goal if own is None or start.goal else (float(own[-1, 0]), float(own[-1, 1]))
        assert begin is not None
        assert end is not None
        return plan_route(town.network, [begin, end], for_car=True)
    ends = [[start.spawn] if start.spawn else [], [start.goal] if start.goal else []]
    return plan_route(town.network, [*ends[0], *points, *ends[1]], for_car=True)


def _own_route(town: Town) -> Route:
    if town.route is None:
        raise ConfigError(f"town '{town.name}' has no route; give spawn and goal")
    return town.route


def _random_route(town: Town, rng: np.random.Generator, spawn: Point | None) -> Route:
    """A route between two places on lanes, of a length within `RANDOM_ROUTE_M`, or else shorter."""
    network = town.network
    onward = lanes_that_go_on(network)
    usable = onward if onward.any() else np.array([lane.type == "driving" for lane in network.lanes])
    plain = [lane.index for lane in network.lanes if usable[lane.index] and lane.junction_id is None]
    lanes = [lane for lane in plain if network.lanes[lane].length_m > _LANE_LEAST_M] or plain
    shorter: Route | None = None
    for least_m, tries in ((RANDOM_ROUTE_M[0], _TRIES), (_SHORTEST_M, _SHORT_TRIES)):
        for _ in range(tries if lanes else 0):
            route = _drawn_route(network, lanes, rng, spawn, least_m)
            if route is not None and route.length_m >= RANDOM_ROUTE_M[0]:
                return route
            if route is not None and (shorter is None or route.length_m > shorter.length_m):
                shorter = route
    if shorter is None:
        raise ConfigError(f"no random route of up to {RANDOM_ROUTE_M[1]:g} m in '{town.name}'; give points")
    return shorter


def _drawn_route(
    network: LaneNetwork, lanes: list[int], rng: np.random.Generator, spawn: Point | None, least_m: float
) -> Route | None:
    """A route between two places that are drawn, None where it is shorter than asked, or too long."""
    pair = rng.choice(lanes, 2)
    stations = rng.uniform(0.05, 0.95, 2) * network.tables.length_m[pair]
    places = network.pose(pair, stations).position_m[:, :2].tolist()
    begin, end = (spawn or tuple(places[0])), tuple(places[1])
    away = float(np.hypot(begin[0] - end[0], begin[1] - end[1]))
    if not 0.3 * least_m < away < RANDOM_ROUTE_M[1]:
        return None
    try:
        route = plan_route(network, [begin, end], for_car=True)
    except MapError:
        return None
    return route if least_m <= route.length_m <= RANDOM_ROUTE_M[1] else None


def _points(route: object) -> tuple[Point, ...]:
    if not isinstance(route, Sequence | np.ndarray) or len(route) < 1:
        raise ConfigError(f"reset: route is {route!r}; give 'town', 'random' or a list of points (x, y)")
    return tuple(_point("route", point) for point in route)


def _point(name: str, value: object) -> Point:
    try:
        x, y = (float(number) for number in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"reset: {name} is {value!r}; give a point (x, y) in metres") from error
    if not (np.isfinite(x) and np.isfinite(y)):
        raise ConfigError(f"reset: {name} is {value!r}; give finite numbers")
    return x, y
