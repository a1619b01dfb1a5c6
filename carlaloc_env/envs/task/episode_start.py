"""Beginning of an episode: the options of a reset."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any, NamedTuple

import numpy as np

from carlaloc_env.core.errors import ConfigError, MapError, unknown_name
from carlaloc_env.map.routing.default_route import lanes_that_go_on
from carlaloc_env.map.routing.route import Route
from carlaloc_env.town.town import Town
from carlaloc_env.weather.schedule import Weather, weather_of

OPTIONS = ("route", "start", "spawn", "goal", "weather", "traffic")
"""Options of a reset."""
ROUTES = ("town", "random")
"""Routes by name: the town's own, and one drawn by the seed."""
ANYWHERE = "anywhere"
"""The start that the seed draws."""
_LAST_START = 0.9
"""Share of a route up to which such starts lie."""
RANDOM_ROUTE_M = (100.0, 600.0)
"""Lengths between which random routes lie, where the map has room for them [m]."""
_TRIES, _SHORT_TRIES = 200, 40
"""Draws for such a route, and then for one as long as a smaller map allows."""
_LANE_LEAST_M = 20.0
"""Shorter lanes are no place to begin or to end at, where others are [m]."""
_SHORTEST_ROUTE_M = 2.0
"""No route is shorter [m]."""
CARS_APART_M = 15.0
"""Cars of a drive begin at least so far from each other [m]."""
_SAME_ROUTE_M = 0.01
"""Routes that differ more in length are not the same [m]."""

Point = tuple[float, float]
"""East and north [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EpisodeStart:
    """Options of a reset."""

    route: str | tuple[Point, ...] = "town"
    """`town`, `random`, or points near lanes that it leads through [m]."""
    start: float | str = 0.0
    """Share of the route that is left out before the car, 0 to below 1; `anywhere` draws it."""
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
        if given.get("start") is not None:
            given["start"] = _start(given["start"])
        route = given.get("route")
        if isinstance(route, str):
            if route not in ROUTES:
                raise ConfigError("reset: " + unknown_name("route", route, ROUTES) + ", or points (x, y)")
        elif route is not None:
            given["route"] = _points(route)
        if isinstance(route, str) and route == "random" and given.get("goal") is not None:
            raise ConfigError("reset: a random route has no goal; leave one of the two out")
        return cls(**{name: value for name, value in given.items() if value is not None})

    @property
    def route_text(self) -> str:
        """`town`, `random`, or the points from `spawn` to `goal` [m] as JSON."""
        points = () if isinstance(self.route, str) else self.route
        through = [point for point in (self.spawn, *points, self.goal) if point is not None]
        return json.dumps(through) if through and self.route != "random" else str(self.route)


class DrivenRoute(NamedTuple):
    """A route, and the points and the share that lead to the same one in the same town."""

    route: Route
    """The route from the place on where the car starts."""
    points_m: tuple[Point, ...]
    """Points near lanes that it was planned through [m]; empty: the town's own route."""
    start: float
    """Share of the planned route that is left out before the car."""
    end: float | None = None
    """Share of the planned route at which it ends; None: its own end."""

    def to_mapping(self) -> dict[str, Any]:
        """Plain data, as the header of an episode holds them."""
        length = {"length_m": self.route.length_m, "closed": self.route.closed}
        end = {} if self.end is None else {"end": self.end}
        return {"points_m": [list(point) for point in self.points_m], "start": self.start, **end, **length}


def route_again(mapping: Mapping[str, Any], town: Town) -> Route:
    """The route of `DrivenRoute.to_mapping`; without points, the town's own.

    Raises:
        ConfigError: the town has no route, or another one.
        MapError: a point lies off the lanes, or no lanes lead from one to the next.
    """
    points = mapping.get("points_m") or "town"
    end = mapping.get("end")
    given = {"route": points} if end is not None else {"route": points, "start": mapping.get("start", 0.0)}
    route = route_of(EpisodeStart.of(given), town, np.random.default_rng(0)).route
    if end is not None:
        route = _between(route, float(mapping["start"]), float(end))
    length_m = float(mapping.get("length_m", route.length_m))
    if abs(length_m - route.length_m) > _SAME_ROUTE_M:
        raise ConfigError(
            f"the drive's route is {length_m:.1f} m long, and that of '{town.name}' {route.length_m:.1f} m; "
            "record the drive anew"
        )
    return route


