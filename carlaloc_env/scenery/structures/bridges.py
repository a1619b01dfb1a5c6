"""Bridges: decks, parapets, abutments, retaining walls and piers.

Piers below decks, on columns that keep clear of what passes under them.

Edges of raised roads: parapets, railings over water, and the faces of decks and walls below them.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area, rings
from carlaloc_env.core.array_types import Array, Mask
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_levels import WALL_M, Levels, State
from carlaloc_env.scenery.ground.ground_plan import (
    DECK_M,
    DIM,
    FOOTING_M,
    GREY,
    Floor,
    RaisedParts,
    runs_in_strips,
)
from carlaloc_env.scenery.ground.height_fields import EdgeField
from carlaloc_env.scenery.ground.terrain import Terrain
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads
from carlaloc_env.scenery.meshing.triangulation import triangulate

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


PIER_STEP_M = 22.0
"""Distance of piers along a road [m]."""
COLUMN_M = 0.55
"""Half the side of a column [m]."""
COLUMN_STEP_M = 5.0
"""Largest distance of the columns of one pier across the road [m]."""
PIER_CLEAR_M = 0.9
"""Distance of columns from lanes and sidewalks below [m]."""
ROW_STEP = 0.1
"""Distance of places that are tried, in rows of about a metre."""
CROSSHEAD_M = 0.7
"""Height of the beam on the columns of a pier [m]."""


def add_piers(out: MeshBuilder, levels: Levels, parts: RaisedParts, floor: Floor) -> None:
    """Piers of all open stretches, as evenly spaced as what lies below lets them be."""
    graph = levels.graph
    keep_off = shapely.buffer(parts.below, PIER_CLEAR_M)
    inside = shapely.buffer(parts.open, -0.3)
    for area in (keep_off, inside):
        shapely.prepare(area)
    placed: list[Array] = []
    for a, b in runs_in_strips(graph.strip, levels.state == State.OPEN):
        if graph.junction[a] and b - a < PIER_STEP_M:
            continue
        count = int((b - a) / PIER_STEP_M)
        for k in range(count):
            for row in _rows_about(a + 2, b - 3, (k + 0.5) / count, 1.0 / count):
                left, right = (_between(edge, row) for edge in (graph.left_m, graph.right_m))
                feet = _columns(left, right)
                if _stands(feet, keep_off, inside, placed):
                    placed.append(feet[:, :2])
                    _pier(out, feet, left, right, parts, floor)
                    break


def _rows_about(first: int, last: int, share: float, span: float) -> Array:
    """Fractional rows of a stretch, those nearest to a share of it first, within half a span of it.

    They are so close to each other that a pier finds the middle of a narrow median.
    """
    found = np.arange(first, last, ROW_STEP)
    away = np.abs(found - first - share * (last - first))
    near = away <= 0.5 * span * (last - first)
    rows: Array = found[near][np.argsort(away[near], kind="stable")]
    return rows


def _between(points: Array, row: float) -> Array:
    """Point at a fractional row, shape (3,)."""
    low = int(row)
    found: Array = points[low] + (row - low) * (points[low + 1] - points[low])
    return found


def _columns(left: Array, right: Array) -> Array:
    """Middles of the columns of one pier (K, 3)."""
    width = float(np.hypot(*(left - right)[:2]))
    count = max(1, int(np.ceil((width - 3.0) / COLUMN_STEP_M)))
    share = (np.arange(count) + 0.5) / count
    result: Array = left + share[:, None] * (right - left)
    return result


def _stands(feet: Array, keep_off: Area, inside: Area, placed: Sequence[Array]) -> bool:
    if shapely.contains_xy(keep_off, feet[:, 0], feet[:, 1]).any():
        return False
    if not shapely.contains_xy(inside, feet[:, 0], feet[:, 1]).all():
        return False
    return not any(np.hypot(*(feet[:, None, :2] - other[None]).T).min() < 6.0 for other in placed)


def _pier(out: MeshBuilder, feet: Array, left: Array, right: Array, parts: RaisedParts, floor: Floor) -> None:
    across = (right - left) / np.hypot(*(right - left)[:2])
    across[2] = 0.0
    turn = np.array([[across[0], across[1]], [-across[1], across[0]]])
    under = parts.road.nearest(feet[:, :2])[0] - DECK_M
    ground = floor.height(feet[:, :2]) - FOOTING_M
    head = CROSSHEAD_M if len(feet) > 1 else 0.0
    boxes = box_quads(
        np.column_stack([np.full((len(feet), 2), -COLUMN_M), ground]),
        np.column_stack([np.full((len(feet), 2), COLUMN_M), under - head + 0.02]),
    ).reshape(5, len(feet), 4, 3)
    boxes[..., :2] = elementary.matrix_product(boxes[..., :2], turn) + feet[None, :, None, :2]
    faces = [boxes.reshape(-1, 4, 3)]
    if head:
        half = 0.5 * float(np.hypot(*(feet[-1] - feet[0])[:2])) + 1.2
        middle = 0.5 * (feet[0] + feet[-1])
        slope = np.array([0.0, 0.0, float(under[-1] - under[0]) / max(2.0 * (half - 1.2), 1.0)])
        beam = box_quads([-half, -0.65, -head], [half, 0.65, 0.05], bottom=True)
        beam[..., 2] += slope[2] * beam[..., 0] + float(under.mean())
        beam[..., :2] = elementary.matrix_product(beam[..., :2], turn) + middle[:2]
        faces.append(beam)
    out.quads(np.concatenate(faces), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=DIM)


_CELL_M = 5.0


def add_bridges(
    out: MeshBuilder, levels: Levels, parts: RaisedParts, edges_below: EdgeField, ground: Terrain
) -> None:
    """Everything that carries raised roads.

    Args:
        out: Where it goes.
        levels: What leaves the ground.
        parts: Its areas.
        edges_below: Edges of the roads on the ground, where raised ones end.
        ground: Heights of the ground.
    """
    floor = Floor(levels, ground)
    whole = parts.whole
    ends = cKDTree(edges_below.points_m) if len(edges_below.points_m) else None
    shapely.prepare(parts.open)
    for ring in rings(whole, 1.0):
        add_rim(out, ring, parts, ends, floor)
    rim = shapely.boundary(whole)
    shapely.prepare(rim)
    for ring in rings(parts.open, 1.0):
        _abutments(out, ring, parts, rim, ends, floor)
    xy, triangles = triangulate(parts.open, _CELL_M)
    if len(xy):
        points = np.column_stack([xy, parts.road.nearest(xy)[0] - DECK_M])
        out.triangles(
            points,
            triangles[:, ::-1],
            material=Material.CONCRETE_PANEL,
            tag=Tag.BRIDGE,
            colour=DIM,
        )
    add_piers(out, levels, parts, floor)


def _abutments(
    out: MeshBuilder, ring: Array, parts: RaisedParts, rim: Area, ends: cKDTree | None, floor: Floor
) -> None:
    """Walls at the ends of decks, which look below them."""
    line = ring[:-1]
    middle = 0.5 * (line + np.roll(line, -1, axis=0))
    high = np.column_stack([line, parts.road.nearest(line)[0] - 0.1])
    inner = shapely.distance(rim, shapely.points(middle)) > 0.2
    # Slits between carriageways are no ends: behind an abutment there is ground.
    inner &= shapely.dwithin(parts.filled, shapely.points(middle), 0.3)
    ending = at_end(np.column_stack([middle, parts.top.nearest(middle)[0]]), ends)
    a = np.flatnonzero(inner | ending)
    if not len(a):
        return
    b = np.roll(np.arange(len(line)), -1)[a]
    low = high.copy()
    # A little inside, below the deck, where no road hides the ground.
    low[:, 2] = np.minimum(floor.height(line - 0.6 * outward_of(line)), high[:, 2]) - FOOTING_M
    faces = np.stack([low[b], low[a], high[a], high[b]], axis=1)
    out.quads(faces, material=Material.CONCRETE_PANEL, tag=Tag.BRIDGE, colour=DIM)
