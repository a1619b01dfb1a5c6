"""Extracts of OpenStreetMap: files read, cut to a box, and placed in the world."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.geodesy import GeoReference
from carlaloc_env.openstreetmap.elements import LANELET2, Relation, Tags, Way, read_elements
from carlaloc_env.openstreetmap.tags import for_cars

Box = tuple[float, float, float, float]
"""West, south, east, north [deg]."""
NODE_LIMIT = 3_000_000
"""Extracts with more nodes inside the box are refused."""
MOST_STREETS_M = 100e3
"""Extracts with more metres of streets for cars are refused."""
WIDEST_DEG = 0.5
"""Extracts whose streets lie so far apart are refused [deg]."""
PROPOSED_M, DEGREE_M = 2000.0, 111_200.0
"""Side of a box that a message proposes, and length of a degree of latitude [m]."""
COAST_DEG = 0.03
"""Coasts so near to the box are kept [deg]."""


@dataclass(slots=True)
class Extract:
    """The part of a file that lies in the box; nodes outside it are unknown."""

    source: str
    degrees: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Longitude and latitude of every node [deg]."""
    node_tags: dict[int, Tags] = field(default_factory=dict)
    ways: dict[int, Way] = field(default_factory=dict)
    relations: list[Relation] = field(default_factory=list)
    broken: list[int] = field(default_factory=list)
    """Ways with fewer than two known nodes."""
    deleted: list[str] = field(default_factory=list)
    """Ways and relations that an editor has marked as deleted."""
    geo: GeoReference = field(default_factory=lambda: GeoReference(latitude_deg=0.0, longitude_deg=0.0))
    """The origin of the world, in the middle of the nodes."""
    xy_m: dict[int, tuple[float, float]] = field(default_factory=dict)
    """World x and y of every node [m]: east and north of the origin."""

    def line(self, nodes: tuple[int, ...] | list[int]) -> Array:
        """World points (N, 2) of nodes [m]."""
        return np.array([self.xy_m[node] for node in nodes])


def read_extract(path: Path, box: Box | None = None) -> Extract:
    """Read a file, cut it to a box, and place its nodes on the plane that touches the Earth in the middle.

    Args:
        path: An .osm, .osm.gz, .osm.bz2 or .osm.pbf file.
        box: West, south, east, north [deg]; None: the whole file.

    Raises:
        MapError: The file cannot be read, ends early, holds too much, or has no node in the box.
    """
    if box is not None:
        west, south, east, north = box
        if not (-180 <= west < east <= 180 and -85 <= south < north <= 85):
            raise MapError(f"the box {west:g},{south:g},{east:g},{north:g} is none; give W,S,E,N in degrees")
    extract = Extract(str(path))
    kept: dict[int, tuple[float, float]] = {}
    for kind, item in read_elements(path):
        if kind == "node":
            number, lon, lat, tags = item
            kept[number] = (lon, lat)
            if tags:
                extract.node_tags[number] = tags
            if len(kept) > 10 * NODE_LIMIT:
                break
        elif kind == "way":
            extract.ways[item.id] = item
        elif kind == "deleted":
            extract.deleted.append(item)
        else:
            extract.relations.append(item)
    lanelets = any(relation.tags.get("type") == "lanelet" for relation in extract.relations)
    if lanelets and not any("highway" in way.tags for way in extract.ways.values()):
        raise MapError(f"{path} is {LANELET2}")
    if len(kept) > 10 * NODE_LIMIT:
        part = _text(box or _densest(list(kept.values())))
        raise MapError(
            f"{path} has more than {10 * NODE_LIMIT:,} nodes; "
            f"cut it first: osmium extract -b {part} {path} -o part.osm.pbf"
        )
    everywhere = list(extract.ways.values())
    inside = _cut(extract, kept, box)
    if not extract.degrees:
        raise MapError(_elsewhere(path, kept, box))
    streets = [extract.degrees[node] for way in extract.ways.values() if for_cars(way) for node in way.nodes]
    if box is not None and not streets:
        streets = [kept[node] for way in everywhere if for_cars(way) for node in way.nodes if node in kept]
        hint = f" such as --bbox {_text(_densest(streets))}" if streets else ""
        raise MapError(f"{path} has no street for cars in the box; give one with streets{hint}")
    length_m, span = _streets_m(extract), float(np.ptp(_street_places(extract), axis=0).max())
    if inside > NODE_LIMIT or length_m > MOST_STREETS_M or (streets and span > WIDEST_DEG):
        raise MapError(
            f"{path} has {length_m / 1e3:.0f} km of streets and {inside:,} nodes over {span:.2f}° here; "
            f"{MOST_STREETS_M / 1e3:.0f} km go at once: give a part, such as "
            f"--bbox {_text(_densest(streets or list(extract.degrees.values())))}"
        )
    place(extract)
    return extract


