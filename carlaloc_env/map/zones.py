"""Zones for maps that come without a `town.toml`, chosen from their roads."""

import dataclasses
from collections import Counter

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.areas import polygons_of
from carlaloc_env.core.array_types import Array
from carlaloc_env.map.config import TownConfig, Zone
from carlaloc_env.map.lanes.build_network import build_network
from carlaloc_env.map.lanes.lane_network import LaneNetwork
from carlaloc_env.map.opendrive.records import OpenDrive, Road

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
    chosen = tuple(Zone(kind=name, polygon=outline) for _, name, outline in ordered)
    return dataclasses.replace(config, default_zone=names[common], zones=chosen)


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
