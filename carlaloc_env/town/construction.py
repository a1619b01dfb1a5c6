"""Builds a town out of its map: default zones and traffic, roads, scenery.

Everything that stands still in a town, built from its map.

Zones for maps that come without a `town.toml`, chosen from their roads.

Default numbers of vehicles and walkers of a town.
"""

import dataclasses
from collections import Counter
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.scene.materials import Material, Tag
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.town.buildings.building_lots import lot_boxes
from carlaloc_env.town.buildings.skyline import add_skyline
from carlaloc_env.town.config import TownConfig, TrafficCounts, Zone
from carlaloc_env.town.ground.ground_plan import Groundwork, lay_groundwork
from carlaloc_env.town.lanes.build_network import build_network
from carlaloc_env.town.lanes.lane_network import LaneNetwork
from carlaloc_env.town.mapped import MappedFeature, land_points
from carlaloc_env.town.meshing.batches import InstanceIds
from carlaloc_env.town.meshing.mesh_builder import FAR_CHUNK_M, split_chunks
from carlaloc_env.town.meshing.polygons import polygons_of, weld
from carlaloc_env.town.opendrive.records import OpenDrive, Road
from carlaloc_env.town.roads.road_classes import road_levels
from carlaloc_env.town.roads.surfaces import Surfaces, add_surfaces
from carlaloc_env.town.routing.default_route import choose_route
from carlaloc_env.town.routing.route import Route, plan_route
from carlaloc_env.town.street.scene_dressing import dress
from carlaloc_env.town.street.site_plan import place_plots
from carlaloc_env.town.town import TownRoads, TownScenery, relief_on


def build_scenery(
    network: LaneNetwork,
    config: TownConfig,
    seed: int,
    route_m: Array | None = None,
    mapped: Sequence[MappedFeature] | None = None,
) -> TownScenery:
    """Scenery of a map; the same map, configuration, seed and features give the same bytes.

    Args:
        network: Lanes of the map.
        config: Settings.
        seed: Number from which all that is not given is drawn.
        route_m: Points of the ego's route (N, 2) [m].
        mapped: Things beside the roads; None: houses and plants are invented.
    """
    work, out = lay_groundwork(network, config, land_points(mapped or ())), Surfaces()
    tunnel_lamps = add_surfaces(out, network, work, seed)
    plots = place_plots(work, config, seed, mapped)
    boxes = np.concatenate([lot_boxes(plots.lots, plots.bases_m), plots.mapped_boxes()])
    out.solid.quads(boxes, material=Material.PLAIN, tag=Tag.BUILDING)
    ids = InstanceIds()
    buildings = plots.buildings(seed, ids)
    dressing = dress(out, network, work, plots, config, route_m, seed, ids)
    firm = out.raised.build()
    vertices, triangles, tags = weld([out.solid.build(), firm])
    near = [out.lanes.build(), firm, dressing.cover, out.paint.build(), *buildings]
    far = _far_town(work, seed, ids)
    return TownScenery(
        chunks=split_chunks(merge([*near, *dressing.meshes])) + split_chunks(merge(far), FAR_CHUNK_M),
        collision_vertices_m=vertices,
        collision_triangles=triangles,
        collision_tags=tags,
        lenses=dressing.lenses,
        road_events=np.concatenate(out.events),
        lamps_m=np.concatenate([dressing.lamps_m, tunnel_lamps]),
    )


def _far_town(work: Groundwork, seed: int, ids: InstanceIds) -> list[Mesh]:
    seas = shapely.union_all([sea for sea, _ in work.seas])
    return add_skyline(work.bounds, work.zones, work.ground, seed, ids, seas)


CELL_M = 40.0
"""Side of the squares that zones are made of [m]."""
RANGE_M = 130.0
"""How far zones reach beyond the roads [m]."""
HIGHWAY_MPS, RURAL_MPS, QUIET_MPS = 80.0 / 3.6 - 0.1, 54.0 / 3.6, 30.0 / 3.6 + 0.1
"""Limits from which roads are highways, from which two-lane roads lead through the country, and up to
which streets are quiet [m/s]."""
QUIET_TYPES = ("townPlayStreet", "townPrivate", "lowSpeed")
"""Types of quiet streets."""
TOWN_TYPES = ("town", "townExpressway", "townCollector", "townArterial", "townLocal", *QUIET_TYPES)
"""Types of roads in towns."""
SUBURB = 1.15
"""Small streets farther from the middle than this many times the mean distance are residential."""
_STEP_M = 10.0