def route_of(start: EpisodeStart, town: Town, rng: np.random.Generator) -> DrivenRoute:
    """The route of an episode.

    Args:
        start: What is asked for.
        town: Where.
        rng: Draws random routes and starts.

    Raises:
        ConfigError: the town has no route, or none can be drawn.
        MapError: a point lies off the lanes, or no lanes lead from one to the next.
    """
    route, points = _whole_route(start, town, rng)
    share = rng.uniform(0.0, _LAST_START) if start.start == ANYWHERE else float(start.start)
    rest = _from(route, share * route.length_m) if share else route
    return DrivenRoute(route=rest, points_m=tuple(points), start=share)


def car_routes(
    start: EpisodeStart, town: Town, rng: np.random.Generator, cars: int, overlap: float
) -> list[DrivenRoute]:
    """Routes of the cars of a drive; one car has that of `route_of`.

    Several have stretches of it, as long as each other, each of which has a share in common with the next;
    random routes are drawn for each.

    Args:
        start: What is asked for.
        town: Where.
        rng: Draws random routes and starts.
        cars: Number of cars.
        overlap: Share of a stretch that it has in common with the next, 0 to 1.

    Raises:
        ConfigError: the route is too short for so many cars, or as `route_of`.
        MapError: as `route_of`.
    """
    whole = route_of(start, town, rng)
    if cars == 1:
        return [whole]
    if start.route == "random":
        return _apart([whole], start, town, rng, cars)
    length_m, points = whole.route.length_m, whole.points_m
    step = (1.0 - overlap) / (cars - (cars - 1) * overlap)
    step = max(step, CARS_APART_M / length_m)
    share = 1.0 - (cars - 1) * step
    if share * length_m < CARS_APART_M:
        raise ConfigError(f"a route of {length_m:.0f} m is too short for {cars} cars; give fewer")
    if whole.start:
        # Shares are counted on the planned route, as `route_again` does.
        planned = _whole_route(start, town, rng)[0]
        scale, first = (1.0 if planned.closed else 1.0 - whole.start), whole.start
        stretches = [(first + scale * k * step, first + scale * (k * step + share)) for k in range(cars)]
        return [DrivenRoute(_between(planned, *ends), points, *ends) for ends in stretches]
    stretches = [(k * step, k * step + share) for k in range(cars)]
    return [DrivenRoute(_between(whole.route, *ends), points, *ends) for ends in stretches]


def _apart(
    routes: list[DrivenRoute], start: EpisodeStart, town: Town, rng: np.random.Generator, cars: int
) -> list[DrivenRoute]:
    """Random routes, of which no two begin next to each other."""
    for _ in range(_TRIES):
        drawn = route_of(start, town, rng)
        begin_m = drawn.route.position_m[0]
        apart_m = [float(np.linalg.norm(begin_m - other.route.position_m[0])) for other in routes]
        if min(apart_m) > CARS_APART_M:
            routes.append(drawn)
        if len(routes) == cars:
            return routes
    raise ConfigError(
        f"no {cars} random routes begin apart from each other in '{town.name}'; give fewer cars"
    )


def _between(route: Route, start: float, end: float) -> Route:
    """The stretch of a route between two shares of it, an open route; a loop goes on past its end."""
    count = len(route.position_m)
    last = end * route.length_m / route.step_m
    rows = np.arange(round(start * route.length_m / route.step_m), round(last) + 1)
    rows = rows % count if route.closed else rows[rows < count]
    return replace(route.taking(rows, (len(rows) - 1) * route.step_m), closed=False)