def _cut(extract: Extract, kept: dict[int, tuple[float, float]], box: Box | None) -> int:
    """Keep what lies in the box, and count its nodes: streets end at its border, all else stays whole."""
    # Editors number new elements by -1, -2, …
    fresh = min([0, *kept, *extract.ways]) - 1
    outlines = _outlines(extract, kept, box)
    for way in list(extract.ways.values()):
        known_nodes = [node for node in way.nodes if node in kept]
        if len(known_nodes) < 2:
            extract.broken.append(way.id)
            del extract.ways[way.id]
            continue
        if "highway" not in way.tags or way.tags.get("area") == "yes":
            if way.id in outlines or _meets([kept[node] for node in known_nodes], box):
                extract.ways[way.id] = Way(way.id, tuple(known_nodes), way.tags)
                extract.degrees |= {node: kept[node] for node in known_nodes}
            else:
                del extract.ways[way.id]
            continue
        runs = []
        for run in _runs(way.nodes, kept, box):
            nodes: list[int] = []
            for node in run:
                if isinstance(node, tuple):
                    extract.degrees[fresh] = node
                    node, fresh = fresh, fresh - 1
                nodes.append(node)
            runs.append(tuple(nodes))
        del extract.ways[way.id]
        for k, whole in enumerate(runs):
            key = way.id if k == 0 else fresh
            fresh -= k > 0
            extract.ways[key] = Way(way.id, whole, way.tags)
    inside = {node: place for node, place in kept.items() if _meets([place], box)}
    extract.degrees |= inside
    extract.node_tags = {node: tags for node, tags in extract.node_tags.items() if node in extract.degrees}
    return len(inside)


def _outlines(extract: Extract, kept: dict[int, tuple[float, float]], box: Box | None) -> set[int]:
    """Ways round areas that meet the box, of which single ways may lie outside, and coasts near it."""
    if box is None:
        return set()
    near = (box[0] - COAST_DEG, box[1] - COAST_DEG, box[2] + COAST_DEG, box[3] + COAST_DEG)
    groups = [
        ([ref for kind, ref, _ in relation.members if kind == "w"], box)
        for relation in extract.relations
        if relation.tags.get("type") == "multipolygon"
    ]
    groups += [([w.id], near) for w in extract.ways.values() if w.tags.get("natural") == "coastline"]
    outlines: set[int] = set()
    for ways, where in groups:
        nodes = (node for way in ways if way in extract.ways for node in extract.ways[way].nodes)
        places = [kept[node] for node in nodes if node in kept]
        if places and _meets(places, where):
            outlines.update(ways)
    return outlines


def _runs(nodes: tuple[int, ...], kept: dict[int, tuple[float, float]], box: Box | None) -> list[list[Any]]:
    """Stretches inside the box: node ids, and places where the street crosses the box."""
    runs: list[list[Any]] = [[]]
    for a, b in itertools.pairwise(nodes):
        shares = _shares(kept[a], kept[b], box) if a in kept and b in kept else None
        if shares is None:
            runs.append([])
            continue
        if shares[0] > 0.0 or not runs[-1]:
            runs.append([_between(kept[a], kept[b], shares[0]) if shares[0] > 0.0 else a])
        runs[-1].append(_between(kept[a], kept[b], shares[1]) if shares[1] < 1.0 else b)
    return [run for run in runs if run]


