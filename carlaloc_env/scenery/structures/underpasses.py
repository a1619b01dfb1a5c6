"""Walls, roofs and lamps of roads that run below the ground."""

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.ground.cuttings import ROOF_M
from carlaloc_env.scenery.ground.grade_graph import grown, runs
from carlaloc_env.scenery.ground.grade_levels import WALL_M, Levels, Stretch
from carlaloc_env.scenery.ground.road_edges import rows_every
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, extrude
from carlaloc_env.scenery.structures.underpass_fittings import add_fittings

PARAPET_M = 0.95
"""Height of walls and rails above the ground beside a cut [m]."""
BUTTRESS_STEP_M = 6.0
"""Distance of the buttresses of a retaining wall and of the beams of a roof [m]."""
_BUTTRESS_WIDTH_M, _BUTTRESS_DEPTH_M = 0.7, 0.3
_BEAM_WIDTH_M, _BEAM_DEPTH_M = 0.5, 0.3
_GREY = (228, 226, 220)


def add_underpasses(out: MeshBuilder, levels: Levels) -> Array:
    """Walls and roofs of all sunken stretches; gives the places of lamps under roofs [m], shape (K, 3)."""
    return np.concatenate([np.zeros((0, 3)), *(_underpass(out, stretch) for stretch in levels.stretches)])


def _underpass(out: MeshBuilder, stretch: Stretch) -> Array:
    down = np.array([0.0, 0.0, 0.35])
    up = np.array([0.0, 0.0, PARAPET_M])
    outward = _outward(stretch)
    roof_z = _roof_height(stretch)
    for edge, top, sign in (
        (stretch.left_m, stretch.left_top_m, 1.0),
        (stretch.right_m, stretch.right_top_m, -1.0),
    ):
        head = top.copy()
        head[:, 2] = np.where(stretch.detached, np.minimum(roof_z + 0.02, top[:, 2]), top[:, 2])
        _face(out, edge - down, head, sign, Material.CONCRETE_PANEL, Tag.WALL)
        _buttresses(out, stretch, edge - down, head, sign)
        open_cut = grown(~stretch.detached) & (top[:, 2] - edge[:, 2] > 0.3)
        for a, b in runs(open_cut):
            if b - a < 2:
                continue
            inner, outer = top[a:b], top[a:b] + sign * WALL_M * outward[a:b]
            _face(out, inner, inner + up, sign, Material.CONCRETE, Tag.WALL)
            _face(out, outer - 2 * down, outer + up, -sign, Material.CONCRETE, Tag.WALL)
            rows = (outer, inner) if sign > 0 else (inner, outer)
            out.grid(
                np.stack([rows[1] + up, rows[0] + up], axis=1),
                material=Material.CONCRETE,
                tag=Tag.WALL,
                colour=_GREY,
            )
    lamps = [np.zeros((0, 3))]
    for a, b in runs(stretch.detached):
        if b - a > 1:
            _roof(out, stretch, roof_z, a, b)
            at = rows_every(BUTTRESS_STEP_M, roof_z, 1)
            lamps.append(add_fittings(out, stretch, roof_z, slice(a, b), outward, at))
    return np.concatenate(lamps)


def _buttresses(out: MeshBuilder, stretch: Stretch, foot: Array, head: Array, sign: float) -> None:
    """Shallow buttresses before a retaining wall: what a LiDAR can hold on to along a smooth cut."""
    rows = rows_every(BUTTRESS_STEP_M, foot, 1)
    rows = rows[head[rows, 2] - foot[rows, 2] > 1.0]
    along = _ahead(stretch) * 0.5 * _BUTTRESS_WIDTH_M
    inward = -sign * _outward(stretch) * _BUTTRESS_DEPTH_M
    for row in rows:
        step, deep = along[row], inward[row]
        outline = np.array([-step, -step + deep, step + deep, step])
        low, high = foot[row] + outline, head[row] + outline
        _face(out, low, high, sign, Material.CONCRETE, Tag.WALL)
        lid = high if sign > 0 else high[::-1]
        out.quads(lid[None], material=Material.CONCRETE, tag=Tag.WALL, colour=_GREY)


