"""The `town.toml` of an imported town: its place, zones from land use, traffic, route."""

from __future__ import annotations

import itertools
import json

import numpy as np
import shapely

from carlaloc_env.authoring.elements.map_parts import RoadPart
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.opendrive.reader import read_opendrive
from carlaloc_env.map.routing.default_route import choose_loop
from carlaloc_env.map.routing.plan_route import FitTurns
from carlaloc_env.openstreetmap.axes import sampled
from carlaloc_env.openstreetmap.extract import Extract
from carlaloc_env.openstreetmap.features import Features
from carlaloc_env.openstreetmap.road_network import RoadNetwork
from carlaloc_env.openstreetmap.turning_places import PLACE_NAME

ZONES = {
    "field": "rural", "wood": "rural", "residential": "residential", "industrial": "industrial",
    "downtown": "downtown", "green": "park", "water": "water",
}  # fmt: skip
"""Kinds of zones of areas, those that hold over others last."""
LEAST_M2 = {"water": 150.0, "park": 400.0}
"""Smallest area that becomes a zone; of other kinds ten times as much [m²]."""
ISLAND_M2 = 20.0
"""Smallest island that stays in a water [m²]."""
DENSE = 0.28
"""Share of the ground under houses from which a quarter without land use is a downtown."""
VEHICLES_PER_KM, WALKERS_PER_KM = 7.0, 4.0
"""Road users for each kilometre of street."""
BESIDE_M, OPEN_WORTH = 45.0, 0.2
"""A default route passes houses so near [m]; and what a street without any is worth to it."""
LEAST_WORTH = 0.5
"""Loops of a lower mean worth compete with those that turn back in turning places."""
LEAST_ROWS = 30
"""Lanes of so many samples of a route, or fewer, are none of its points."""
MOST_VEHICLES, MOST_WALKERS = 160, 60


def settings_text(
    name: str,
    extract: Extract,
    features: Features,
    network: RoadNetwork,
    xodr: str,
    fit_turns: FitTurns | None,
) -> str:
    """Text of `town.toml`, for the map whose text is `xodr`."""
    geo = extract.geo
    roads = [road for road in network.roads if road.junction < 0]
    km = sum(road.length for road in roads) / 1000.0
    walked = sum(road.length for road in roads if _walked(road)) / 1000.0
    lines = [
        "# Made of OpenStreetMap: © OpenStreetMap contributors, ODbL 1.0.",
        "",
        "[town]",
        f"name = {json.dumps(name, ensure_ascii=False)}",
        f'description = "{km:.1f} km of streets from OpenStreetMap"',
        f'default_zone = "{_default_zone(features, network)}"',
        "",
        "[geo]",
        f"latitude_deg = {geo.latitude_deg}",
        f"longitude_deg = {geo.longitude_deg}",
        *([f"height_m = {geo.height_m}"] if geo.height_m else []),
        "",
        "[traffic]",
        f"vehicles = {min(MOST_VEHICLES, round(VEHICLES_PER_KM * km))}",
        f"walkers = {min(MOST_WALKERS, round(WALKERS_PER_KM * walked))}",
        *_route(xodr, features, fit_turns),
    ]
    dry = _ground_of(network)
    for kind, zone in ZONES.items():
        for feature in features.of(kind):
            shape = feature.shape
            if zone == "water":
                shape = shapely.difference(shape, dry)
            parts = shapely.get_parts(shapely.simplify(shape, 1.0))
            for part in itertools.chain.from_iterable(map(_whole, parts)) if zone == "water" else parts:
                if part.geom_type == "Polygon" and part.area >= LEAST_M2.get(zone, 3000.0):
                    lines += ["", "[[zone]]", f'kind = "{zone}"', f"polygon = {_corners(part)}"]
    return "\n".join(lines) + "\n"


