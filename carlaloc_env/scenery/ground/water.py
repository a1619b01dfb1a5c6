"""Bodies of water: how high they stand, their surface, banks and quays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from carlaloc_env.core.areas import Area, areas_only, polygons_of, rings
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import right_of
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.grade_graph import grown, runs
from carlaloc_env.scenery.ground.terrain import LAP_M, Terrain, Zones, water_surface
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, extrude

BRIDGE_DROP_M = 2.7
"""Height of the lowest bridge over the water below it [m]."""
SHORE_DROP_M = 1.5
"""Height of the lower parts of the shore over the water [m]."""
BANK_M = 6.0
"""Width of a sloping bank [m]."""
BANK_RISE_M = 0.7
"""Height of the top of a sloping bank over the water [m]."""
QUAY_NEAR_M = 6.0
"""Shores this near to something paved have a quay wall [m]."""
COPING_M = (0.5, 0.16)
"""Width and height of a quay's coping [m]."""
WING_M = 16.0
"""Longer quays have a railing [m]."""
RAIL_M = 1.05
"""Height of the railing on a quay [m]."""
_QUAY_ZONES = ("downtown", "skyscraper", "waterfront", "industrial")
_STEP_M = 1.5
_BORDER_M = 0.5
_CELL_M = 8.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Water:
    """One lake, river or harbour."""

    area: Area
    """Its surface in plan."""
    level_m: float
    """Height of the surface [m]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shore:
    """A run of shore; the water lies on the left of its line."""

    line_m: Array
    """World x and y [m], shape (N, 2)."""
    quay: bool
    """A wall, or else a sloping bank."""
    water: Water
    """The water below."""


def water_areas(zones: Zones) -> list[Area]:
    """Connected areas of all zones of water."""
    return polygons_of(areas_only(shapely.buffer(zones.area("water"), 0.0), 20.0))


def water_level_m(area: Area, ground_m: Array, bridges_m: Array) -> float:
    """Height of a water's surface [m] from heights along its shore and of the bridges over it."""
    low = float(np.percentile(ground_m, 20)) - SHORE_DROP_M
    return min(low, float(bridges_m.min()) - BRIDGE_DROP_M) if len(bridges_m) else low


def shores(waters: Sequence[Water], zones: Zones, paved: Area) -> list[Shore]:
    """Shores of all waters, cut where quays end; a water that goes on outside the town has none there."""
    x0, y0, x1, y1 = shapely.bounds(shapely.MultiPolygon(polygons_of([area for _, area in zones])))
    near = shapely.buffer(paved, QUAY_NEAR_M)
    near = shapely.union(near, shapely.buffer(zones.area(*_QUAY_ZONES), 2.0))
    shapely.prepare(near)
    lines = []
    for water in waters:
        for ring in rings(water.area, _STEP_M):
            middle = 0.5 * (ring[1:] + ring[:-1])
            quay = shapely.contains_xy(near, middle[:, 0], middle[:, 1])
            inside = (np.abs(middle - [x0, y0]) > _BORDER_M) & (np.abs(middle - [x1, y1]) > _BORDER_M)
            for kind in (True, False):
                for a, b in runs((quay == kind) & inside.all(axis=1)):
                    lines.append(Shore(line_m=ring[a : b + 1], quay=kind, water=water))
    return lines


def bank_tops(shores: Sequence[Shore]) -> list[Array]:
    """Upper edges (N, 3) of sloping banks, which the ground meets."""
    return [
        np.column_stack([shore.line_m, np.full(len(shore.line_m), shore.water.level_m + BANK_RISE_M)])
        for shore in shores
        if not shore.quay
    ]


