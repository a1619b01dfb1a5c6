"""Reads the things beside the streets of an extract, with what their tags say."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import shapely

from carlaloc_env.openstreetmap.elements import Tags
from carlaloc_env.openstreetmap.extract import Extract
from carlaloc_env.openstreetmap.features import Feature, Features
from carlaloc_env.openstreetmap.houses import building_properties, guess_heights, lower_outlines
from carlaloc_env.openstreetmap.shores import open_water, sea
from carlaloc_env.openstreetmap.tags import layer, number

LEAST_M2 = 4.0
"""Smaller houses are left out [m²]."""
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


def read_features(extract: Extract) -> Features:
    """All things beside the streets of an extract."""
    features, left_out = [], {}
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
                properties = building_properties(tags) if kind in ("building", "part") else _plain(kind, tags)
                features.append(Feature(kind, name, part, properties))
    for number_, tags in extract.node_tags.items():
        if tags.get("natural") == "tree":
            features.append(
                Feature("tree", f"node/{number_}", shapely.Point(extract.xy_m[number_]), _tree(tags))
            )
    guess_heights([f for f in features if f.kind == "building"])
    lower_outlines(features)
    return Features(features, left_out)


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
        if len(tags) <= 1:
            continue
        name, outer = f"relation/{relation.id}", _filled(rings[False])
        if _matches(tags, AREAS["water"]) and not _closed(rings[False]):
            yield name, open_water(extract, rings[False] + rings[True]), tags
        elif not outer.is_empty:
            yield name, shapely.difference(outer, _filled(rings[True])), tags
    for number_, part in enumerate(shapely.get_parts(sea(extract)), 1):
        yield f"sea/{number_}", part, {"natural": "water"}
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


def _closed(lines: Sequence[Any]) -> bool:
    """Whether lines end nowhere."""
    merged = shapely.get_parts(shapely.line_merge(shapely.union_all(lines)))
    return len(lines) > 0 and bool(shapely.is_ring(merged).all())


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
    properties: dict[str, Any] = {"leaves": "needles" if tags.get("leaf_type") == "needleleaved" else "broad"}
    if height is not None and 1.0 <= height <= 40.0:
        properties["height_m"] = height
    return properties
