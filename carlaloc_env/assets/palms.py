"""Palms: a bare trunk with arching fronds."""

import numpy as np

from carlaloc_env.assets.leaves import (
    leaf_colours,
    leaf_mesh,
)
from carlaloc_env.assets.primitives import Look, tube
from carlaloc_env.assets.tree_forms import TreeForm
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
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
    cos_yaw, sin_yaw = elementary.cos(yaw)[:, None], elementary.sin(yaw)[:, None]
    edges = []
    for side in (-1.0, 0.0, 1.0):
        x = axis[-1, 0] + cos_yaw * along - sin_yaw * side * half
        y = axis[-1, 1] + sin_yaw * along + cos_yaw * side * half
        edges.append(np.stack([x, y, z - abs(side) * 0.45 * half], axis=-1))
    points = np.stack(edges, axis=1)
    index = np.arange(points[..., 0].size).reshape(points.shape[:3])
    near_right, far_right = index[:, :-1, :-1], index[:, :-1, 1:]
    near_left, far_left = index[:, 1:, :-1], index[:, 1:, 1:]
    corners = [near_right, far_right, far_left, near_right, far_left, near_left]
    triangles = np.stack(corners, axis=-1).reshape(-1, 3)
    colour = np.repeat(leaf_colours(form.tint, (0.7 + 0.3 * share)[:, None]), index[0].size, axis=0)
    return merge([stem, leaf_mesh(points, triangles, points[..., :2], colour)])