def _beams(out: MeshBuilder, stretch: Stretch, left: Array, right: Array, a: int) -> None:
    """Beams across the underside of a roof."""
    rows = np.arange(int(BUTTRESS_STEP_M), len(left) - 2, int(BUTTRESS_STEP_M))
    if not len(rows):
        return
    step = _ahead(stretch)[a + rows] * 0.5 * _BEAM_WIDTH_M
    down = np.array([0.0, 0.0, _BEAM_DEPTH_M])
    high_l, high_r = left[rows], right[rows]
    low_l, low_r = high_l - down, high_r - down
    faces = [
        np.stack([low_l - step, low_r - step, high_r - step, high_l - step], axis=1),
        np.stack([low_r + step, low_l + step, high_l + step, high_r + step], axis=1),
        np.stack([low_l - step, low_l + step, low_r + step, low_r - step], axis=1),
    ]
    out.quads(np.concatenate(faces), material=Material.CONCRETE, tag=Tag.BRIDGE, colour=_GREY)


def _roof(out: MeshBuilder, stretch: Stretch, roof_z: Array, a: int, b: int) -> None:
    left, right = stretch.left_m[a:b].copy(), stretch.right_m[a:b].copy()
    left[:, 2], right[:, 2] = roof_z[a:b], roof_z[a:b]
    out.grid(
        np.stack([left, right], axis=1),
        material=Material.CONCRETE_PANEL,
        tag=Tag.BRIDGE,
        colour=_GREY,
    )
    _beams(out, stretch, left, right, a)
    for row, sign in ((a, -1.0), (b - 1, 1.0)):
        low_l, low_r = stretch.left_m[row].copy(), stretch.right_m[row].copy()
        low_l[2] = low_r[2] = roof_z[row] - 0.05
        high_l, high_r = stretch.left_top_m[row].copy(), stretch.right_top_m[row].copy()
        high_l[2] += PARAPET_M
        high_r[2] += PARAPET_M
        ahead = _ahead(stretch)[row] * 0.3 * sign
        front = np.array([low_l, low_r, high_r, high_l]) + ahead
        back = np.array([low_r, low_l, high_l, high_r]) - ahead
        lid = np.array([front[3], front[2], back[2], back[3]])
        soffit = np.array([front[1], front[0], back[1], back[0]])
        faces = np.stack([front, back, lid, soffit])
        faces = faces if sign < 0 else faces[:, ::-1]
        out.quads(faces, material=Material.CONCRETE, tag=Tag.BRIDGE, colour=_GREY)


def _face(out: MeshBuilder, low: Array, high: Array, sign: float, material: Material, tag: Tag) -> None:
    """Upright faces; +1 looks to the right of the line, −1 to the left."""
    line, top = (low, high) if sign > 0 else (low[::-1], high[::-1])
    corners, uv = extrude(line, top)
    out.quads(corners, uv_m=uv, material=material, tag=tag, colour=_GREY)


def _roof_height(stretch: Stretch) -> Array:
    """Underside of the roof [m], shape (N,)."""
    return np.minimum(stretch.left_top_m[:, 2], stretch.right_top_m[:, 2]) - ROOF_M


def _outward(stretch: Stretch) -> Array:
    """Unit vectors to the left of the stretch, shape (N, 3)."""
    across = stretch.left_m - stretch.right_m
    across[:, 2] = 0.0
    result: Array = across / np.sqrt(np.sum(across**2, axis=1, keepdims=True))
    return result


def _ahead(stretch: Stretch) -> Array:
    left = _outward(stretch)
    return np.stack([left[:, 1], -left[:, 0], np.zeros(len(left))], axis=-1)
