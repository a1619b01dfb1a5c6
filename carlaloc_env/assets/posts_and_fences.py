"""Poles, wires, fences and delineators along roads; foot at the origin, z up."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import Look, box, extrude, lathe, placed, tube
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

POST = Look(Material.METAL_GALVANISED, Tag.POLE)
"""Zinc-coated posts of signs and lights."""


def utility_pole(height_m: float = 10.5) -> Mesh:
    """Wooden pole with a cross-arm along y; wires leave at `utility_wires_m`."""
    wood = Look(Material.WOOD, Tag.POLE, (190, 180, 170))
    arm_z = height_m - 0.6
    parts = [
        tube(wood, [(0, 0, 0), (0, 0, height_m)], [0.15, 0.10], 10),
        box(wood, (0.12, 2.2, 0.14), (0.12, 0, arm_z)),
    ]
    for y in (-1.0, -0.4, 0.4, 1.0):
        foot, head = (0.12, y, arm_z + 0.07), (0.12, y, arm_z + 0.22)
        parts.append(tube(Look(Material.PLASTIC, Tag.POLE, (70, 40, 24)), [foot, head], [0.05, 0.03], 6))
    grey, profile = (
        Look(Material.METAL_PAINTED, Tag.POLE, (120, 124, 124)),
        [(0.22, 0), (0.22, 0.75), (0.16, 0.82)],
    )
    return merge([*parts, lathe(grey, profile, 10, (0.36, 0, height_m - 2.4))])


def utility_wires_m(height_m: float = 10.5) -> NDArray[np.float64]:
    """Points at which wires leave a utility pole [m], shape (4, 3)."""
    return np.array([(0.12, y, height_m - 0.38) for y in (-1.0, -0.4, 0.4, 1.0)])


def fence(length_m: float, height_m: float, *, kind: str) -> Mesh:
    """Piece of fence along +x from the origin: iron ``bars``, wooden ``boards`` or ``rails``."""
    if kind == "bars":
        look = Look(Material.METAL_PAINTED, Tag.FENCE, (12, 14, 13))
        parts = [box(look, (length_m, 0.04, 0.04), (0.5 * length_m, 0, z)) for z in (0.12, height_m - 0.12)]
        xs = np.arange(0.06, length_m, 0.13)
        parts += [box(look, (0.022, 0.022, height_m - 0.06), (x, 0, 0.5 * height_m + 0.03)) for x in xs]
        post = (0.07, 0.07, height_m + 0.08)
        return merge([*parts, *(box(look, post, (x, 0, 0.5 * height_m + 0.04)) for x in (0.0, length_m))])
    wood = Look(Material.WOOD, Tag.FENCE)
    posts = [
        box(wood, (0.10, 0.10, height_m + 0.05), (x, 0, 0.5 * height_m)) for x in np.linspace(0, length_m, 3)
    ]
    if kind == "rails":
        size = (length_m, 0.04, 0.12)
        rails = [box(wood, size, (0.5 * length_m, 0.06, z * height_m)) for z in (0.3, 0.6, 0.9)]
        return merge([*posts, *rails])
    count = max(int(length_m / 0.16), 1)
    for k in range(count):
        size = (0.145, 0.02, height_m - 0.05 - 0.01 * (k % 3))
        posts.append(box(wood, size, (0.08 + k * length_m / count, 0.06, 0.5 * height_m + 0.03)))
    return merge(posts)


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


def delineator() -> Mesh:
    """White roadside post with a reflector, 1 m high."""
    white, reflector = (
        Look(Material.PLASTIC, Tag.POLE, (230, 230, 225)),
        Look(Material.SIGN, Tag.POLE, (230, 120, 20)),
    )
    post = extrude(white, [(-0.06, -0.06), (0.06, 0.0), (-0.06, 0.06)], 1.0)
    return merge([post, box(reflector, (0.125, 0.05, 0.18), (-0.002, 0.0, 0.78))])
