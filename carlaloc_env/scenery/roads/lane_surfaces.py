"""Surfaces of roads outside junctions: lanes with wheel tracks and castings, and skirts along outer edges."""

import itertools
from collections.abc import Sequence

import numpy as np

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import interpolated
from carlaloc_env.map.opendrive.crossfall import GUTTER_M
from carlaloc_env.map.opendrive.records import Road
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.lane_strips import Strip
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, extrude
from carlaloc_env.scenery.roads.fast_roads import FAST_SURFACE, is_fast

TRACKS = np.array([0.0, 0.02, 0.23, 0.40, 0.5, 0.60, 0.77, 0.98, 1.0])
"""Columns across a driving lane, as shares of its width: wheel tracks near 0.23 and 0.77."""
TRACK_SHADE = np.array([0.84, 0.99, 0.93, 1.0, 0.96, 1.0, 0.93, 0.99, 0.84])
"""Brightness of each column: joints between lanes, tracks polished by tyres, oil in the middle."""
TRACK_BARE = np.array([0.80, 0.84, 1.0, 0.88, 0.80, 0.88, 1.0, 0.84, 0.80])
"""The same of unpaved lanes: wheels keep their tracks bare and light."""
OIL_M, OIL_SHADE = 14.0, 0.86
"""Length before a stop on which waiting cars drip oil [m], and brightness of the middle there."""
CASTING_M = (45.0, 140.0)
"""Shortest and longest stretch that is laid in one go [m]."""
CASTING_TONE = 0.035
"""Deviation of the brightness of one lane of one casting."""
LOOSE: dict[str, tuple[Material, tuple[float, float, float]]] = {
    "gravel": (Material.GRAVEL, (232.0, 222.0, 200.0)),
    "soil": (Material.SOIL, (235.0, 225.0, 205.0)),
    "grass": (Material.GRASS, (225.0, 222.0, 190.0)),
}
"""Material and tint of unpaved lanes."""
UNDRIVEN = ("shoulder", "parking")
"""Lanes without wheel tracks."""
SKIRT_M = 0.4
"""How far outer edges reach down, so that no gap to the ground can open [m]."""


def add_roads(out: MeshBuilder, strips: Sequence[Strip], roads: Sequence[Road], seed: int) -> None:
    """Adds the surfaces of all strips outside junctions."""
    for strip in strips:
        if strip.junction_id is not None:
            continue
        draw = clock.stream(seed, f"road/{strip.road_id}/{strip.section}")
        paving = Material.ASPHALT_OLD if draw.random() < 0.35 else Material.ASPHALT
        driven = FAST_SURFACE if is_fast(roads[strip.road]) else paving
        base = draw.uniform(215, 245)
        ends = casting_ends(strip, seed)
        for lane in range(len(strip.lanes)):
            if strip.kind(lane) == "roadway":
                shoulder = strip.lanes[lane].type in UNDRIVEN
                _lane_surface(out, strip, lane, base, draw, paving if shoulder else driven, ends)
        _outer_skirts(out, strip)


def casting_ends(strip: Strip, seed: int) -> Array:
    """Stations at which the surface of a road was laid on at another time [m], shape (K,)."""
    draw = clock.stream(seed, f"castings/{strip.road_id}/{strip.section}")
    first, last = strip.s_m[0], strip.s_m[-1]
    ends = first + np.cumsum(draw.uniform(*CASTING_M, int((last - first) / CASTING_M[0]) + 1))
    result: Array = ends[ends < last - 0.3 * CASTING_M[0]]
    return result


