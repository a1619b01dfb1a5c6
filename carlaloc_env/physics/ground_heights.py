"""Heights of a mesh under points: triangles sorted into squares, asked by compiled functions.

A wheel's rays are upright, so they meet a triangle over a point and need no general ray test. Tables are kept
on disk: sorting a town's triangles takes a twentieth of making an environment.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.core.files.array_files import Arrays, arrays_hash
from carlaloc_env.core.files.shared_arrays import SHARED_FROM_BYTES, read_only
from carlaloc_env.core.jit import compiled

_CELLS_M = (2.0, 64.0)
"""Sides of the squares for small triangles and for large ones [m]."""
_SMALL_M = 8.0
"""Largest extent of a small triangle [m]."""
_STEEPEST = 1e-6
"""Triangles that cover less than this share of their size from above are upright and carry nothing."""
_EDGE = 1e-9
"""So far beyond its edges a triangle reaches, so that no point falls between two."""
KEPT_FILES = 16
"""Tables kept of all meshes: a town has one with and one without parked cars."""


class Squares(NamedTuple):
    """Triangles by the squares of a grid that they may lie in."""

    inside: NDArray[np.int32]
    """Numbers of triangles, those of a square one after the other, shape (M,)."""
    first: NDArray[np.int64]
    """First of them of each square; one more ends the last, east then north, shape (I · J + 1,)."""
    shape: tuple[int, int]
    """Number of squares, I and J."""
    low_m: tuple[float, float]
    """Where the squares begin [m]."""
    cell_m: float
    """Side of a square [m]."""


class GroundTable(NamedTuple):
    """A mesh as wheels ask for it."""

    triangle: Array
    """A corner [m], two sides [m], and one over their cross product seen from above, shape (T, 10)."""
    normal: Array
    """Unit normal, upwards, shape (T, 3)."""
    small: Squares
    """Where small triangles lie."""
    large: Squares
    """Where large ones lie."""


def ground_table(vertices_m: NDArray[np.float64], triangles: NDArray[np.int64]) -> GroundTable:
    """Sort the triangles of a mesh.

    Args:
        vertices_m: Corners [m], world, shape (V, 3).
        triangles: Corner indices, shape (T, 3).
    """
    a, b, c = (vertices_m[triangles[:, k]] for k in range(3))
    p, q = b - a, c - a
    n = np.stack([p[:, y] * q[:, z] - p[:, z] * q[:, y] for y, z in ((1, 2), (2, 0), (0, 1))], axis=1)
    area = np.sqrt(np.sum(n * n, axis=1))
    flat = np.abs(n[:, 2]) > _STEEPEST * np.maximum(area, 1e-12)
    a, p, q, n, area = a[flat], p[flat], q[flat], n[flat], area[flat]
    corners = np.stack([a[:, :2], a[:, :2] + p[:, :2], a[:, :2] + q[:, :2]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    is_large = (high - low).max(axis=1) > _SMALL_M
    return GroundTable(
        triangle=np.concatenate([a, p, q, 1.0 / n[:, 2:]], axis=1),
        normal=n * (np.sign(n[:, 2]) / area)[:, None],
        small=_squares(low, high, np.flatnonzero(~is_large), _CELLS_M[0]),
        large=_squares(low, high, np.flatnonzero(is_large), _CELLS_M[1]),
    )


def _squares(low_m: Array, high_m: Array, which: NDArray[np.intp], cell_m: float) -> Squares:
    """Some triangles, given their bounds from above (T, 2), by squares."""
    if not len(which):
        return Squares(np.zeros(0, np.int32), np.zeros(1, np.int64), (0, 0), (0.0, 0.0), cell_m)
    low, high = low_m[which], high_m[which]
    origin = low.min(axis=0)
    begin = ((low - origin) / cell_m).astype(np.int64)
    extent = ((high - origin) / cell_m).astype(np.int64) - begin + 1
    shape = (begin + extent).max(axis=0)
    count = extent[:, 0] * extent[:, 1]
    owner = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    east, north = within // extent[owner, 1], within % extent[owner, 1]
    cell = (begin[owner, 0] + east) * shape[1] + begin[owner, 1] + north
    order = np.argsort(cell, kind="stable")
    return Squares(
        inside=which[owner[order]].astype(np.int32),
        first=np.searchsorted(cell[order], np.arange(shape[0] * shape[1] + 1)),
        shape=(int(shape[0]), int(shape[1])),
        low_m=(float(origin[0]), float(origin[1])),
        cell_m=cell_m,
    )


@compiled
def highest_below(
    table: GroundTable, x_m: float, y_m: float, high_m: float, low_m: float
) -> tuple[int, float]:
    """The highest triangle over a point between two heights.

    Args:
        table: The mesh.
        x_m: East [m].
        y_m: North [m].
        high_m: What lies higher is not looked at [m].
        low_m: Nor what lies lower [m].

    Returns:
        Its number in the table, −1 for none, and its height there [m].
    """
    best, height = _highest(table.small, table, x_m, y_m, high_m, low_m, -1)
    return _highest(table.large, table, x_m, y_m, high_m, height, best)


@compiled
def _highest(
    squares: Squares, table: GroundTable, x_m: float, y_m: float, high_m: float, height: float, best: int
) -> tuple[int, float]:
    """The same among the triangles of some squares, above a height [m] at which one is known already."""
    i = int(np.floor((x_m - squares.low_m[0]) / squares.cell_m))
    j = int(np.floor((y_m - squares.low_m[1]) / squares.cell_m))
    if i < 0 or j < 0 or i >= squares.shape[0] or j >= squares.shape[1]:
        return best, height
    cell = i * squares.shape[1] + j
    for k in range(squares.first[cell], squares.first[cell + 1]):
        number = squares.inside[k]
        t = table.triangle[number]
        dx, dy = x_m - t[0], y_m - t[1]
        u = (dx * t[7] - dy * t[6]) * t[9]
        v = (dy * t[3] - dx * t[4]) * t[9]
        if u < -_EDGE or v < -_EDGE or u + v > 1.0 + _EDGE:
            continue
        z = t[2] + u * t[5] + v * t[8]
        if height <= z <= high_m:
            best, height = number, z
    return best, height


def kept_ground(vertices_m: NDArray[np.float64], triangles: NDArray[np.int64]) -> GroundTable:
    """The table of a mesh, from the cache when the same code sorted the same triangles before.

    Its arrays are read-only, and processes share those of a large mesh.

    Args:
        vertices_m: Corners [m], world, shape (V, 3).
        triangles: Corner indices, shape (T, 3).
    """

    def make() -> GroundTable:
        return ground_of_arrays(ground_arrays(ground_table(vertices_m, triangles)))

    if vertices_m.nbytes + triangles.nbytes < SHARED_FROM_BYTES:
        return make()
    return cached(
        "ground",
        "ground",
        module=ground_table.__module__,
        make=make,
        to_arrays=ground_arrays,
        from_arrays=ground_of_arrays,
        content=arrays_hash({"vertices_m": vertices_m, "triangles": triangles}),
        kept_files=KEPT_FILES,
    )


def ground_arrays(table: GroundTable) -> Arrays:
    """The table as named arrays."""
    arrays: Arrays = {"triangle": table.triangle, "normal": table.normal}
    for name, squares in (("small", table.small), ("large", table.large)):
        arrays |= {f"{name}/{field}": np.asarray(value) for field, value in squares._asdict().items()}
    return arrays


def ground_of_arrays(arrays: Arrays) -> GroundTable:
    """The table again, as read-only views."""
    views = read_only(arrays)
    return GroundTable(
        triangle=views["triangle"],
        normal=views["normal"],
        small=_squares_of(views, "small"),
        large=_squares_of(views, "large"),
    )


def _squares_of(views: Arrays, name: str) -> Squares:
    columns, rows = views[f"{name}/shape"].tolist()
    x_m, y_m = views[f"{name}/low_m"].tolist()
    return Squares(
        inside=views[f"{name}/inside"],
        first=views[f"{name}/first"],
        shape=(columns, rows),
        low_m=(x_m, y_m),
        cell_m=views[f"{name}/cell_m"].item(),
    )
