"""Things beside the streets: houses, water, greens, trees, rails and fences, with what their tags say."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.openstreetmap.extract import Extract, Tags
from carlaloc_env.openstreetmap.tags import layer, number

STOREY_M, ROOF_STOREY_M = 3.1, 2.5
"""Height of a storey and of one below the roof where no tag says it [m]."""
HIGHEST_M, MOST_LEVELS = 450.0, 120
"""Tags that say more than this are ignored."""
NEIGHBOURS_M = 60.0
"""Houses without tags are as high as the tagged ones so near [m]."""
LEAST_M2 = 4.0
"""Smaller houses are left out [m²]."""
SHED_M2 = 60.0
"""Smaller houses have one storey where nothing is tagged [m²]."""
MOST_BUILDINGS = 25_000
"""Extracts with more houses are refused."""

AREAS: dict[str, dict[str, tuple[str, ...]]] = {
    "water": {"natural": ("water",), "waterway": ("riverbank", "dock"), "landuse": ("basin", "reservoir")},
    "green": {
        "leisure": ("park", "garden", "golf_course", "common", "dog_park", "playground", "pitch"),
        "landuse": ("grass", "cemetery", "recreation_ground", "village_green", "allotments", "flowerbed"),
        "natural": ("grassland", "heath", "scrub"),
    },
    "wood": {"landuse": ("forest", "orchard", "vineyard"), "natural": ("wood",)},
    "field": {"landuse": ("farmland", "meadow", "farmyard", "greenfield", "plant_nursery")},
    "square": {"highway": ("pedestrian",), "place": ("square",), "amenity": ("marketplace",)},
    "car_park": {"amenity": ("parking",)},
    "residential": {"landuse": ("residential",)},
    "downtown": {"landuse": ("retail", "commercial")},
    "industrial": {"landuse": ("industrial", "railway", "port", "depot", "garages", "quarry")},
}
"""Kinds of areas by their tags."""
LINES: dict[str, dict[str, tuple[str, ...]]] = {
    "rail": {"railway": ("rail", "light_rail", "narrow_gauge")},
    "tram": {"railway": ("tram",)},
    "tree_row": {"natural": ("tree_row",)},
    "hedge": {"barrier": ("hedge",)},
    "fence": {"barrier": ("fence", "guard_rail")},
    "wall": {"barrier": ("wall", "retaining_wall", "city_wall")},
}
"""Kinds of lines by their tags."""


@dataclass(slots=True)
class Feature:
    """One thing: its kind, its shape in the world [m], and what is known of it."""

    kind: str
    id: str
    """`way/1`, `relation/2` or `node/3`."""
    shape: Any
    properties: dict[str, Any] = field(default_factory=dict)


@dataclass(slots=True)
class Features:
    """All things of an extract, and what was left out."""

    all: list[Feature]
    left_out: dict[str, str]
    """Ids and reasons."""

    def of(self, *kinds: str) -> list[Feature]:
        """Things of some kinds."""
        return [feature for feature in self.all if feature.kind in kinds]


def read_features(extract: Extract) -> Features:
    """All things beside the streets of an extract."""
    found, left_out = [], {}
    for name, shape, tags in _shapes(extract):
        kind = _kind(shape, tags)
        if kind is None:
            continue
        if kind in ("building", "part"):
            reason = _refused(tags)
            if reason:
                left_out[name] = reason
                continue
        if shape.geom_type == "Polygon" and not shape.is_valid:
            shape = shapely.make_valid(shape)
        for part in shapely.get_parts(shape):
            if part.geom_type in ("Point", "LineString") or part.area >= LEAST_M2:
                properties = _building(tags) if kind in ("building", "part") else _plain(kind, tags)
                found.append(Feature(kind, name, part, properties))
    for number_, tags in extract.node_tags.items():
        if tags.get("natural") == "tree":
            found.append(
                Feature("tree", f"node/{number_}", shapely.Point(extract.xy_m[number_]), _tree(tags))
            )
    _guess_heights([f for f in found if f.kind == "building"])
    _lower_outlines(found)
    return Features(found, left_out)


def _shapes(extract: Extract) -> Iterator[tuple[str, Any, Tags]]:
    """Name, shape and tags of closed ways, lines and multipolygons."""
    used: set[int] = set()
    for relation in extract.relations:
        if relation.tags.get("type") != "multipolygon":
            continue
        rings: dict[bool, list[Any]] = {True: [], False: []}
        tags: dict[str, str] = dict(relation.tags)
        for kind, ref, role in relation.members:
            way = extract.ways.get(ref) if kind == "w" else None
            if way is None or len(way.nodes) < 2:
                continue
            rings[role == "inner"].append(shapely.LineString(extract.line(way.nodes)))
            if role != "inner":
                # Old relations carry no tags of their own.
                if len(tags) <= 1:
                    tags |= way.tags
                used.add(ref)
        outer = _filled(rings[False])
        if not outer.is_empty and len(tags) > 1:
            yield f"relation/{relation.id}", shapely.difference(outer, _filled(rings[True])), tags
    for key, way in extract.ways.items():
        if len(way.tags) == 0:
            continue
        line = extract.line(way.nodes)
        closed = way.nodes[0] == way.nodes[-1] and len(way.nodes) > 3
        if closed and not _line_kind(way.tags):
            if key not in used or "building" in way.tags:
                yield f"way/{way.id}", shapely.Polygon(line), way.tags
        else:
            yield f"way/{way.id}", shapely.LineString(line), way.tags


def _filled(lines: Sequence[Any]) -> Any:
    """Area that lines surround."""
    whole = shapely.union_all(lines)
    return shapely.union_all(shapely.get_parts(shapely.polygonize([whole]))) if lines else shapely.Polygon()


def _matches(tags: Tags, rules: Mapping[str, tuple[str, ...]]) -> bool:
    return any(tags.get(key) in values for key, values in rules.items())


def _line_kind(tags: Tags) -> str | None:
    if tags.get("tunnel", "no") != "no":
        return None
    return next((kind for kind, rules in LINES.items() if _matches(tags, rules)), None)


def _kind(shape: Any, tags: Tags) -> str | None:
    if shape.geom_type == "LineString":
        return _line_kind(tags)
    if tags.get("building:part", "no") != "no":
        return "part"
    if tags.get("building", "no") != "no":
        return "building"
    if "highway" in tags and tags.get("area") != "yes":
        return None
    kind = next((kind for kind, rules in AREAS.items() if _matches(tags, rules)), None)
    if kind == "car_park" and tags.get("parking", "surface") not in ("surface", "lane", "street_side"):
        return None
    return kind


def _refused(tags: Tags) -> str:
    if tags.get("location") == "underground" or (tags.get("layer") or "0").startswith("-"):
        return "below the ground"
    if tags.get("building") in ("roof", "carport", "ruins", "construction", "bridge"):
        return f"a {tags['building']}, which has no walls"
    return ""


def _plain(kind: str, tags: Tags) -> dict[str, Any]:
    name = {"name": tags["name"]} if "name" in tags else {}
    if kind in ("fence", "wall", "hedge"):
        height = number(tags.get("height"))
        usual = {"fence": 1.2, "wall": 1.8, "hedge": 1.4}[kind]
        return {**name, "height_m": height if height is not None and 0.2 <= height <= 8.0 else usual}
    if kind in ("rail", "tram"):
        return {**name, "layer": layer(tags) or int(tags.get("bridge", "no") != "no")}
    return name


def _tree(tags: Tags) -> dict[str, Any]:
    height = number(tags.get("height"))
    found: dict[str, Any] = {"leaves": "needles" if tags.get("leaf_type") == "needleleaved" else "broad"}
    if height is not None and 1.0 <= height <= 40.0:
        found["height_m"] = height
    return found


_COLOUR = re.compile(r"#?([0-9a-fA-F]{6})")
_NAMED = {
    "white": "f4f4f0", "grey": "9a9a98", "gray": "9a9a98", "lightgrey": "c4c4c0", "darkgrey": "60605e",
    "black": "303030", "red": "a83a2e", "brown": "7a5438", "yellow": "e2c56a", "beige": "ddd0b0",
    "orange": "cf7f42", "green": "6f8f62", "blue": "6f8fb4", "pink": "dca6a0", "maroon": "6e2a24",
    "tan": "c8ac80", "silver": "c0c0c0",
}  # fmt: skip


def colour(text: str | None) -> str | None:
    """A colour as six hexadecimal digits; None where a tag has none."""
    found = _COLOUR.fullmatch((text or "").strip())
    return found[1].lower() if found else _NAMED.get((text or "").strip().lower().replace("_", ""))


def _building(tags: Tags) -> dict[str, Any]:
    """Measures and look of a house as tagged; the rest is guessed afterwards."""
    levels, height = number(tags.get("building:levels")), number(tags.get("height"))
    roof_levels = number(tags.get("roof:levels")) or 0.0
    found: dict[str, Any] = {"use": tags.get("building", tags.get("building:part", "yes"))}
    if levels is not None and 1 <= levels <= MOST_LEVELS:
        found["levels"] = int(levels)
    if height is not None and 2.0 <= height <= HIGHEST_M:
        found["height_m"] = round(height, 2)
    elif "levels" in found:
        found["height_m"] = round(found["levels"] * STOREY_M + 0.6 + roof_levels * ROOF_STOREY_M, 2)
    low = number(tags.get("min_height"))
    low = low if low is not None else (number(tags.get("building:min_level")) or 0.0) * STOREY_M
    if 0.0 < low < found.get("height_m", HIGHEST_M):
        found["min_height_m"] = round(low, 2)
    rise = number(tags.get("roof:height"))
    if rise is not None and 0.0 < rise <= 30.0:
        found["roof_m"] = rise
    look = {
        "roof": tags.get("roof:shape"), "material": tags.get("building:material"),
        "roof_material": tags.get("roof:material"), "colour": colour(tags.get("building:colour")),
        "roof_colour": colour(tags.get("roof:colour")),
    }  # fmt: skip
    found |= {key: value for key, value in look.items() if value}
    if found.get("roof") == "skillion":
        angle, towards = number(tags.get("roof:angle")), tags.get("roof:direction", "").strip().upper()
        bearing = 22.5 * COMPASS.index(towards) if towards in COMPASS else number(towards or None)
        if bearing is not None and -360.0 <= bearing <= 360.0:
            found["roof_direction_deg"] = bearing
        if angle is not None and 1.0 <= angle <= 60.0:
            found["roof_angle_deg"] = angle
    if "shop" in tags or tags.get("building") in ("retail", "shop", "supermarket"):
        found["shop"] = True
    return found


COMPASS = (
    "N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW",
)  # fmt: skip
"""Bearings of `roof:direction`, from north clockwise."""
_USUAL_LEVELS = {
    "apartments": 4, "house": 2, "detached": 2, "semidetached_house": 2, "terrace": 2, "residential": 3,
    "garage": 1, "garages": 1, "shed": 1, "hut": 1, "cabin": 1, "farm_auxiliary": 1, "barn": 1,
    "greenhouse": 1,
    "church": 4, "cathedral": 6, "chapel": 2, "industrial": 2, "warehouse": 2, "retail": 2, "commercial": 3,
    "office": 5, "hotel": 5, "school": 3, "university": 4, "hospital": 5, "public": 3, "civic": 3,
    "kiosk": 1, "service": 1, "bungalow": 1,
}  # fmt: skip


def _guess_heights(buildings: Sequence[Feature]) -> None:
    """Storeys of houses without tags: of the tagged ones near them, else of their use and size."""
    places = np.array([shapely.get_coordinates(shapely.centroid(b.shape))[0] for b in buildings]).reshape(
        -1, 2
    )
    tagged = [k for k, b in enumerate(buildings) if "height_m" in b.properties]
    tree = cKDTree(places[tagged]) if tagged else None
    known = np.array([buildings[k].properties["height_m"] for k in tagged])
    for place, building in zip(places, buildings, strict=True):
        own = building.properties
        if "height_m" not in own:
            near = tree.query_ball_point(place, NEIGHBOURS_M) if tree is not None else []
            usual = _USUAL_LEVELS.get(own["use"])
            if building.shape.area < SHED_M2:
                levels = 1
            elif usual is not None:
                levels = usual
            elif near:
                levels = max(1, round(float(np.median(known[near])) / STOREY_M))
            else:
                levels = 2 if building.shape.area < 250.0 else 3
            own |= {"levels": levels, "height_m": round(levels * STOREY_M + 0.6, 2), "guessed": True}
        if "levels" not in own:
            own["levels"] = max(1, round((own["height_m"] - own.get("min_height_m", 0.0)) / (STOREY_M + 0.3)))


def _lower_outlines(found: Sequence[Feature]) -> None:
    """Houses that have parts of their own reach as high as the lowest of these; parts stand on the ground."""
    houses = [f for f in found if f.kind == "building"]
    parts = [f for f in found if f.kind == "part"]
    for part in parts:
        own = part.properties
        own.setdefault("height_m", own.get("levels", 1) * STOREY_M + 0.6)
        own.setdefault("levels", max(1, round(own["height_m"] / STOREY_M)))
    if not houses or not parts:
        return
    tree = shapely.STRtree([part.shape.representative_point() for part in parts])
    for house in houses:
        rows = tree.query(house.shape, predicate="contains")
        inside = [parts[k] for k in rows]
        if not inside:
            continue
        covered = sum(part.shape.area for part in inside if "min_height_m" not in part.properties)
        lowest = min(part.properties["height_m"] for part in inside)
        if covered > 0.6 * house.shape.area and lowest < house.properties["height_m"]:
            house.properties["height_m"] = lowest
            house.properties["levels"] = max(1, round(lowest / STOREY_M))


def geojson(features: Iterable[Feature], extract: Extract) -> str:
    """Text of a GeoJSON file in longitudes and latitudes, one feature a line."""
    lines = []
    for feature in features:
        xy = shapely.get_coordinates(feature.shape)
        geodetic = extract.geo.enu_to_geodetic(np.column_stack([xy, np.zeros(len(xy))]))
        shape = shapely.set_coordinates(feature.shape, np.round(geodetic[:, 1::-1], 8))
        geometry = json.loads(shapely.to_geojson(shape))
        properties = {"id": feature.id, "kind": feature.kind, **feature.properties}
        lines.append(json.dumps({"type": "Feature", "properties": properties, "geometry": geometry}))
    return '{"type": "FeatureCollection", "features": [\n' + ",\n".join(lines) + "\n]}\n"
