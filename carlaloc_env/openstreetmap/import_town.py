"""An extract of OpenStreetMap as the folder of a town: roads, settings, features, licence and report."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.authoring.elements.mirroring import mirror
from carlaloc_env.authoring.opendrive_writer import opendrive_text
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.map.routing.plan_route import FitTurns
from carlaloc_env.openstreetmap.clusters import End, half_width
from carlaloc_env.openstreetmap.countries import Country, country_of
from carlaloc_env.openstreetmap.driving_side import drives_left
from carlaloc_env.openstreetmap.elements import Way
from carlaloc_env.openstreetmap.extract import Box, Extract, place, read_extract
from carlaloc_env.openstreetmap.features import Feature, Features, geojson
from carlaloc_env.openstreetmap.furniture import furnish
from carlaloc_env.openstreetmap.heights import find_heights
from carlaloc_env.openstreetmap.houses import MOST_BUILDINGS
from carlaloc_env.openstreetmap.land import Land, read_land
from carlaloc_env.openstreetmap.read_features import read_features
from carlaloc_env.openstreetmap.road_graph import Chain, RoadGraph, build_graph
from carlaloc_env.openstreetmap.road_network import RoadNetwork
from carlaloc_env.openstreetmap.settings import settings_text
from carlaloc_env.openstreetmap.settling import settle
from carlaloc_env.openstreetmap.shores import FAR_M
from carlaloc_env.openstreetmap.tags import LANE_M, Street, read_street
from carlaloc_env.openstreetmap.turning_places import FIRST_ID

FILES = ("town.xodr", "town.toml", "features.geojson", "LICENCE", "report.json", "preview.png")
"""Files of the folder."""
LICENCE = """The data of this town are from OpenStreetMap.

© OpenStreetMap contributors, Open Database License 1.0
https://www.openstreetmap.org/copyright
https://opendatacommons.org/licenses/odbl/1-0/

Pictures and data sets made of it name the source: "© OpenStreetMap contributors".
Files that hold the data themselves, such as this folder, stay under the same licence.
"""
OFF_LAND_M = 1.0
"""Streets that leave the land by more are reported [m]."""
HOUSES_M = 45.0
"""Streets with a house every so many metres are in town [m]."""


@dataclass(slots=True)
class ImportedTown:
    """Texts of a town's files, and the report on what became of the extract."""

    xodr: str
    toml: str
    features: str
    report: dict[str, Any] = field(default_factory=dict)


def import_town(
    source: Path,
    *,
    box: Box | None = None,
    name: str = "",
    heights: Path | None = None,
    fit_turns: FitTurns | None = None,
    announce: Callable[[float], object] = lambda _: None,
    progress: Callable[[str], object] = lambda _: None,
) -> ImportedTown:
    """Make a town of an extract.

    Args:
        source: An .osm, .osm.gz, .osm.bz2 or .osm.pbf file.
        box: West, south, east, north [deg]; None: the whole file.
        name: Name of the town; empty: that of the file.
        heights: Raster of the land's heights; None: a flat town.
        fit_turns: Fits tight turns of the default route to a car; None: it keeps to the lanes' middle.
        announce: Called with the length of the streets [m] before they are built.
        progress: Called with the name of each step that has ended.

    Raises:
        MapError: A file cannot be read, holds no streets on which one could drive, or heights of elsewhere.
        MissingDependencyError: Heights need rasterio.
    """
    extract, land, features = _read(source, box, heights)
    buildings = features.of("building")
    country = country_of(extract.geo.longitude_deg, extract.geo.latitude_deg)
    left, evidence = drives_left(extract, country)
    side = f"{'left' if left else 'right'} (by {evidence})"
    solid = [feature.shape for feature in buildings]
    if left:
        # Built for the right in a mirrored world.
        extract.xy_m = {node: (x, -y) for node, (x, y) in extract.xy_m.items()}
        solid = [shapely.transform(shape, lambda xy: xy * (1.0, -1.0)) for shape in solid]
    graph = build_graph(extract, _Streets(extract, country, solid, left=left))
    announce(graph.asked_m)
    progress(f"{source.name} read")
    rails = [
        (shapely.get_coordinates(f.shape) * ((1.0, -1.0) if left else 1.0), int(f.properties["layer"]))
        for f in features.of("rail")
    ]
    _narrow(graph.chains, solid)

    def height_of(xy: Array) -> Array:
        assert land is not None
        return land.height(xy * (1.0, -1.0) if left else xy)

    network, chains, dropped = settle(
        graph.chains,
        partial(find_heights, rails=rails, land=None if land is None else height_of),
        restrictions(extract),
        shapely.STRtree(solid),
        yellow=country.code in ("US", "CA"),
    )
    progress("streets built")
    furnish(network, chains, extract.node_tags, country.town_kmh)
    if left:
        mirror(network.roads, network.parts)
        extract.xy_m = {node: (x, -y) for node, (x, y) in extract.xy_m.items()}
    geo = extract.geo
    projection = (
        f"+proj=tmerc +lat_0={geo.latitude_deg} +lon_0={geo.longitude_deg} +k=1 +x_0=0 +y_0=0 "
        "+datum=WGS84 +units=m +no_defs"
    )
    title = name or source.name.split(".")[0]
    xodr = opendrive_text(
        title, projection, network.roads, network.parts, network.controllers, rule="LHT" if left else "RHT"
    )
    kept = _beside(features, network, land)
    toml = settings_text(title, extract, Features(kept, {}), network, xodr, fit_turns)
    progress("route chosen")
    return ImportedTown(
        xodr=xodr,
        toml=toml,
        features=geojson(kept, extract),
        report=_report(source, extract, graph, chains, dropped, features, network, country, side, land),
    )


