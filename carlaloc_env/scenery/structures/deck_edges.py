"""Edges of raised roads: parapets, railings over water, and the faces of decks and walls below them."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import WALL_M
from carlaloc_env.scenery.ground.raised_parts import DECK_M, DIM, FOOTING_M, GREY, Floor, RaisedParts
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder

PARAPET_M, HANDRAIL_M = 0.8, 1.1
"""Height of the concrete parapet and of the rail on it above the road's edge [m]."""
RAIL_KERB_M, OPEN_RAILS_M = 0.25, (0.46, 0.67, 0.88, 1.08)
"""Over water, railings that one looks through: height of the kerb below them and of their rails [m]."""
POST_HALF_M = 0.035
"""Half the side of a railing's post [m]."""
_END_M = 2.2


def add_rim(out: MeshBuilder, ring: Array, parts: RaisedParts, ends: cKDTree | None, floor: Floor) -> None:
    """Parapet and outer face along one boundary line (closed, the deck on its left)."""
    line = ring[:-1]
    top = np.column_stack([line, parts.top.nearest(line)[0]])
    lateral = ~at_end(top, ends)
    opened = shapely.dwithin(parts.open, shapely.points(0.5 * (line + np.roll(line, -1, axis=0))), 0.06)
    outward = np.zeros_like(top)
    outward[:, :2] = outward_of(line)
    outer = top + WALL_M * outward
    bottom = np.minimum(parts.road.nearest(line)[0], top[:, 2]) - DECK_M
    foot = np.minimum(floor.height(outer[:, :2]), bottom) - FOOTING_M
    after = np.roll(np.arange(len(line)), -1)
    wet = opened & floor.near_water(outer[:, :2])
    for rows, low, high_m in (
        (opened & ~wet, bottom, PARAPET_M),
        (wet, bottom, RAIL_KERB_M),
        (~opened, foot, PARAPET_M),
    ):
        a = np.flatnonzero(lateral & rows)
        if len(a):
            _parapet(out, a, after[a], top, outer, low, high_m, soffit=low is bottom)
    _caps(
        out, np.where(lateral, 1 + opened + wet, 0), top, outer, foot, np.where(wet, RAIL_KERB_M, PARAPET_M)
    )
    rails = ((lateral & ~wet, PARAPET_M, (HANDRAIL_M,)), (lateral & wet, RAIL_KERB_M, OPEN_RAILS_M))
    for rows, base_m, heights_m in rails:
        _railing(out, np.flatnonzero(rows), after, 0.5 * (top + outer), base_m, heights_m)


def _parapet(
    out: MeshBuilder, a: NDArray[np.int64], b: NDArray[np.int64], top: Array, outer: Array, low: Array,
    high_m: float, *, soffit: bool,
) -> None:  # fmt: skip
    up = np.array([0.0, 0.0, high_m])
    sunk = np.array([0.0, 0.0, 0.3])
    inner = np.stack([top[b] - sunk, top[a] - sunk, top[a] + up, top[b] + up], axis=1)
    out.quads(inner, material=Material.CONCRETE, tag=Tag.GUARD_RAIL, colour=GREY)
    lid = np.stack([top[a], outer[a], outer[b], top[b]], axis=1) + up
    out.quads(lid, material=Material.CONCRETE, tag=Tag.GUARD_RAIL, colour=GREY)
    down = outer.copy()
    down[:, 2] = low
    face = np.stack([down[a], down[b], outer[b] + up, outer[a] + up], axis=1)
    out.quads(face, material=Material.CONCRETE_PANEL, tag=Tag.BRIDGE, colour=GREY)
    if soffit:
        inside = top.copy()
        inside[:, 2] = low
        under = np.stack([inside[a], inside[b], down[b], down[a]], axis=1)
        out.quads(under, material=Material.CONCRETE, tag=Tag.BRIDGE, colour=DIM)


def _caps(
    out: MeshBuilder, kind: NDArray[np.int64], top: Array, outer: Array, low: Array, high_m: Array
) -> None:
    """Ends of parapets and of the walls below them, seen from both sides."""
    rows = np.flatnonzero(kind != np.roll(kind, 1))
    if not len(rows):
        return
    up = np.zeros((len(rows), 3))
    up[:, 2] = np.maximum(high_m[rows], np.roll(high_m, 1)[rows])
    inside, outside = top[rows].copy(), outer[rows].copy()
    inside[:, 2] = outside[:, 2] = low[rows]
    quads = np.stack([inside, outside, outer[rows] + up, top[rows] + up], axis=1)
    out.quads(
        np.concatenate([quads, quads[:, ::-1]]), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=GREY
    )


def _railing(
    out: MeshBuilder,
    a: NDArray[np.int64],
    after: NDArray[np.int64],
    line: Array,
    base_m: float,
    heights_m: Sequence[float],
) -> None:
    """Posts on a parapet or kerb, and the rails that they carry."""
    if not len(a):
        return
    b, up = after[a], np.array([0.0, 0.0, 1.0])
    faces = []
    for height in heights_m:
        half = 0.05 if height == heights_m[-1] else 0.025
        low, high = line + up * (height - half), line + up * (height + half)
        faces.append(np.stack([low[a], low[b], high[b], high[a]], axis=1))
    front = np.concatenate(faces)
    both = np.concatenate([front, front[:, ::-1], _rail_posts(line, a[::2], after, base_m, heights_m[-1])])
    out.quads(both, material=Material.METAL_GALVANISED, tag=Tag.GUARD_RAIL, colour=(190, 192, 194))


def _rail_posts(
    line: Array, rows: NDArray[np.int64], after: NDArray[np.int64], base_m: float, top_m: float
) -> Array:
    """Sides of square posts every two metres, as drawn for German bridges (RIZ-ING Gel)."""
    along = line[after[rows]] - line[rows]
    along *= POST_HALF_M / np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-6)[:, None]
    across = np.stack([along[:, 1], -along[:, 0], np.zeros(len(rows))], axis=-1)
    ring = np.stack(
        [line[rows] + i * along + j * across for i, j in ((-1, -1), (-1, 1), (1, 1), (1, -1))], axis=1
    )
    up = np.array([0.0, 0.0, 1.0])
    low, high = ring + (base_m - 0.02) * up, ring + top_m * up
    sides = np.stack([low, np.roll(low, -1, axis=1), np.roll(high, -1, axis=1), high], axis=2)
    quads: Array = sides.reshape(-1, 4, 3)
    return quads


def at_end(points: Array, ends: cKDTree | None) -> Mask:
    """Whether points lie where a road goes on upon the ground."""
    if ends is None:
        return np.zeros(len(points), dtype=bool)
    return np.asarray(ends.query(points)[0] < _END_M)


def outward_of(line: Array) -> Array:
    """Unit vectors (N, 2) out of a closed line without repeated corner, mitred up to 60°."""
    step = np.roll(line, -1, axis=0) - line
    step /= np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)[:, None]
    right = np.stack([step[:, 1], -step[:, 0]], axis=-1)
    both = right + np.roll(right, 1, axis=0)
    length = np.maximum(np.hypot(both[:, 0], both[:, 1]), 1.0)[:, None]
    result: Array = both / length * np.minimum(2.0 / length, 1.6)
    return result
