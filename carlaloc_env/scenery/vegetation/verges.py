"""The verges of motorways: noise barriers, grass banks with bushes, rows of trees, and open stretches."""

from functools import partial

import numpy as np

from carlaloc_env.assets.billboards import billboard
from carlaloc_env.core import clock, elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.polylines import densify
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.building_lots import frontages
from carlaloc_env.scenery.ground.land import Land
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, extrude
from carlaloc_env.scenery.meshing.props import PropField
from carlaloc_env.scenery.vegetation.planting import put_bushes, put_trees, rights

STRETCH_M = (70.0, 190.0)
"""Length of one kind of wayside [m]."""
KINDS = ("barrier", "bank", "open", "bank", "trees")
"""Kinds of wayside."""
BARRIER_M, PANEL_M, HIGH_M = 4.5, 4.0, 3.6
"""Distance of noise barriers from the road's edge, length of a panel, and their height [m]."""
BANK = ((3.0, -0.25), (5.5, 0.7), (8.5, 1.9), (11.0, 2.1), (13.5, 1.2), (17.0, -0.25))
"""Cross-section of a bank: distance from the road's edge and height over the ground [m]."""
BILLBOARD_STEP_M = 260.0
"""Least distance of two billboards [m]."""
_WALLS = (
    (Material.CONCRETE_PANEL, (255, 250, 240)),
    (Material.WOOD, (230, 225, 215)),
    (Material.SHEET_METAL, (130, 165, 140)),
    (Material.CONCRETE_PANEL, (205, 185, 160)),
)


def line_highways(raised: MeshBuilder, solid: MeshBuilder, props: PropField, land: Land) -> None:
    """Line all roads of highway zones.

    Args:
        raised: Takes banks, which are ground.
        solid: Takes noise barriers for collisions; they are seen through `raised`.
        props: Takes bushes, trees and billboards.
        land: The town's land.
    """
    boards: list[Array] = []
    streets = [strip for strip in land.strips if strip.junction_id is None]
    for street, (name, line, _) in ((strip, edge) for strip in streets for edge in frontages([strip])):
        if len(line) < 20:
            continue
        even = densify(line, 1.0)
        if (land.zones.kinds_at(even) == "highway").mean() < 0.5:
            continue
        draw = clock.stream(land.seed, f"wayside/{name}")
        at = 0
        while at < len(even) - 12:
            end = min(at + int(draw.uniform(*STRETCH_M)), len(even) - 1)
            kind = KINDS[int(draw.integers(len(KINDS)))]
            part = even[at : end + 1]
            right = rights(part)
            if kind == "barrier":
                _barrier(raised, solid, land, part, right, draw)
            elif kind == "bank":
                put_bushes(props, _bank(raised, land, part, right, draw), draw)
            elif kind == "trees":
                _trees(props, land, part, right, draw)
            _board(props, land, part, right, boards, draw, left_hand_traffic=street.left_hand_traffic)
            at = end


def _trees(props: PropField, land: Land, line: Array, right: Array, draw: np.random.Generator) -> None:
    """Two rows of trees."""
    for distance in (9.5, 15.0):
        rows = np.arange(int(draw.integers(0, 4)), len(line), 8)
        xy = line[rows, :2] + right[rows] * (distance + draw.uniform(-0.8, 0.8, len(rows)))[:, None]
        xy = xy[land.taken.distance_m(xy) > 6.0]
        put_trees(land, props, ("birch", "poplar", "conifer", "plane"), land.on_ground(xy, -0.05), draw)


def _barrier(
    out: MeshBuilder, solid: MeshBuilder, land: Land, line: Array, right: Array, draw: np.random.Generator
) -> None:
    """Panels between posts; panels that would stand on something are left out."""
    material, tint = _WALLS[int(draw.integers(len(_WALLS)))]
    rows = np.arange(0, len(line), int(PANEL_M))
    xy = line[rows, :2] + right[rows] * BARRIER_M
    bases_m = land.on_ground(xy)
    middle = (xy[:-1] + xy[1:]) / 2
    clear = land.taken.distance_m(np.concatenate([xy, middle])) > 2.4
    good = clear[: len(xy) - 1] & clear[1 : len(xy)] & clear[len(xy) :]
    length = np.sqrt(np.sum(np.diff(xy, axis=0) ** 2, axis=1))
    good &= (length > 1.5) & (length < 2.0 * PANEL_M)
    for k in np.flatnonzero(good):
        pair = bases_m[k : k + 2]
        normal = right[rows[k]] * 0.08
        shade = tuple(int(v * draw.uniform(0.86, 1.0)) for v in tint)
        for side, order in ((-normal, slice(None)), (normal, slice(None, None, -1))):
            base = pair[order] + np.append(side, -0.3)
            top = base.copy()
            top[:, 2] = pair[order][:, 2] + HIGH_M
            # The line has its free side, and so this face's back, on the right.
            corners, uv = extrude(base[::-1], top[::-1])
            uv += np.array([7.0 * k, 0.0])
            out.quads(corners, material=material, tag=Tag.WALL, uv_m=uv, colour=shade)
            solid.quads(corners, material=Material.PLAIN, tag=Tag.WALL)
        lid = np.array([[*(pair[0][:2] - normal), 0], [*(pair[0][:2] + normal), 0],
                        [*(pair[1][:2] + normal), 0], [*(pair[1][:2] - normal), 0]])  # fmt: skip
        lid[:, 2] = np.repeat(pair[:, 2], 2) + HIGH_M
        out.quads(lid[None, ::-1], material=Material.CONCRETE, tag=Tag.WALL)
        _post(out, pair[0], right[rows[k]])