def _read(source: Path, box: Box | None, heights: Path | None) -> tuple[Extract, Land | None, Features]:
    """An extract in its place, the land beneath where heights are given, and what stands on it."""
    extract = read_extract(source, box)
    land = None
    if heights is not None:
        land = read_land(heights, extract)
        place(extract, land.origin_m)
    features = read_features(extract)
    count = len(features.of("building"))
    if count > MOST_BUILDINGS:
        raise MapError(
            f"{source} has {count:,} houses; {MOST_BUILDINGS:,} go at once: cut it by --bbox W,S,E,N"
        )
    return extract, land, features


class _Streets:
    """Streets of ways, each read once."""

    def __init__(self, extract: Extract, country: Country, solid: Sequence[Any], *, left: bool) -> None:
        self._extract, self._country, self._left = extract, country, left
        self._known: dict[tuple[int, tuple[int, ...]], Street] = {}
        centres = [shapely.get_coordinates(shapely.centroid(shape))[0] for shape in solid]
        self._houses = cKDTree(np.array(centres)) if centres else None

    def __call__(self, way: Way) -> Street:
        """The street that a way's tags describe."""
        key = (way.id, way.nodes)
        if key not in self._known:
            line = shapely.LineString(self._extract.line(way.nodes))
            steps = np.arange(0.0, line.length + 1.0, 20.0)
            points = shapely.get_coordinates(shapely.line_interpolate_point(line, steps))
            near: set[int] = set()
            if self._houses is not None:
                near = set().union(*self._houses.query_ball_point(points, HOUSES_M))
            in_town = len(near) * HOUSES_M >= max(line.length, HOUSES_M)
            self._known[key] = read_street(way, self._country, in_town, left=self._left)
        return self._known[key]


def _narrow(chains: Sequence[Chain], solid: Sequence[Any]) -> None:
    """Lanes and sidewalks as wide as the houses beside a street leave room for."""
    tree = shapely.STRtree(solid)
    for chain in chains:
        line = shapely.LineString(chain.line)
        steps = np.arange(2.0, max(line.length - 2.0, 2.5), 2.0)
        points = shapely.line_interpolate_point(line, steps)
        ahead = shapely.get_coordinates(
            shapely.line_interpolate_point(line, np.minimum(steps + 0.5, line.length))
        )
        xy = shapely.get_coordinates(points)
        along = ahead - xy
        along /= np.maximum(np.hypot(*along.T), 1e-9)[:, None]
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        free = []
        for sign in (1.0, -1.0):
            rays = shapely.linestrings(np.stack([xy, xy + sign * 12.0 * normal], axis=1))
            room = np.full(len(steps), 12.0)
            hits, houses = tree.query(rays, predicate="intersects")
            cuts = shapely.intersection(rays[hits], tree.geometries[houses])
            np.minimum.at(room, hits, shapely.distance(points[hits], cuts))
            free.append(room)
        # A street under a house is a passage: it keeps its width, and the house gets a gate.
        open_ = (free[0] > 1.2) & (free[1] > 1.2)
        for piece in chain.pieces:
            street = piece.street
            if not open_.any():
                continue
            half = min(float(free[0][open_].min()), float(free[1][open_].min())) - 0.25
            lane = min(street.lane_m, max(LANE_M[0], 2.0 * (half - 0.3) / sum(street.lanes)))
            taken = half_width(replace(street, lane_m=lane))
            walks = []
            for side, room in zip(street.walks, free, strict=True):
                width = min(side, float(np.percentile(room[open_], 10)) - taken - 0.1)
                walks.append(width if width >= 0.9 else 0.0)
            piece.street = replace(street, lane_m=lane, walks=(walks[0], walks[1]))


