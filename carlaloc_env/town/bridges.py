"""Decks, parapets, piers, abutments and retaining walls of roads that stand above the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from carlaloc_env.materials import Material
from carlaloc_env.semantics import Tag
from carlaloc_env.town.areas import JunctionArea
from carlaloc_env.town.fields import EdgeField
from carlaloc_env.town.level_graph import runs
from carlaloc_env.town.levels import WALL_M, Levels, State
from carlaloc_env.town.meshing import MeshBuilder, box_quads
from carlaloc_env.town.polygons import Area, areas_only, rings, triangulate
from carlaloc_env.town.terrain import Ground

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DECK_M = 0.9
"""Thickness of a deck [m]."""
PARAPET_M, HANDRAIL_M = 0.8, 1.1
"""Height of the concrete parapet and of the rail on it above the road's edge [m]."""
RAIL_KERB_M, OPEN_RAILS_M = 0.25, (0.46, 0.67, 0.88, 1.08)
"""Over water, railings that one looks through: height of the kerb below them and of their rails [m]."""
SHORE_M = 8.0
"""Decks have them this far from the shore too [m]."""
PIER_STEP_M = 22.0
"""Distance of piers along a road [m]."""
COLUMN_M = 0.55
"""Half the side of a column [m]."""
COLUMN_STEP_M = 9.0
"""Largest distance of the columns of one pier across the road [m]."""
PIER_CLEAR_M = 0.9
"""Distance of columns from lanes and pavements below [m]."""
CROSSHEAD_M = 0.7
"""Height of the beam on the columns of a pier [m]."""
FOOTING_M = 0.8
"""How far walls and piers reach into the ground [m]."""
_END_M = 2.2
_CELL_M = 5.0
_GREY = (224, 222, 216)
_DIM = (205, 203, 197)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RaisedParts:
    """Plan-view areas of all that stands above the ground, and the heights of its edges."""

    open: Area
    """Decks: ground, road or water goes on below."""
    filled: Area
    """Roads between retaining walls."""
    road: EdgeField
    """Heights of the roads' edges."""
    top: EdgeField
    """Heights of the outer edges at their top, pavements included."""
    below: Area
    """Everything paved on the ground."""

    @property
    def whole(self) -> Area:
        """Decks and filled parts as one."""
        joined = shapely.union(self.open, self.filled)
        closed = shapely.buffer(joined, 0.05, join_style="mitre", mitre_limit=2.0)
        return areas_only(shapely.buffer(closed, -0.05, join_style="mitre", mitre_limit=2.0), 0.5)


def raised_parts(
    levels: Levels, road: EdgeField | None, junctions: Sequence[tuple[JunctionArea, State]], below: Area
) -> RaisedParts | None:
    """Areas of what stands above the ground; None where nothing does.

    Args:
        levels: What leaves the ground.
        road: Heights of the edges of raised roads.
        junctions: Raised junctions with their state.
        below: Everything paved on the ground.
    """
    if road is None:
        return None
    parts = {state: [levels.area(state)] for state in (State.OPEN, State.FILLED)}
    for junction, state in junctions:
        parts[state] += [junction.roadway, junction.pavement]
    opened, filled = (
        areas_only(shapely.union_all(parts[state], grid_size=1e-3)) for state in (State.OPEN, State.FILLED)
    )
    graph = levels.graph
    up = (levels.state == State.OPEN) | (levels.state == State.FILLED)
    lines = [line[a:b] for line in (graph.left_m, graph.right_m) for a, b in _runs_in_strips(graph.strip, up)]
    return RaisedParts(
        open=opened,
        filled=areas_only(shapely.difference(filled, opened)),
        road=road,
        top=EdgeField(lines),
        below=below,
    )


