"""What crowns are made of: leaf triangles, and clumps that stand for many leaves close together."""

from __future__ import annotations

import numpy as np

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.geometry.transforms import cross
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, make_mesh
from carlaloc_env.scene.semantic_tags import Tag

LeafTint = tuple[int, int, int]
"""LeafTint relative to a green leaf; parts of yellow and red leaves may exceed 255."""
GREEN = np.array([0.65, 0.82, 0.84])
"""What a green leaf keeps of the texture's colour, which leaves room for leaves that are not green."""

_GOLDEN = (1.0 + np.sqrt(5.0)) / 2.0
_CORNERS = np.array(
    [
        (-1, _GOLDEN, 0), (1, _GOLDEN, 0), (-1, -_GOLDEN, 0), (1, -_GOLDEN, 0), (0, -1, _GOLDEN),
        (0, 1, _GOLDEN), (0, -1, -_GOLDEN), (0, 1, -_GOLDEN), (_GOLDEN, 0, -1), (_GOLDEN, 0, 1),
        (-_GOLDEN, 0, -1), (-_GOLDEN, 0, 1),
    ]
) / np.sqrt(1.0 + _GOLDEN**2)  # fmt: skip
_FACES = np.array(
    [
        (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
        (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5), (2, 4, 11),
        (6, 2, 10), (8, 6, 7), (9, 8, 1),
    ]
)  # fmt: skip
"""The icosahedron with unit circumradius: 12 corners, 20 faces seen anticlockwise from outside."""
CLUMP_AREA = 9.5745
"""Surface of that icosahedron."""
TRIANGLE_AREA = 0.4330
"""Area of an equilateral triangle with unit edge."""
LONG = 1.3
"""How much longer than equilateral leaf triangles are, and how much narrower."""


def directions(rng: np.random.Generator, count: int) -> Array:
    """Evenly distributed unit vectors, shape (count, 3)."""
    vector = rng.normal(size=(count, 3))
    return np.asarray(vector / np.sqrt(np.sum(vector * vector, axis=-1, keepdims=True)))


def leaf_triangles(
    rng: np.random.Generator,
    points: Array,
    out: Array,
    size: Array,
    tint: LeafTint,
    shade: Array | float = 1.0,
) -> Mesh:
    """One leaf triangle at each point, facing roughly outwards, with normals bent outwards.

    Args:
        rng: Randomness.
        points: Middles of the triangles [m], shape (N, 3).
        out: Unit vectors away from the middle of the crown, shape (N, 3).
        size: Edges [m], shape (N,).
        tint: Linear tint.
        shade: Factor on the tint, a number or shape (N,).
    """
    count = len(points)
    normal = 0.7 * out + 0.9 * directions(rng, count)
    normal = _unit(normal)
    across = _unit(cross(normal, directions(rng, count)))
    other = cross(normal, across)
    angle = 2 * np.pi * np.arange(3) / 3
    corner = LONG * elementary.cos(angle)[None, :, None] * across[:, None]
    corner = corner + elementary.sin(angle)[None, :, None] * other[:, None] / LONG
    vertices = points[:, None] + 0.577 * size[:, None, None] * corner
    bent = _unit(0.5 * normal + 0.5 * out)
    light = rng.uniform(0.72, 1.0, (count, 1)) * np.clip(rng.normal(1.0, 0.06, (count, 3)), 0.8, 1.2)
    light = light * np.broadcast_to(shade, (count,))[:, None]
    colour = np.clip(np.array(tint) * GREEN * light, 0, 255).astype(np.uint8)
    uv = rng.uniform(0, 1, (count, 1, 2)) + 0.5 * size[:, None, None] * np.stack(
        [elementary.cos(angle), elementary.sin(angle)], -1
    )
    return make_mesh(
        vertices.reshape(-1, 3),
        np.arange(3 * count).reshape(-1, 3),
        material=Material.LEAF,
        tag=Tag.VEGETATION,
        uv_m=uv.reshape(-1, 2),
        normals=np.repeat(bent, 3, axis=0),
        colour=np.repeat(colour, 3, axis=0),
    )


def clumps(
    rng: np.random.Generator,
    centres: Array,
    radii: Array,
    middle: Array,
    tint: LeafTint,
    *,
    squash: float = 0.8,
    ragged: float = 0.28,
) -> Mesh:
    """Uneven bodies of leaves, dark towards the middle of the crown and below.

    Args:
        rng: Randomness.
        centres: Middles [m], shape (N, 3).
        radii: Radii [m], shape (N,).
        middle: Middle of the crown [m], shape (3,).
        tint: Linear tint.
        squash: Height over width.
        ragged: How much corners stand out or in, as a share of the radius.
    """
    count = len(centres)
    bump = 1.0 + ragged * rng.uniform(-1.0, 1.0, (count, 12, 1))
    turned = _turned(rng, count)
    local = turned * bump * radii[:, None, None] * np.array([1.0, 1.0, squash])
    vertices = centres[:, None] + local
    away = _unit(vertices - middle)
    normals = _unit(0.55 * _unit(local) + 0.45 * away)
    span = float(np.max(np.sqrt(np.sum((centres - middle) ** 2, axis=-1)))) + 1e-6
    height = (centres[:, 2] - middle[2]) / span
    depth = np.sqrt(np.sum((centres - middle) ** 2, axis=-1)) / span
    shade = np.clip(0.62 + 0.22 * depth + 0.20 * height, 0.4, 1.0)[:, None] * rng.uniform(
        0.8, 1.0, (count, 12)
    )
    hue = np.clip(rng.normal(1.0, 0.05, (count, 1, 3)), 0.85, 1.15)
    colour = np.clip(np.array(tint) * GREEN * shade[..., None] * hue, 0, 255).astype(np.uint8)
    # The octahedral map of the sphere, unfolded to about true scale.
    taxi = np.sum(np.abs(turned), axis=-1)
    uv = 1.6 * radii[:, None, None] * turned[..., :2] / taxi[..., None]
    uv = uv + 0.9 * radii[:, None, None] * np.stack([turned[..., 2], -turned[..., 2]], -1)
    uv = uv + rng.uniform(0, 1, (count, 1, 2))
    triangles = (np.arange(count)[:, None, None] * 12 + _FACES[None]).reshape(-1, 3)
    return make_mesh(
        vertices.reshape(-1, 3),
        triangles,
        material=Material.LEAF,
        tag=Tag.VEGETATION,
        uv_m=uv.reshape(-1, 2),
        normals=normals.reshape(-1, 3),
        colour=colour.reshape(-1, 3),
    )


def _turned(rng: np.random.Generator, count: int) -> Array:
    """The icosahedron's corners turned about the vertical at random, shape (count, 12, 3)."""
    angle = rng.uniform(0, 2 * np.pi, count)
    c, s = elementary.cos(angle)[:, None], elementary.sin(angle)[:, None]
    x, y, z = _CORNERS.T
    return np.stack([c * x - s * y, s * x + c * y, np.broadcast_to(z, (count, 12))], axis=-1)


def _unit(v: Array) -> Array:
    return np.asarray(v / np.maximum(np.sqrt(np.sum(v * v, axis=-1, keepdims=True)), 1e-9))