def road_kind(road: Road) -> str:
    """Kind of zone that suits a road: by its type, limit, lanes and sidewalks."""
    lanes = [lane for section in road.sections for lane in section.lanes]
    stated = [*road.speeds, *(record for lane in lanes for record in lane.speeds)]
    limit = max((record.limit_mps for record in stated), default=0.0)
    widest = max(sum(lane.type == "driving" for lane in section.lanes) for section in road.sections)
    walked = any(lane.type in ("sidewalk", "walking") for lane in lanes)
    # Hard shoulders are lanes of type stop.
    if road.type == "motorway" or limit >= HIGHWAY_MPS or any(lane.type == "stop" for lane in lanes):
        return "highway"
    if widest <= 2 and (not walked or limit >= RURAL_MPS or road.type == "rural"):
        return "rural"
    if not walked:
        return "industrial" if road.type in TOWN_TYPES or 0.0 < limit < RURAL_MPS else "highway"
    if widest >= 6:
        return "skyscraper"
    if widest >= 4:
        return "downtown"
    quiet = 0.0 < limit <= QUIET_MPS or road.type in QUIET_TYPES
    return "residential" if quiet else "small_town"


def choose_zones(network: LaneNetwork, config: TownConfig) -> TownConfig:
    """The configuration with zones along the roads of each kind, and the commonest as default.

    A square takes the kind of the road nearest to it; small streets far from the middle of the streets
    become residential.
    """
    points, kinds = _samples(network)
    if not kinds:
        return config
    names = sorted(set(kinds))
    index = np.array([names.index(kind) for kind in kinds])
    if "small_town" in names:
        index, names = _suburbs(points, index, names)
    common = Counter(index.tolist()).most_common(1)[0][0]
    low = np.floor((points.min(axis=0) - RANGE_M) / CELL_M) * CELL_M
    shape = np.ceil((points.max(axis=0) + RANGE_M - low) / CELL_M).astype(int)
    i, j = (axis.ravel() for axis in np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"))
    corner = low + np.stack([i, j], axis=-1) * CELL_M
    _, nearest = cKDTree(points).query(corner + CELL_M / 2)
    cells = index[nearest]
    zones = []
    for number, name in enumerate(names):
        if number == common:
            continue
        corners = corner[cells == number]
        boxes = shapely.box(corners[:, 0], corners[:, 1], corners[:, 0] + CELL_M, corners[:, 1] + CELL_M)
        for part in polygons_of(shapely.union_all(boxes)):
            zones.append((shapely.Polygon(part.exterior).area, name, _outline(part.exterior)))
    for hole in _holes(corner, cells, common):
        zones.append((shapely.Polygon(hole).area, names[common], _outline(hole)))
    # Where outlines overlap the smaller one lies in a hole of the larger, and the later zone holds.
    ordered = sorted(zones, key=lambda zone: (-zone[0], zone[1], zone[2]))
    found = tuple(Zone(kind=name, polygon=outline) for _, name, outline in ordered)
    return dataclasses.replace(config, default_zone=names[common], zones=found)


def _outline(ring: shapely.LinearRing) -> tuple[tuple[float, float], ...]:
    corners = shapely.get_coordinates(shapely.simplify(ring, 0.1))[:-1]
    return tuple((float(x), float(y)) for x, y in corners)


def _samples(network: LaneNetwork) -> tuple[Array, list[str]]:
    """Points on the reference lines of all roads outside junctions (N, 2), and their kinds."""
    points, kinds = [], []
    plan = network.surface.plan_view
    for number, road in enumerate(network.xodr.roads):
        if road.junction_id is not None or road.length_m < 1.0 or not road.sections:
            continue
        s = np.linspace(0.0, road.length_m, int(road.length_m / _STEP_M) + 2)
        pose = plan.evaluate(np.full(len(s), number), s)
        points.append(np.stack([pose.x_m, pose.y_m], axis=-1))
        kinds += [road_kind(road)] * len(s)
    return (np.concatenate(points) if points else np.zeros((0, 2))), kinds


def _suburbs(points: Array, index: NDArray[np.int_], names: list[str]) -> tuple[NDArray[np.int_], list[str]]:
    """Small streets far from their middle become residential."""
    small = index == names.index("small_town")
    centre = points[small].mean(axis=0)
    distance = np.sqrt(np.sum((points - centre) ** 2, axis=1))
    far = small & (distance > SUBURB * distance[small].mean())
    if "residential" not in names:
        names = [*names, "residential"]
    return np.where(far, names.index("residential"), index), names


def _holes(corner: Array, cells: NDArray[np.int_], common: int) -> list[shapely.LinearRing]:
    """Outlines of patches of the commonest kind that other kinds enclose."""
    others = corner[cells != common]
    if not len(others):
        return []
    boxes = shapely.box(others[:, 0], others[:, 1], others[:, 0] + CELL_M, others[:, 1] + CELL_M)
    return [ring for part in polygons_of(shapely.union_all(boxes)) for ring in part.interiors]


def choose_config(xodr: OpenDrive, name: str) -> TownConfig:
    """Zones for a map without a `town.toml`."""
    return choose_zones(build_network(xodr), TownConfig(name=name))


def build_roads(xodr: OpenDrive, config: TownConfig, seed: int) -> TownRoads:
    """The roads of a map.

    Args:
        xodr: The map.
        config: Settings of `town.toml`, or those chosen in its place.
        seed: Number from which their relief is drawn.

    Raises:
        MapError: No lane is for cars.
    """
    levels = road_levels(xodr.roads, config)
    network = build_network(xodr, relief_on(seed, levels))
    types = sorted({lane.type for lane in network.lanes})
    if "driving" not in types:
        known = ", ".join(types[:8])
        raise MapError(
            f"{xodr.source}: no lane is of type driving, so no car can drive there; it has {known}"
        )
    # Else the map's own reference, else the equator at Greenwich's meridian.
    geo = config.geo or xodr.geo or GeoReference(latitude_deg=0.0, longitude_deg=0.0)
    return TownRoads(network=network, levels=levels, route=_route(network, config), geo=geo)


def _route(network: LaneNetwork, config: TownConfig) -> Route | None:
    wanted = config.route
    if not wanted.points:
        return choose_route(network)
    route = plan_route(network, wanted.points, loop=wanted.loop, length_m=wanted.length_m, for_car=True)
    return route.starting_at(wanted.start) if wanted.start is not None else route


VEHICLES, WALKERS = 50, 10
"""Vehicles and walkers of a map that has room for them."""
VEHICLES_PER_KM = 8.0
"""Vehicles for each kilometre of driving lane outside junctions: light traffic that no map jams under."""
WALKERS_PER_KM = 40.0
"""Walkers for each kilometre of sidewalk, at most."""
_SHORTEST_LANE_M, _SHORTEST_SIDEWALK_M = 14.0, 12.0
_NARROWEST_LANE_M, _NARROWEST_SIDEWALK_M = 2.5, 0.9


def traffic_counts(network: LaneNetwork, asked: TrafficCounts) -> tuple[int, int]:
    """Vehicles and walkers of a town: as many as are asked for, else what there is room for.

    Maps without sidewalks get no walkers; small maps get fewer vehicles.
    """
    if asked.vehicles is not None and asked.walkers is not None:
        return asked.vehicles, asked.walkers
    tables = network.tables
    least_m = np.minimum.reduceat(tables.width_m, tables.first) if network.lanes else tables.width_m
    lanes_m = sidewalks_m = 0.0
    for lane, width_m in zip(network.lanes, least_m, strict=True):
        if lane.type == "driving":
            fits = lane.length_m > _SHORTEST_LANE_M and width_m > _NARROWEST_LANE_M
            lanes_m += lane.length_m if fits and lane.junction_id is None else 0.0
        elif lane.type == "sidewalk":
            fits = lane.length_m > _SHORTEST_SIDEWALK_M and width_m > _NARROWEST_SIDEWALK_M
            sidewalks_m += lane.length_m if fits else 0.0
    vehicles = min(VEHICLES, round(VEHICLES_PER_KM * lanes_m / 1000.0))
    walkers = min(WALKERS, int(WALKERS_PER_KM * sidewalks_m / 1000.0))
    return (
        vehicles if asked.vehicles is None else asked.vehicles,
        walkers if asked.walkers is None else asked.walkers,
    )