def restrictions(extract: Extract) -> dict[tuple[int, int], frozenset[int]]:
    """Ways into which one may not turn, by the way one comes from and the node between."""
    banned: dict[tuple[int, int], set[int]] = defaultdict(set)
    at: dict[int, set[int]] = defaultdict(set)
    for way in extract.ways.values():
        if "highway" in way.tags:
            for node in (way.nodes[0], way.nodes[-1]):
                at[node].add(way.id)
    for relation in extract.relations:
        kind = relation.tags.get("restriction", "")
        roles = {role: (sort, ref) for sort, ref, role in relation.members}
        via = roles.get("via", ("", 0))
        if not kind or via[0] != "n" or "from" not in roles or "to" not in roles:
            continue
        source, target = roles["from"][1], roles["to"][1]
        if kind.startswith("no_"):
            banned[source, via[1]].add(target)
        elif kind.startswith("only_"):
            banned[source, via[1]] |= at[via[1]] - {target, source}
    return {key: frozenset(ways) for key, ways in banned.items()}


def _beside(features: Features, network: RoadNetwork, land: Land | None) -> list[Feature]:
    """Things in reach of the roads, areas cut to it, and the land."""
    points = [road.path.at(road.length * k / 4) for road in network.roads for k in range(5)]
    reach = shapely.buffer(
        shapely.MultiPoint([(p.x, p.y) for p in points]).envelope, 120.0, join_style="mitre"
    )
    far = shapely.buffer(reach, FAR_M, join_style="mitre")
    shapely.prepare(reach)
    kept = [] if land is None else [land.feature(reach)]
    for feature in features.all:
        if feature.kind in ("building", "part", "tree"):
            if shapely.contains(reach, shapely.centroid(feature.shape)):
                kept.append(feature)
        elif shapely.intersects(reach, feature.shape):
            cut = far if feature.kind == "water" else reach
            for part in shapely.get_parts(shapely.intersection(feature.shape, cut)):
                if part.geom_type == feature.shape.geom_type:
                    kept.append(Feature(feature.kind, feature.id, part, feature.properties))
    return kept


def _report(
    source: Path,
    extract: Extract,
    graph: RoadGraph,
    chains: Sequence[Chain],
    dropped: Sequence[Chain],
    features: Features,
    network: RoadNetwork,
    country: Country,
    drives_on: str,
    land: Land | None,
) -> dict[str, Any]:
    own = [c for c in chains if c.pieces[0].way > FIRST_ID or c.pieces[-1].way > FIRST_ID]
    lost = sum(c.length_m for c in dropped if c.pieces[0].way > FIRST_ID)
    pieces = [piece for chain in own for piece in chain.pieces if piece.way > FIRST_ID]
    guessed = Counter(tag for piece in pieces for tag in piece.street.guesses)
    left_out = {f"way/{way}": why for way, why in graph.left_out.items() if way > FIRST_ID}
    left_out |= {
        f"way/{p.way}": "its junctions are too tight" for c in dropped for p in c.pieces if p.way > FIRST_ID
    }
    left_out |= {f"way/{way}": "fewer than two of its nodes are in the file" for way in extract.broken}
    left_out |= dict.fromkeys(extract.deleted, "deleted in an editor")
    left_out |= features.left_out
    kinds = Counter(feature.kind for feature in features.all)
    buildings = features.of("building")
    return {
        "source": source.name,
        "attribution": "© OpenStreetMap contributors, ODbL 1.0",
        "country": country.code,
        "drives_on": drives_on,
        "streets_m": round(graph.asked_m),
        "built_m": round(graph.kept_m - lost),
        "turning_places_m": round(graph.turning_m),
        "junctions": len(network.junctions),
        "buildings": len(buildings),
        "features": dict(sorted(kinds.items())),
        **({} if land is None else {"heights": land.report}),
        "guessed": {
            **{f"{tag} of streets": count for tag, count in sorted(guessed.items())},
            "heights of buildings": sum(bool(b.properties.get("guessed")) for b in buildings),
        },
        "changed": [
            f"{'tight' if t.built else 'no'} turn from way/{_way(chains, t.source)} into "
            f"way/{_way(chains, t.target)}: its radius would be {t.radius_m:.1f} m"
            for t in network.tight
        ]
        + [
            f"way/{chains[c.upper].pieces[0].way if c.upper is not None else 'rail'}: "
            f"{gap:.1f} m short of the clearance over what it crosses"
            for c, gap in network.heights.missed
        ]
        + [
            f"way/{chains[k].pieces[0].way}: {gap:.1f} m off the land, by its grade or its bridge"
            for k, gap in network.heights.off_m.items()
            if gap > OFF_LAND_M and chains[k].pieces[0].way > FIRST_ID
        ],
        "left_out": left_out,
    }


def _way(chains: Sequence[Chain], end: End) -> int:
    return chains[end.chain].pieces[0 if end.side == 0 else -1].way


def write_town(town: ImportedTown, folder: Path) -> None:
    """Write the files of a town; `preview.png` is drawn of the folder afterwards."""
    folder.mkdir(parents=True, exist_ok=True)
    report = json.dumps(town.report, indent=1, ensure_ascii=False) + "\n"
    texts = (town.xodr, town.toml, town.features, LICENCE, report)
    for file, text in zip(FILES, texts, strict=False):
        (folder / file).write_text(text, encoding="utf-8", newline="\n")