def _shares(
    start: tuple[float, float], end: tuple[float, float], box: Box | None
) -> tuple[float, float] | None:
    """Shares of a line at which it enters and leaves the box (Liang and Barsky); None where it misses it."""
    enter, leave = 0.0, 1.0
    for k, limit, sign in ((0, 0, 1.0), (1, 1, 1.0), (0, 2, -1.0), (1, 3, -1.0)) if box else ():
        assert box is not None
        room, gain = sign * (start[k] - box[limit]), sign * (end[k] - start[k])
        if gain > 0.0:
            enter = max(enter, -room / gain)
        elif gain < 0.0:
            leave = min(leave, room / -gain)
        elif room < 0.0:
            return None
    return (enter, leave) if enter < leave else None


def _between(start: tuple[float, float], end: tuple[float, float], share: float) -> tuple[float, float]:
    return (
        round(start[0] + share * (end[0] - start[0]), 8),
        round(start[1] + share * (end[1] - start[1]), 8),
    )


def _meets(places: list[tuple[float, float]], box: Box | None) -> bool:
    """Whether the rectangle round some places meets the box."""
    if box is None:
        return True
    xs, ys = [p[0] for p in places], [p[1] for p in places]
    return min(xs) <= box[2] and max(xs) >= box[0] and min(ys) <= box[3] and max(ys) >= box[1]


def _street_places(extract: Extract) -> Array:
    """Longitudes and latitudes (N, 2) of the streets' nodes, or of all where there are none."""
    nodes = {node for way in extract.ways.values() if "highway" in way.tags for node in way.nodes}
    return np.array([extract.degrees[node] for node in sorted(nodes) or sorted(extract.degrees)])


def _streets_m(extract: Extract) -> float:
    """About the length of all streets for cars [m]."""
    total = 0.0
    for way in extract.ways.values():
        if for_cars(way):
            step = np.diff([extract.degrees[node] for node in way.nodes], axis=0) * DEGREE_M
            step[:, 0] *= np.cos(np.radians(extract.degrees[way.nodes[0]][1]))
            total += float(np.hypot(*step.T).sum())
    return total


def _densest(points: list[tuple[float, float]]) -> Box:
    """The box of `PROPOSED_M` that holds most points [deg], about."""
    places = np.array(points)
    half = PROPOSED_M / DEGREE_M / 2.0 / np.array([np.cos(np.radians(np.median(places[:, 1]))), 1.0])
    cells, counts = np.unique(np.floor(places / half).astype(np.int64), axis=0, return_counts=True)
    held = {(int(x), int(y)): int(count) for (x, y), count in zip(cells, counts, strict=True)}
    low = max(held, key=lambda c: sum(held.get((c[0] + dx, c[1] + dy), 0) for dx in (0, 1) for dy in (0, 1)))
    return (low[0] * half[0], low[1] * half[1], (low[0] + 2) * half[0], (low[1] + 2) * half[1])


def _text(box: Box) -> str:
    return ",".join(f"{value:.4f}" for value in box)


def _elsewhere(path: Path, kept: dict[int, tuple[float, float]], box: Box | None) -> str:
    if not kept:
        return f"{path} holds no nodes; give an extract of OpenStreetMap"
    low, high = np.array(list(kept.values())).min(axis=0), np.array(list(kept.values())).max(axis=0)
    return f"{path} has nothing in the box; it covers --bbox {_text((*low, *high))}"


def place(extract: Extract, height_m: float = 0.0) -> None:
    """Place the nodes of an extract on the plane that touches the Earth, at a height above the ellipsoid."""
    numbers = list(extract.degrees)
    places = np.array([extract.degrees[number] for number in numbers])
    streets = _street_places(extract)
    middle = np.round((streets.min(axis=0) + streets.max(axis=0)) / 2, 6)
    extract.geo = GeoReference(
        latitude_deg=float(middle[1]), longitude_deg=float(middle[0]), height_m=height_m
    )
    # On the ellipsoid, seen along its normal at the origin: within a millimetre of a flat map for some km.
    geodetic = np.column_stack([places[:, 1], places[:, 0], np.full(len(places), height_m)])
    world = np.round(extract.geo.geodetic_to_enu(geodetic)[:, :2], 4)
    extract.xy_m = {number: (float(x), float(y)) for number, (x, y) in zip(numbers, world, strict=True)}