def _post(out: MeshBuilder, base_m: Array, right: Array) -> None:
    along = np.array([-right[1], right[0]])
    ring = [right * a + along * b for a, b in ((-0.16, -0.12), (-0.16, 0.12), (0.16, 0.12), (0.16, -0.12))]
    xy = base_m[:2] + np.array(ring)
    area2 = np.sum(xy[:, 0] * np.roll(xy[:, 1], -1) - xy[:, 1] * np.roll(xy[:, 0], -1))
    xy = xy if area2 > 0 else xy[::-1]
    low = np.column_stack([xy, np.full(4, base_m[2] - 0.3)])
    high = np.column_stack([xy, np.full(4, base_m[2] + HIGH_M + 0.12)])
    faces = np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1)
    out.quads(np.concatenate([faces, high[None]]), material=Material.METAL_GALVANISED, tag=Tag.WALL)


def _bank(out: MeshBuilder, land: Land, line: Array, right: Array, draw: np.random.Generator) -> Array:
    """A grass bank along the line; returns places for bushes on it [m], (K, 3)."""
    rows = np.arange(0, len(line), 3)
    offsets = np.array([b[0] for b in BANK])
    heights = np.array([b[1] for b in BANK])
    xy = line[rows, None, :2] + right[rows, None] * offsets[None, :, None]
    clear = land.taken.distance_m(xy[:, 1:].reshape(-1, 2)).reshape(len(rows), -1)
    good = (clear > np.minimum(offsets[1:] - 1.5, 3.0)).all(axis=1)
    # The bank rises and ends over three cross-sections.
    grow = elementary.convolve(good.astype(float), np.ones(5) / 5.0, mode="same") * good
    grow = np.where(elementary.convolve(good, np.ones(3), mode="same") >= 2, grow, 0.0)
    grow[[0, -1]] = 0.0
    if (grow > 0).sum() < 4:
        return np.zeros((0, 3))
    wave = 1.0 + 0.15 * elementary.sin(0.7 * rows / 3.0)
    z = land.ground.height(xy.reshape(-1, 2)).reshape(len(rows), -1)
    z = z + np.where(heights > 0, heights * (grow * wave)[:, None], heights)
    z = np.where(grow[:, None] > 0, z, z - 0.5)
    points = np.concatenate([xy, z[..., None]], axis=-1)
    bend = np.sqrt(np.sum(np.diff(xy[:, -1], axis=0) ** 2, axis=-1))
    if (bend < 0.3).any() or (bend > 12.0).any():
        return np.zeros((0, 3))
    out.grid(points, material=Material.GRASS, tag=Tag.TERRAIN, colour=(235, 235, 205))
    picks = draw.integers(0, len(rows), len(rows)), draw.uniform(5.0, 13.0, len(rows))
    base_m = line[rows[picks[0]], :2] + right[rows[picks[0]]] * picks[1][:, None]
    level = np.interp(picks[1], offsets, heights) * grow[picks[0]] * wave[picks[0]]
    ok = grow[picks[0]] > 0.5
    return np.asarray(
        land.on_ground(base_m[ok]) + np.column_stack([np.zeros((ok.sum(), 2)), level[ok] - 0.1])
    )


def _board(
    props: PropField,
    land: Land,
    line: Array,
    right: Array,
    boards: list[Array],
    draw: np.random.Generator,
    *,
    left_hand_traffic: bool,
) -> None:
    """At most one billboard on a stretch, turned towards those who come."""
    row = len(line) // 2
    away = right[row]
    base_m = land.on_ground((line[row, :2] + away * float(draw.uniform(13.0, 17.0)))[None])[0]
    if land.taken.distance_m(base_m[None, :2])[0] < 6.0 or draw.random() < 0.35:
        return
    if any(np.hypot(*(base_m - other)[:2]) < BILLBOARD_STEP_M for other in boards):
        return
    boards.append(base_m)
    # Traffic on the right comes along the line, whose free side is on its right; on the left, against it.
    yaw = elementary.arctan2(-away[1], -away[0]) + (-0.9 if left_hand_traffic else 0.9)
    variant = int(draw.integers(0, 8))
    props.put(("billboard", variant), partial(billboard, variant), base_m[None], yaw)