def add_water(
    out: MeshBuilder,
    waters: Sequence[Water],
    shores: Sequence[Shore],
    ground: Terrain,
    bridged: Area,
    lined: Area,
) -> None:
    """Adds the surfaces, banks and quays of all waters.

    Args:
        out: Where they go.
        waters: All waters.
        shores: Their shores.
        ground: Heights of the land.
        bridged: Where roads pass over the water.
        lined: Where something else keeps walkers from the water.
    """
    shapely.prepare(bridged)
    shapely.prepare(lined)
    for water in waters:
        water_surface(out, water.area, _CELL_M, water.level_m)
    for shore in shores:
        if shore.quay:
            # Below a bridge its abutment takes the quay's place.
            free = ~shapely.contains_xy(bridged, shore.line_m[:, 0], shore.line_m[:, 1])
            for a, b in runs(grown(free)):
                if b - a > 1:
                    _quay(out, shore.line_m[a:b], shore.water.level_m, ground, lined)
    for water in waters:
        _banks(out, water, [shore for shore in shores if shore.water is water and not shore.quay], ground)


def _quay(out: MeshBuilder, line: Array, level_m: float, ground: Terrain, lined: Area) -> None:
    outward = right_of(line)
    top = np.column_stack([line, ground.height(line) + COPING_M[1]])
    low = top.copy()
    low[:, 2] = level_m - 0.6
    wall, uv = extrude(low[::-1], top[::-1])
    out.quads(wall, uv_m=uv, material=Material.ASHLAR, tag=Tag.WALL, colour=(190, 186, 176))
    back = top.copy()
    back[:, :2] += outward * COPING_M[0]
    out.grid(np.stack([back, top], axis=1), material=Material.CONCRETE, tag=Tag.WALL, colour=(225, 222, 214))
    foot = back.copy()
    foot[:, 2] -= COPING_M[1] + 0.25
    step, uv = extrude(foot, back)
    out.quads(step, uv_m=uv, material=Material.CONCRETE, tag=Tag.WALL, colour=(215, 212, 204))
    # Short walls beside a bridge are its wings.
    for a, b in runs(~shapely.contains_xy(lined, line[:, 0], line[:, 1])):
        if (b - a) * _STEP_M > WING_M:
            _railing(out, top[a:b], outward[a:b])


def _railing(out: MeshBuilder, top: Array, outward: Array) -> None:
    """Posts every shore step and three rails."""
    foot = top.copy()
    foot[:, :2] += outward * 0.25
    whole = np.arange(len(top) - 1)
    look: dict[str, Any] = {"material": Material.METAL_PAINTED, "tag": Tag.FENCE, "colour": (28, 32, 34)}
    for height, half in ((RAIL_M, 0.035), (0.7, 0.02), (0.35, 0.02)):
        rail = foot + np.array([0.0, 0.0, height])
        a, b, up = rail[whole], rail[whole + 1], np.array([0.0, 0.0, half])
        side = np.column_stack([outward[whole] * half, np.zeros(len(whole))])
        for p, q in ((side - up, side + up), (-side + up, -side - up), (side + up, -side + up)):
            out.quads(np.stack([a + p, b + p, b + q, a + q], axis=1), **look)
    up = np.array([0.0, 0.0, RAIL_M])
    for stem in (np.array([0.03, 0.0, 0.0]), np.array([0.0, 0.03, 0.0])):
        a, b = foot - stem, foot + stem
        faces = np.stack([a, b, b + up, a + up], axis=1)
        out.quads(np.concatenate([faces, faces[:, ::-1]]), **look)


def _banks(out: MeshBuilder, water: Water, natural: Sequence[Shore], ground: Terrain) -> None:
    lines = [shapely.LineString(shore.line_m) for shore in natural if len(shore.line_m) > 1]
    if not lines:
        return
    rim = shapely.union_all(lines)

    def height(xy: Array) -> Array:
        share = np.clip(shapely.distance(rim, shapely.points(xy)) / BANK_M, 0.0, 1.0)
        return np.asarray((ground.height(xy) - LAP_M / 2) * (1.0 - share) + (water.level_m - 0.5) * share)

    looks = (
        (0.55 * BANK_M, 0.0, Material.GRASS, Tag.TERRAIN, (215, 215, 195)),
        (BANK_M, 0.55 * BANK_M, Material.GRAVEL, Tag.TERRAIN, (190, 175, 150)),
    )
    for outer, inner, material, tag, colour in looks:
        band = shapely.intersection(water.area, shapely.buffer(rim, outer))
        band = shapely.difference(band, shapely.buffer(rim, inner)) if inner else band
        out.sheet(areas_only(band), 2.0, height, material=material, tag=tag, colour=colour)