def _route(xodr: str, features: Features, fit_turns: FitTurns | None) -> list[str]:
    """Lines of the default route: about a kilometre of the town's own streets, past houses where it can."""
    town = read_opendrive(xodr.encode())
    lanes = build_network(town)
    ours = {road.id for road in town.roads if PLACE_NAME in road.name or ": back from" in road.name}
    avoided = np.array([lane.road_id in ours for lane in lanes.lanes])
    tables = lanes.tables
    houses = shapely.STRtree([house.shape for house in features.of("building")])
    near, _ = houses.query(shapely.points(tables.position_m[:, :2]), predicate="dwithin", distance=BESIDE_M)
    beside = np.isin(np.arange(len(tables.position_m)), near).astype(float)
    worth = OPEN_WORTH + (1.0 - OPEN_WORTH) * np.add.reduceat(beside, tables.first) / tables.count
    routes = [choose_loop(lanes, avoided=avoided, fit_turns=fit_turns, worth=worth)]
    if routes[0] is None or worth[routes[0].lane].mean() < LEAST_WORTH:
        routes.append(choose_loop(lanes, fit_turns=fit_turns, worth=worth * ~avoided))
    route = max(filter(None, routes), key=lambda loop: float(worth[loop.lane].mean()), default=None)
    if route is None:
        return []
    starts = np.flatnonzero(np.diff(route.lane, prepend=-1))
    middles = [(a + b) // 2 for a, b in itertools.pairwise([*starts, len(route.lane)])
               if lanes.lanes[route.lane[a]].junction_id is None and b - a > LEAST_ROWS]  # fmt: skip
    points = ", ".join(f"[{x:.2f}, {y:.2f}]" for x, y, _ in route.position_m[[0, *middles[1:-1]]])
    return ["", "[route]", f"points = [{points}]", "loop = true"]


def _walked(road: RoadPart) -> bool:
    return any(lane.kind == "sidewalk" for _, lane in road.sections[0].lanes())


def _whole(polygon: shapely.Polygon) -> list[shapely.Polygon]:
    """Parts without islands, cut through them from south to north."""
    islands = [ring for ring in shapely.get_rings(polygon)[1:] if shapely.Polygon(ring).area >= ISLAND_M2]
    if polygon.geom_type != "Polygon" or not islands:
        return [polygon]
    west, south, east, north = polygon.bounds
    x = round(float(islands[0].centroid.x), 2)
    halves = [
        shapely.intersection(shapely.Polygon(polygon.exterior, islands), shapely.box(*sides))
        for sides in ((west - 1.0, south - 1.0, x, north + 1.0), (x, south - 1.0, east + 1.0, north + 1.0))
    ]
    return [whole for half in halves for part in shapely.get_parts(half) for whole in _whole(part)]


def _corners(polygon: shapely.Polygon) -> str:
    corners = shapely.get_coordinates(polygon.exterior)[:-1]
    return "[" + ", ".join(f"[{x:.2f}, {y:.2f}]" for x, y in corners) + "]"


def _ground_of(network: RoadNetwork) -> shapely.Geometry:
    """Ground of all streets that stand on it, with a margin: no water lies there."""
    shapes = []
    for road in network.roads:
        if any(abs(a) > 2.0 for _, a, *_ in road.elevation):
            continue
        section = road.sections[0]
        half = max(sum(lane.width_at(0.0) for lane in side) for side in (section.left, section.right))
        line = shapely.LineString(sampled(road.path, 6.0))
        shapes.append(shapely.buffer(line, half + abs(section.offset[0][1][0]) + 2.5))
    return shapely.union_all(shapes)


def _default_zone(features: Features, network: RoadNetwork) -> str:
    """Downtown where houses are dense, country where they are few, a small town else."""
    houses = features.of("building")
    points = np.array([(p.x, p.y) for road in network.roads for p in (road.path.start, road.path.end)])
    near = shapely.buffer(shapely.MultiPoint(points), 60.0)
    share = sum(house.shape.area for house in houses) / max(near.area, 1.0)
    if share > DENSE:
        return "downtown"
    return "small_town" if share > 0.06 else "rural"