def add_bridges(
    out: MeshBuilder, levels: Levels, parts: RaisedParts, edges_below: EdgeField, ground: Ground
) -> None:
    """Everything that carries raised roads.

    Args:
        out: Where it goes.
        levels: What leaves the ground.
        parts: Its areas.
        edges_below: Edges of the roads on the ground, where raised ones end.
        ground: Heights of the ground.
    """
    floor = _Floor(levels, ground)
    whole = parts.whole
    ends = cKDTree(edges_below.points_m) if len(edges_below.points_m) else None
    shapely.prepare(parts.open)
    for ring in rings(whole, 1.0):
        _rim(out, ring, parts, ends, floor)
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
            colour=_DIM,
        )
    _piers(out, levels, parts, floor)


class _Floor:
    """What walls and piers stand on: the ground, or the bed of a water."""

    def __init__(self, levels: Levels, ground: Ground) -> None:
        self._waters = levels.waters
        self._ground = ground
        for water in self._waters:
            shapely.prepare(water.area)

    def near_water(self, xy: Array) -> Mask:
        """Whether points (M, 2) lie over or near a water."""
        found = np.zeros(len(xy), dtype=bool)
        for water in self._waters:
            found |= shapely.dwithin(water.area, shapely.points(xy), SHORE_M)
        return found

    def height(self, xy: Array) -> Array:
        z = self._ground.height(xy)
        for water in self._waters:
            inside = shapely.contains_xy(water.area, xy[:, 0], xy[:, 1])
            z = np.where(inside, np.minimum(z, water.level_m - 0.4), z)
        return z


def _rim(out: MeshBuilder, ring: Array, parts: RaisedParts, ends: cKDTree | None, floor: _Floor) -> None:
    """Parapet and outer face along one boundary line (closed, the deck on its left)."""
    line = ring[:-1]
    top = np.column_stack([line, parts.top.nearest(line)[0]])
    lateral = ~_at_end(top, ends)
    opened = shapely.dwithin(parts.open, shapely.points(0.5 * (line + np.roll(line, -1, axis=0))), 0.06)
    outward = np.zeros_like(top)
    outward[:, :2] = _outward(line)
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
    out.quads(inner, material=Material.CONCRETE, tag=Tag.GUARD_RAIL, colour=_GREY)
    lid = np.stack([top[a], outer[a], outer[b], top[b]], axis=1) + up
    out.quads(lid, material=Material.CONCRETE, tag=Tag.GUARD_RAIL, colour=_GREY)
    down = outer.copy()
    down[:, 2] = low
    face = np.stack([down[a], down[b], outer[b] + up, outer[a] + up], axis=1)
    out.quads(face, material=Material.CONCRETE_PANEL, tag=Tag.BRIDGE, colour=_GREY)
    if soffit:
        inside = top.copy()
        inside[:, 2] = low
        under = np.stack([inside[a], inside[b], down[b], down[a]], axis=1)
        out.quads(under, material=Material.CONCRETE, tag=Tag.BRIDGE, colour=_DIM)


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
        np.concatenate([quads, quads[:, ::-1]]), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=_GREY
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
    posts = a[::2]
    step = line[after[posts]] - line[posts]
    step *= 0.04 / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-6)[:, None]
    foot, head = line[posts] + up * (base_m - 0.02), line[posts] + up * heights_m[-1]
    faces.append(np.stack([foot - step, foot + step, head + step, head - step], axis=1))
    front = np.concatenate(faces)
    both = np.concatenate([front, front[:, ::-1]])
    out.quads(both, material=Material.METAL_GALVANISED, tag=Tag.GUARD_RAIL, colour=(190, 192, 194))