def _lane_surface(
    out: MeshBuilder,
    strip: Strip,
    lane: int,
    base: float,
    draw: np.random.Generator,
    material: Material,
    ends_m: Array,
) -> None:
    driven = strip.lanes[lane].type not in UNDRIVEN
    share = TRACKS if driven else np.array([0.0, 1.0])
    loose = strip.unpaved(lane)
    colour = np.full(3, 255.0)
    if loose:
        material, colour = LOOSE[loose][0], np.array(LOOSE[loose][1])
    elif is_gutter(strip, lane):
        material, colour = Material.CONCRETE, np.array((190.0, 188.0, 182.0))
    s, points = _across(strip, lane, share, ends_m)
    width = np.interp(s, strip.s_m, strip.t_m[lane] - strip.t_m[lane + 1])
    t = np.interp(s, strip.s_m, strip.t_m[lane + 1])[:, None] + share * width[:, None]
    uv = np.stack(np.broadcast_arrays(t, s[:, None]), axis=-1)
    shade = _shade(strip, lane, s, loose=bool(loose)) if driven else np.array([[0.96, 0.9]])
    for first, last in itertools.pairwise([0, *np.searchsorted(s, ends_m), len(s) - 1]):
        rows = slice(first, last + 1)
        tint = np.broadcast_to(base * (1.0 + CASTING_TONE * draw.standard_normal()) * shade, t.shape)[rows]
        colours = np.clip(tint[:, :, None], 0, 255) / 255.0 * colour
        out.grid(points[rows], material=material, tag=Tag.ROAD, uv_m=uv[rows], colour=colours)


def _across(strip: Strip, lane: int, share: Array, ends_m: Array) -> tuple[Array, Array]:
    """Stations (R,) and points (R, C, 3) of a lane at shares of its width, ends of castings among them."""
    left, right = strip.lane_edges(lane)
    s = np.union1d(strip.s_m, ends_m)
    a, b = (interpolated(s, strip.s_m, edge) for edge in (left, right))
    return s, b[:, None] + share[None, :, None] * (a - b)[:, None]


def _shade(strip: Strip, lane: int, s: Array, *, loose: bool) -> Array:
    """Brightness of a driving lane at stations (R,) and in its columns, shape (R, C)."""
    shade = np.tile(TRACK_BARE if loose else TRACK_SHADE, (len(s), 1))
    if not loose:
        stop = strip.s_m[-1] if strip.forward(lane) else strip.s_m[0]
        near = np.clip(1.0 - np.abs(s - stop) / OIL_M, 0.0, 1.0)
        shade[:, len(TRACKS) // 2] += (OIL_SHADE - shade[:, len(TRACKS) // 2]) * near
    return shade


def is_gutter(strip: Strip, lane: int) -> bool:
    """Whether a lane is the narrow strip along a kerb in which water runs."""
    if strip.lanes[lane].type != "shoulder" or strip.unpaved(lane):
        return False
    beside = [other for other in (lane - 1, lane + 1) if 0 <= other < len(strip.lanes)]
    width = strip.t_m[lane] - strip.t_m[lane + 1]
    return float(width.max()) <= GUTTER_M and any(strip.kind(other) == "sidewalk" for other in beside)


def _outer_skirts(out: MeshBuilder, strip: Strip) -> None:
    for lane, side in _outer_lanes(strip):
        edge = strip.lane_edges(lane)[0 if side > 0 else 1]
        if strip.kind(lane) == "roadway":
            low = edge - np.array([0.0, 0.0, SKIRT_M])
            # The outside lies left of the left edge and right of the right edge.
            line, top = (low[::-1], edge[::-1]) if side > 0 else (low, edge)
            corners, uv = extrude(line, top)
            out.quads(corners, uv_m=uv, material=Material.GRAVEL, tag=Tag.ROAD)


def _outer_lanes(strip: Strip) -> list[tuple[int, int]]:
    """Lanes at whose left (+1) or right (−1) edge the paved part of the strip ends."""
    kinds = [strip.kind(lane) for lane in range(len(strip.lanes))]
    outer = []
    for lane, kind in enumerate(kinds):
        if kind == "none":
            continue
        if lane == 0 or kinds[lane - 1] == "none":
            outer.append((lane, 1))
        if lane == len(kinds) - 1 or kinds[lane + 1] == "none":
            outer.append((lane, -1))
    return outer


def add_plain_lanes(out: MeshBuilder, strips: Sequence[Strip]) -> None:
    """Road lanes outside junctions, one quad per step: the same surface as the seen one."""
    for strip in strips:
        if strip.junction_id is not None:
            continue
        for lane in range(len(strip.lanes)):
            if strip.kind(lane) == "roadway":
                left, right = strip.lane_edges(lane)
                out.grid(np.stack([right, left], axis=1), material=Material.ASPHALT, tag=Tag.ROAD)
