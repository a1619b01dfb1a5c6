"""Palms: a bare trunk with arching fronds."""

from __future__ import annotations

import numpy as np

from carlaloc_env.assets.modelling.primitives import Look, tube
from carlaloc_env.assets.vegetation.foliage import GREEN
from carlaloc_env.assets.vegetation.tree_species import TreeForm
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, make_mesh, merge
from carlaloc_env.scene.semantic_tags import Tag


def palm(
    form: TreeForm, rng: np.random.Generator, height: float, crown: float, trunk: float, detail: str
) -> Mesh:
    """A bare, slightly bent trunk with arching fronds."""
    lean = rng.normal(0.0, 0.05 * height, 2)
    top = height - 0.12 * crown
    t = np.linspace(0.0, 1.0, 6)
    axis = np.stack([lean[0] * t**2, lean[1] * t**2, top * t], axis=-1)
    radii = 0.5 * trunk * np.array([1.5, 1.05, 0.95, 0.9, 0.85, 1.0])
    sides = 9 if detail == "high" else 4
    bark = Look(Material.BARK, Tag.VEGETATION, form.bark)
    stem = tube(bark, axis, radii, sides, crease_deg=60.0)
    fronds = form.branches if detail == "high" else form.branches // 3
    width = 0.62 * form.branches / fronds
    share = (np.arange(fronds) + 0.5) / fronds
    # Both levels of detail draw as many numbers, so that the same seed stays the same tree.
    noise = rng.normal(0.0, 0.1, (form.branches, 2))[:fronds]
    yaw = 2.4 * np.arange(fronds) + noise[:, 0]
    reach = 0.5 * crown * (1.0 + noise[:, 1])
    rise = np.where(share > 0.35, 1.1 * share, -0.35)
    s = np.linspace(0.0, 1.0, 9 if detail == "high" else 6)
    along = reach[:, None] * s
    z = top + reach[:, None] * (rise[:, None] * s - (0.75 + 0.35 * rise[:, None]) * s**2)
    half = 0.5 * width * elementary.sin(np.pi * np.clip(0.12 + 0.88 * s, 0, 1)) + 0.02
    c, sn = elementary.cos(yaw)[:, None], elementary.sin(yaw)[:, None]
    grids = []
    for side in (-1.0, 0.0, 1.0):
        x = axis[-1, 0] + c * along - sn * side * half
        y = axis[-1, 1] + sn * along + c * side * half
        grids.append(np.stack([x, y, z - abs(side) * 0.45 * half], axis=-1))
    points = np.stack(grids, axis=1)
    count, n = fronds, len(s)
    index = np.arange(count * 3 * n).reshape(count, 3, n)
    a, b, d, e = index[:, :-1, :-1], index[:, :-1, 1:], index[:, 1:, 1:], index[:, 1:, :-1]
    triangles = np.stack([np.stack([a, b, d], -1), np.stack([a, d, e], -1)], -2).reshape(-1, 3)
    colour = np.clip(np.array(form.tint) * GREEN * (0.7 + 0.3 * share)[:, None], 0, 255).astype(np.uint8)
    leaves = make_mesh(
        points.reshape(-1, 3),
        triangles,
        material=Material.LEAF,
        tag=Tag.VEGETATION,
        uv_m=points.reshape(-1, 3)[:, :2],
        colour=np.repeat(colour, 3 * n, axis=0),
    )
    return merge([stem, leaves])