def _abutments(
    out: MeshBuilder, ring: Array, parts: RaisedParts, rim: Area, ends: cKDTree | None, floor: _Floor
) -> None:
    """Walls at the ends of decks, which look below them."""
    line = ring[:-1]
    middle = 0.5 * (line + np.roll(line, -1, axis=0))
    high = np.column_stack([line, parts.road.nearest(line)[0] - 0.1])
    inner = shapely.distance(rim, shapely.points(middle)) > 0.2
    # Slits between carriageways are no ends: behind an abutment there is ground.
    inner &= shapely.dwithin(parts.filled, shapely.points(middle), 0.3)
    at_end = _at_end(np.column_stack([middle, parts.top.nearest(middle)[0]]), ends)
    a = np.flatnonzero(inner | at_end)
    if not len(a):
        return
    b = np.roll(np.arange(len(line)), -1)[a]
    low = high.copy()
    # A little inside, below the deck, where no road hides the ground.
    low[:, 2] = np.minimum(floor.height(line - 0.6 * _outward(line)), high[:, 2]) - FOOTING_M
    faces = np.stack([low[b], low[a], high[a], high[b]], axis=1)
    out.quads(faces, material=Material.CONCRETE_PANEL, tag=Tag.BRIDGE, colour=_DIM)


def _piers(out: MeshBuilder, levels: Levels, parts: RaisedParts, floor: _Floor) -> None:
    graph = levels.graph
    keep_off = shapely.buffer(parts.below, PIER_CLEAR_M)
    inside = shapely.buffer(parts.open, -0.3)
    for area in (keep_off, inside):
        shapely.prepare(area)
    placed: list[Array] = []
    for a, b in _runs_in_strips(graph.strip, levels.state == State.OPEN):
        if graph.junction[a] and b - a < PIER_STEP_M:
            continue
        count = int((b - a) / PIER_STEP_M)
        for k in range(count):
            wanted = a + int((k + 0.5) * (b - a) / count)
            for shift in (0, 2, -2, 4, -4, 6, -6, 8, -8):
                row = wanted + shift
                if not a + 2 <= row < b - 2:
                    continue
                feet = _columns(graph.left_m[row], graph.right_m[row])
                if _stands(feet, keep_off, inside, placed):
                    placed.append(feet[:, :2])
                    _pier(out, feet, graph.left_m[row], graph.right_m[row], parts, floor)
                    break


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


def _pier(
    out: MeshBuilder, feet: Array, left: Array, right: Array, parts: RaisedParts, floor: _Floor
) -> None:
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
    boxes[..., :2] = boxes[..., :2] @ turn + feet[None, :, None, :2]
    faces = [boxes.reshape(-1, 4, 3)]
    if head:
        half = 0.5 * float(np.hypot(*(feet[-1] - feet[0])[:2])) + 1.2
        middle = 0.5 * (feet[0] + feet[-1])
        slope = np.array([0.0, 0.0, float(under[-1] - under[0]) / max(2.0 * (half - 1.2), 1.0)])
        beam = box_quads([-half, -0.65, -head], [half, 0.65, 0.05], bottom=True)
        beam[..., 2] += slope[2] * beam[..., 0] + float(under.mean())
        beam[..., :2] = beam[..., :2] @ turn + middle[:2]
        faces.append(beam)
    out.quads(np.concatenate(faces), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=_DIM)


def _at_end(points: Array, ends: cKDTree | None) -> Mask:
    """Whether points lie where a road goes on upon the ground."""
    if ends is None:
        return np.zeros(len(points), dtype=bool)
    return np.asarray(ends.query(points)[0] < _END_M)


def _outward(line: Array) -> Array:
    """Unit vectors (N, 2) out of a closed line without repeated corner, mitred up to 60°."""
    step = np.roll(line, -1, axis=0) - line
    step /= np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)[:, None]
    right = np.stack([step[:, 1], -step[:, 0]], axis=-1)
    both = right + np.roll(right, 1, axis=0)
    length = np.maximum(np.hypot(both[:, 0], both[:, 1]), 1.0)[:, None]
    result: Array = both / length * np.minimum(2.0 / length, 1.6)
    return result


def _runs_in_strips(strip: NDArray[np.int64], mask: Mask) -> list[tuple[int, int]]:
    """Half-open ranges of rows that hold a mask, cut where the strip changes."""
    found = []
    for number in np.unique(strip[mask]):
        rows = np.flatnonzero(strip == number)
        found += [(int(rows[0]) + a, int(rows[0]) + b) for a, b in runs(mask[rows]) if b - a > 1]
    return found
