"""Triangulation of areas on a grid that is fixed in the world."""

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from carlaloc_env.core.areas import Area, polygons_of
from carlaloc_env.core.array_types import Array

COARSE_CELLS = 10
"""Grid cells along one side of the blocks into which large areas are cut first."""
_CELLS = np.stack(np.meshgrid(*[np.arange(COARSE_CELLS)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)


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
    area2 = twice_area(unique[triangles])
    triangles = np.where((area2 < 0)[:, None], triangles[:, ::-1], triangles)
    return unique, triangles[np.abs(area2) > 1e-7]


def delaunay_triangles(parts: list[Area]) -> Array:
    """Triangles (T, 3, 2) of polygons, in either order."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(np.array(parts, dtype=object)))
    return np.asarray(shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3])


def twice_area(triangles: Array) -> Array:
    """Twice the area of triangles (T, 3, 2), below 0 for clockwise ones, (T,)."""
    a, b, c = (triangles[:, k] for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


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
    triangles_of: list[Array] = []
    if inside.any():
        a = low[inside]
        east, north = np.array([cell_m, 0.0]), np.array([0.0, cell_m])
        b, c, d = a + east, a + east + north, a + north
        triangles_of.append(np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3, 2))
    edge = ~inside & shapely.intersects(block, boxes)
    if edge.any():
        parts = polygons_of(shapely.intersection(block, boxes[edge]))
        triangles_of.append(delaunay_triangles(parts))
    return triangles_of


def _boxes(part: Area, size_m: float) -> tuple[Array, NDArray[np.object_]]:
    x0, y0, x1, y1 = shapely.bounds(part)
    i = np.arange(np.floor(x0 / size_m), np.ceil(x1 / size_m))
    j = np.arange(np.floor(y0 / size_m), np.ceil(y1 / size_m))
    corners = np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1).reshape(-1, 2) * size_m
    boxes = shapely.box(corners[:, 0], corners[:, 1], corners[:, 0] + size_m, corners[:, 1] + size_m)
    return corners, boxes
