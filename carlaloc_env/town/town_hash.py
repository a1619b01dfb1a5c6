"""The name of a built town: a hash of all arrays that decide the course of a drive in it.

Two builds have the same hash if their lanes, signals, route, place on the Earth and road surface are the same
to the last bit, and so is all that can be hit. What is only seen does not count: lamps, lenses and meshes.
"""

from __future__ import annotations

from carlaloc_env.core.files.array_cache import arrays_hash
from carlaloc_env.town.town_roads import TownRoads
from carlaloc_env.town.town_scenery import TownOutline

SOLID = ("collision_vertices_m", "collision_triangles", "collision_tags", "road_events")
"""Arrays of the outline that are hit or felt."""


def town_hash(roads: TownRoads, outline: TownOutline) -> str:
    """Hash of a built town, 32 hexadecimal digits; the same on every processor."""
    return arrays_hash(roads.to_arrays() | {name: getattr(outline, name) for name in SOLID})
