"""Areas in plan: polygons of rings and strips, their unions, and their outlines."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely

from carlaloc_env.core.array_types import Array

Area = Any
"""A shapely geometry; shapely ships no type information."""


def polygon(ring_xy_m: Array) -> Area:
    """Area inside a closed ring (N, 2); repaired where the ring crosses itself."""
    if len(ring_xy_m) < 3:
        return shapely.Polygon()
    shape = shapely.Polygon(ring_xy_m[:, :2])
    return shape if shape.is_valid else shapely.buffer(shapely.make_valid(shape), 0.0)


def strip_polygon(left_m: Array, right_m: Array) -> Area:
    """Area between two lines that run the same way, each (N, 2) or (N, 3).

    Built from one quad per step, so that lines which bend tighter than the width stay valid.
    """
    a, b = left_m[:-1, :2], left_m[1:, :2]
    c, d = right_m[1:, :2], right_m[:-1, :2]
    quads = shapely.polygons(np.stack([a, d, c, b, a], axis=1))
    # Most strips do not fold: their outline is the area, which saves the union of all quads.
    whole = shapely.polygons(np.concatenate([left_m[:, :2], right_m[::-1, :2], left_m[:1, :2]]))
    size = shapely.area(quads).sum()
    if shapely.is_valid(whole) and abs(whole.area - size) < 1e-9 * (1.0 + size):
        return shapely.MultiPolygon([whole]) if whole.area > 1e-9 else shapely.Polygon()
    quads = shapely.make_valid(quads[shapely.area(quads) > 1e-9])
    return areas_only(shapely.union_all(quads, grid_size=1e-4)) if len(quads) else shapely.Polygon()


def union(shapes: Iterable[Area]) -> Area:
    """Union of areas, with cracks below 2 cm closed."""
    joined = shapely.union_all(list(shapes), grid_size=1e-4)
    closed = shapely.buffer(joined, 0.01, join_style="mitre", mitre_limit=2.0)
    return areas_only(shapely.buffer(closed, -0.01, join_style="mitre", mitre_limit=2.0))


def without(area: Area, taken: Area) -> Area:
    """An area less another; both are repaired and snapped to 0.1 mm where they do not overlay as they are."""
    try:
        return shapely.difference(area, taken)
    except shapely.GEOSException:
        return shapely.difference(shapely.make_valid(area), shapely.make_valid(taken), grid_size=1e-4)


def areas_only(shape: Area, least_m2: float = 1e-3) -> Area:
    """The polygons of a geometry without lines, points and specks."""
    parts = polygons_of(shape)
    return shapely.MultiPolygon([part for part in parts if part.area > least_m2])


def polygons_of(shape: Area) -> list[Area]:
    """Polygons of any geometry, in a fixed order."""
    parts = shapely.get_parts(shapely.get_parts(np.atleast_1d(shape)))
    return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]


def fill_holes(shape: Area, largest_m2: float) -> Area:
    """The same area with holes up to a size [m²] closed."""
    filled = []
    for part in polygons_of(shape):
        kept = [ring for ring in part.interiors if shapely.Polygon(ring).area > largest_m2]
        filled.append(shapely.Polygon(part.exterior, kept))
    return areas_only(shapely.union_all(filled))


def rings(shape: Area, step_m: float | None = None) -> list[Array]:
    """Closed boundary lines (N, 2), the area on their left, with corners at most `step_m` apart if given."""
    lines = []
    for part in polygons_of(shapely.orient_polygons(shape)):
        for ring in [part.exterior, *part.interiors]:
            line = ring if step_m is None else shapely.segmentize(ring, step_m)
            lines.append(np.asarray(shapely.get_coordinates(line)))
    return lines
