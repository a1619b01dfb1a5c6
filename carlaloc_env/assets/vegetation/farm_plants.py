"""Small things of the countryside: plants of a field, bales, pasture fences."""

from __future__ import annotations

import numpy as np

from carlaloc_env.assets.modelling.primitives import Look, box, lathe, placed
from carlaloc_env.assets.vegetation.foliage import leaf_colours, separate_leaves
from carlaloc_env.assets.vegetation.shrubs import tufts
from carlaloc_env.core import elementary
from carlaloc_env.core.clock import stream
from carlaloc_env.scene.materials import Material, Tag
from carlaloc_env.scene.mesh import Colour, Mesh, merge


def stalks(seed: int, height_m: float, tint: Colour) -> Mesh:
    """A handful of cereal stalks."""
    return tufts(seed, 14, 0.42, height_m, tint, blade_m=0.06, spread=0.16)


def maize(seed: int, tint: Colour) -> Mesh:
    """A maize plant, 2.2 m high: a stem and arching leaves of two triangles each."""
    rng = stream(seed, "maize")
    leaves = 8
    yaw = np.pi * np.arange(leaves) + rng.normal(0.0, 0.5, leaves)
    z = np.linspace(0.35, 1.75, leaves)
    reach = 0.55 * (1.0 - 0.45 * (z / 2.0 - 0.4) ** 2) * rng.uniform(0.8, 1.15, leaves)
    out = np.stack([elementary.cos(yaw), elementary.sin(yaw), np.zeros(leaves)], axis=-1)
    side = 0.06 * np.stack([-elementary.sin(yaw), elementary.cos(yaw), np.zeros(leaves)], axis=-1)
    base = np.column_stack([np.zeros((leaves, 2)), z])
    bend = base + out * 0.5 * reach[:, None] + [0.0, 0.0, 0.34]
    tip = base + out * reach[:, None] + [0.0, 0.0, 0.02]
    upper = np.stack([bend - side, bend + side, tip], axis=1)
    lower = np.stack([base, bend + side, bend - side], axis=1)
    stem = [[(-0.03, 0, 0), (0.03, 0, 0), (0, 0, 2.15)], [(0, -0.03, 0), (0, 0.03, 0), (0, 0, 2.15)]]
    corners = np.concatenate([lower, upper, stem])
    count = len(corners)
    colour = leaf_colours(tint, rng.uniform(0.7, 1.0, (count, 1)))
    return separate_leaves(
        corners, rng.uniform(0, 1, (3 * count, 2)), colour, np.tile([0.0, 0.0, 1.0], (count, 1))
    )


def bale() -> Mesh:
    """Round bale of hay, 1.5 m across and 1.2 m long, lying along y."""
    straw = Look(Material.CROP, Tag.DYNAMIC, (255, 225, 150))
    body = lathe(straw, [(0.70, -0.6), (0.75, -0.5), (0.75, 0.5), (0.70, 0.6)], 14)
    turned = body.vertices_m[:, [0, 2, 1]].astype(np.float64) * np.array([1.0, -1.0, 1.0]) + [0.0, 0.0, 0.72]
    normals = body.normals[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0], np.float32)
    return straw.mesh(turned, body.triangles, body.uv_m, normals)


def fence_panel() -> Mesh:
    """Post and two rails of 3 m along +x from the origin, 1.15 m high."""
    wood = Look(Material.WOOD, Tag.FENCE, (225, 220, 210))
    parts = [box(wood, (0.12, 0.12, 1.3), (0.0, 0.0, 0.55))]
    for z in (0.45, 0.95):
        parts.append(box(wood, (3.0, 0.05, 0.11), (1.5, 0.07, z)))
    return merge(parts)


def picket_panel(length_m: float) -> Mesh:
    """White pickets along +x from the origin, 0.95 m high."""
    paint = Look(Material.SIDING, Tag.FENCE, (255, 255, 250))
    parts = [box(paint, (length_m, 0.03, 0.07), (0.5 * length_m, -0.025, z)) for z in (0.25, 0.7)]
    parts.append(box(paint, (0.10, 0.10, 1.05), (0.0, -0.03, 0.5)))
    for x in np.arange(0.14, length_m - 0.05, 0.16):
        parts.append(placed(box(paint, (0.085, 0.02, 0.86)), (x, 0.0, 0.5)))
    return merge(parts)
