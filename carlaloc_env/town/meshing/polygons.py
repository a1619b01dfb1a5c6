"""Plan-view areas: unions, strips along lines, and triangulation on a world-fixed grid.

The mesh that wheels and bodies touch: the ground as it is, everything else as coarse boxes.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.mesh import Mesh

Area = Any
"""A shapely geometry; shapely ships no type information."""

COARSE_CELLS = 10
"""Grid cells along one side of the blocks into which large areas are cut first."""
_CELLS = np.stack(np.meshgrid(*[np.arange(COARSE_CELLS)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)


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


def rings(shape: Area, step_m: float) -> list[Array]:
    """Closed boundary lines (N, 2) with corners at most `step_m` apart; the area lies on their left."""
    lines = []
    for part in polygons_of(shapely.orient_polygons(shape)):
        for ring in [part.exterior, *part.interiors]:
            lines.append(np.asarray(shapely.get_coordinates(shapely.segmentize(ring, step_m))))
    return lines


def triangulate(shape: Area, cell_m: float) -> tuple[Array, NDArray[np.int64]]:
    """Corners (V, 2) and anticlockwise triangles (T, 3) of an area, cut along a grid of `cell_m`.

    The grid is fixed in the world, so that neighbouring areas get the same corners on their common edge.
    """
    pieces: list[Array] = []
    block_m = cell_m * COARSE_CELLS
    for part in polygons_of(shape):
        for block, corner in _blocks(part, block_m):
            pieces.extend(_block_triangles(block, corner, cell_m))
    if not pieces:
        return np.zeros((0, 2)), np.zeros((0, 3), dtype=np.int64)
    corners = np.round(np.concatenate(pieces).reshape(-1, 2), 4)
    unique, _, inverse = unique_rows(corners)
    triangles = inverse.reshape(-1, 3)
    a, b, c = (unique[triangles[:, i]] for i in range(3))
    area2 = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles = np.where((area2 < 0)[:, None], triangles[:, ::-1], triangles)
    return unique, triangles[np.abs(area2) > 1e-7]


def unique_rows(rows: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64], NDArray[np.int64]]:
    """Different rows (U, K) in ascending order, where each came first (U,), and which one each row is (N,).

    As numpy's `unique` over rows, which compares whole rows at a time and takes several times longer.
    """
    order = np.lexsort(rows.T[::-1])
    ascending = rows[order]
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (ascending[1:] != ascending[:-1]).any(axis=1)
    inverse = np.empty(len(rows), dtype=np.int64)
    inverse[order] = np.cumsum(new) - 1
    return ascending[new], order[new], inverse


def _blocks(part: Area, block_m: float) -> list[tuple[Area, Array]]:
    corners, boxes = _boxes(part, block_m)
    shapely.prepare(part)
    hit = shapely.intersects(part, boxes)
    cut = shapely.intersection(part, boxes[hit])
    return [(shape, corner) for shape, corner in zip(cut, corners[hit], strict=True) if shape.area > 1e-6]


def _block_triangles(block: Area, corner: Array, cell_m: float) -> list[Array]:
    low = corner + _CELLS * cell_m
    x0, y0, x1, y1 = block.bounds
    # Thin areas touch few cells of their block.
    low = low[(low[:, 0] < x1) & (low[:, 0] + cell_m > x0) & (low[:, 1] < y1) & (low[:, 1] + cell_m > y0)]
    boxes = shapely.box(low[:, 0], low[:, 1], low[:, 0] + cell_m, low[:, 1] + cell_m)
    shapely.prepare(block)
    inside = shapely.covers(block, boxes)
    found: list[Array] = []
    if inside.any():
        a = low[inside]
        east, north = np.array([cell_m, 0.0]), np.array([0.0, cell_m])
        b, c, d = a + east, a + east + north, a + north
        found.append(np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3, 2))
    edge = ~inside & shapely.intersects(block, boxes)
    if edge.any():
        parts = polygons_of(shapely.intersection(block, boxes[edge]))
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(np.array(parts, dtype=object)))
        if len(triangles):
            found.append(shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3])
    return found


def _boxes(part: Area, size_m: float) -> tuple[Array, NDArray[np.object_]]:
    x0, y0, x1, y1 = shapely.bounds(part)
    i = np.arange(np.floor(x0 / size_m), np.ceil(x1 / size_m))
    j = np.arange(np.floor(y0 / size_m), np.ceil(y1 / size_m))
    corners = np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1).reshape(-1, 2) * size_m
    boxes = shapely.box(corners[:, 0], corners[:, 1], corners[:, 0] + size_m, corners[:, 1] + size_m)
    return corners, boxes


POST_SIDES = 6
"""Sides of the prisms that stand for poles and trunks."""


def posts(feet_m: Array, radius_m: float, height_m: ArrayLike) -> Array:
    """Upright prisms of poles and trunks, feet (N, 3), heights one or (N,), shape (N·sides, 4, 3)."""
    angle = np.arange(POST_SIDES + 1) * (2 * np.pi / POST_SIDES)
    ring = np.stack([elementary.cos(angle), elementary.sin(angle)], axis=-1)
    low = np.repeat(feet_m[:, None, :], POST_SIDES + 1, axis=1)
    low[..., :2] += ring * radius_m
    high = low.copy()
    high[..., 2] += np.reshape(height_m, (-1, 1))
    quads = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2)
    return quads.reshape(-1, 4, 3)


def weld(meshes: Sequence[Mesh]) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.uint8]]:
    """Corners, triangles and their tags of several meshes with equal corners made one (to 0.1 mm)."""
    corners = np.concatenate([mesh.vertices_m[mesh.triangles].reshape(-1, 3) for mesh in meshes])
    key = np.round(corners.astype(np.float64) * 1e4).astype(np.int64)
    _, first, inverse = unique_rows(key)
    triangles = inverse.reshape(-1, 3)
    real = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    tags = np.concatenate([mesh.tag[mesh.triangles[:, 0]] for mesh in meshes])
    return corners[first].astype(np.float64), triangles[real].astype(np.int32), tags[real]
