"""Houses: their measures and looks by tags, and the heights of those without tags."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from scipy.spatial import cKDTree

from carlaloc_env.openstreetmap.elements import Tags
from carlaloc_env.openstreetmap.features import Feature
from carlaloc_env.openstreetmap.tags import number

STOREY_M, ROOF_STOREY_M = 3.1, 2.5
"""Height of a storey and of one below the roof where no tag says it [m]."""
HIGHEST_M, MOST_LEVELS = 450.0, 120
"""Tags that say more than this are ignored."""
NEIGHBOURS_M = 60.0
"""Houses without tags are as high as the tagged ones so near [m]."""
SHED_M2 = 60.0
"""Smaller houses have one storey where nothing is tagged [m²]."""
MOST_BUILDINGS = 25_000
"""Extracts with more houses are refused."""
_COLOUR = re.compile(r"#?([0-9a-fA-F]{6})")
_NAMED = {
    "white": "f4f4f0", "grey": "9a9a98", "gray": "9a9a98", "lightgrey": "c4c4c0", "darkgrey": "60605e",
    "black": "303030", "red": "a83a2e", "brown": "7a5438", "yellow": "e2c56a", "beige": "ddd0b0",
    "orange": "cf7f42", "green": "6f8f62", "blue": "6f8fb4", "pink": "dca6a0", "maroon": "6e2a24",
    "tan": "c8ac80", "silver": "c0c0c0",
}  # fmt: skip
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


def colour(text: str | None) -> str | None:
    """A colour as six hexadecimal digits; None where a tag has none."""
    digits = _COLOUR.fullmatch((text or "").strip())
    return digits[1].lower() if digits else _NAMED.get((text or "").strip().lower().replace("_", ""))


def building_properties(tags: Tags) -> dict[str, Any]:
    """Measures and look of a house as tagged; the rest is guessed afterwards."""
    levels, height = number(tags.get("building:levels")), number(tags.get("height"))
    roof_levels = number(tags.get("roof:levels")) or 0.0
    properties: dict[str, Any] = {"use": tags.get("building", tags.get("building:part", "yes"))}
    if levels is not None and 1 <= levels <= MOST_LEVELS:
        properties["levels"] = int(levels)
    if height is not None and 2.0 <= height <= HIGHEST_M:
        properties["height_m"] = round(height, 2)
    elif "levels" in properties:
        properties["height_m"] = round(properties["levels"] * STOREY_M + 0.6 + roof_levels * ROOF_STOREY_M, 2)
    low = number(tags.get("min_height"))
    low = low if low is not None else (number(tags.get("building:min_level")) or 0.0) * STOREY_M
    if 0.0 < low < properties.get("height_m", HIGHEST_M):
        properties["min_height_m"] = round(low, 2)
    rise = number(tags.get("roof:height"))
    if rise is not None and 0.0 < rise <= 30.0:
        properties["roof_m"] = rise
    look = {
        "roof": tags.get("roof:shape"), "material": tags.get("building:material"),
        "roof_material": tags.get("roof:material"), "colour": colour(tags.get("building:colour")),
        "roof_colour": colour(tags.get("roof:colour")),
    }  # fmt: skip
    properties |= {key: value for key, value in look.items() if value}
    if properties.get("roof") == "skillion":
        angle, towards = number(tags.get("roof:angle")), tags.get("roof:direction", "").strip().upper()
        bearing = 22.5 * COMPASS.index(towards) if towards in COMPASS else number(towards or None)
        if bearing is not None and -360.0 <= bearing <= 360.0:
            properties["roof_direction_deg"] = bearing
        if angle is not None and 1.0 <= angle <= 60.0:
            properties["roof_angle_deg"] = angle
    if "shop" in tags or tags.get("building") in ("retail", "shop", "supermarket"):
        properties["shop"] = True
    return properties


def guess_heights(buildings: Sequence[Feature]) -> None:
    """Storeys of houses without tags: of the tagged ones near them, else of their use and size."""
    places = np.array([shapely.get_coordinates(shapely.centroid(b.shape))[0] for b in buildings]).reshape(
        -1, 2
    )
    tagged = [k for k, b in enumerate(buildings) if "height_m" in b.properties]
    tree = cKDTree(places[tagged]) if tagged else None
    heights_m = np.array([buildings[k].properties["height_m"] for k in tagged])
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
                levels = max(1, round(float(np.median(heights_m[near])) / STOREY_M))
            else:
                levels = 2 if building.shape.area < 250.0 else 3
            own |= {"levels": levels, "height_m": round(levels * STOREY_M + 0.6, 2), "guessed": True}
        if "levels" not in own:
            own["levels"] = max(1, round((own["height_m"] - own.get("min_height_m", 0.0)) / (STOREY_M + 0.3)))


def lower_outlines(features: Sequence[Feature]) -> None:
    """Houses that have parts of their own reach as high as the lowest of these; parts stand on the ground."""
    houses = [f for f in features if f.kind == "building"]
    parts = [f for f in features if f.kind == "part"]
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