def _from(route: Route, s_m: float) -> Route:
    """The route from its sample at or before a distance from its start [m] on; a loop is begun there."""
    row = route.row_at(s_m)
    if route.closed:
        return route.starting_at(route.position_m[row, :2])
    return route.starting_with(min(row, len(route.position_m) - 2))


def _whole_route(start: EpisodeStart, town: Town, rng: np.random.Generator) -> tuple[Route, Sequence[Point]]:
    """A route, and the points that it was planned through: none for the town's own."""
    if start.route == "random":
        return _random_route(town, rng, start.spawn)
    points = start.route if isinstance(start.route, tuple) else ()
    if not points and start.spawn is None and start.goal is None:
        return _town_route(town), ()
    if not points:
        line = None if start.spawn and start.goal else _town_route(town).position_m
        begin = start.spawn if line is None or start.spawn else (float(line[0, 0]), float(line[0, 1]))
        end = start.goal if line is None or start.goal else (float(line[-1, 0]), float(line[-1, 1]))
        assert begin is not None
        assert end is not None
        return town.plan_route([begin, end]), (begin, end)
    ends = [[start.spawn] if start.spawn else [], [start.goal] if start.goal else []]
    through = [*ends[0], *points, *ends[1]]
    return town.plan_route(through), through


def _town_route(town: Town) -> Route:
    if town.route is None:
        raise ConfigError(f"town '{town.name}' has no route; give spawn and goal")
    return town.route


def _random_route(town: Town, rng: np.random.Generator, spawn: Point | None) -> tuple[Route, Sequence[Point]]:
    """A route between two places on lanes, of a length within `RANDOM_ROUTE_M`, or else shorter."""
    network = town.network
    onward = lanes_that_go_on(network)
    usable = onward if onward.any() else np.array([lane.type == "driving" for lane in network.lanes])
    plain = [lane.index for lane in network.lanes if usable[lane.index] and lane.junction_id is None]
    lanes = [lane for lane in plain if network.lanes[lane].length_m > _LANE_LEAST_M] or plain
    shorter: tuple[Route, Sequence[Point]] | None = None
    for least_m, tries in ((RANDOM_ROUTE_M[0], _TRIES), (_SHORTEST_ROUTE_M, _SHORT_TRIES)):
        for _ in range(tries if lanes else 0):
            drawn = _drawn_route(town, lanes, rng, spawn, least_m)
            if drawn is not None and drawn[0].length_m >= RANDOM_ROUTE_M[0]:
                return drawn
            if drawn is not None and (shorter is None or drawn[0].length_m > shorter[0].length_m):
                shorter = drawn
    if shorter is None:
        raise ConfigError(f"no random route of up to {RANDOM_ROUTE_M[1]:g} m in '{town.name}'; give points")
    return shorter


def _drawn_route(
    town: Town, lanes: list[int], rng: np.random.Generator, spawn: Point | None, least_m: float
) -> tuple[Route, Sequence[Point]] | None:
    """A route between two places that are drawn, and these; None where it is too short or too long."""
    pair = rng.choice(lanes, 2)
    stations = rng.uniform(0.05, 0.95, 2) * town.network.tables.length_m[pair]
    places = town.network.pose(pair, stations).position_m[:, :2].tolist()
    begin, end = (spawn or tuple(places[0])), tuple(places[1])
    away = float(np.hypot(begin[0] - end[0], begin[1] - end[1]))
    if not 0.3 * least_m < away < RANDOM_ROUTE_M[1]:
        return None
    try:
        route = town.plan_route([begin, end])
    except MapError:
        return None
    return (route, (begin, end)) if least_m <= route.length_m <= RANDOM_ROUTE_M[1] else None


def _start(value: object) -> float | str:
    if value == ANYWHERE:
        return ANYWHERE
    if isinstance(value, Real) and 0.0 <= float(value) < 1.0:
        return float(value)
    wanted = f"'{ANYWHERE}', or a share of the route from 0 to below 1"
    raise ConfigError(f"reset: start is {value!r}; give {wanted}")


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
