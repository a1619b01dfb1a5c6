"""Foliage of crowns: leaf triangles, and clumps that stand for many leaves close together."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import circle
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import cross
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, make_mesh
from carlaloc_env.scene.semantic_tags import Tag

LeafTint = tuple[int, int, int]
"""LeafTint relative to a green leaf; parts of yellow and red leaves may exceed 255."""
GREEN = np.array([0.65, 0.82, 0.84])
"""Share of the texture's colour that a green leaf keeps; leaves of other colours may exceed it."""
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


def unit(vectors: Array) -> Array:
    """Vectors of length one, same shape; zero where they are."""
    return np.asarray(vectors / np.maximum(np.sqrt(np.sum(vectors * vectors, axis=-1, keepdims=True)), 1e-9))


def leaf_colours(tint: LeafTint, light: Array) -> NDArray[np.uint8]:
    """Colours of leaves by the light on each, shape (N, 1) or (N, 3)."""
    return np.asarray(np.clip(np.array(tint) * GREEN * light, 0, 255), dtype=np.uint8)


def leaf_mesh(
    vertices_m: Array,
    triangles: NDArray[np.integer],
    uv_m: Array,
    colour: NDArray[np.uint8],
    normals: Array | None = None,
) -> Mesh:
    """Mesh of leaves; arguments as of `make_mesh`, their leading axes in any shape."""
    return make_mesh(
        vertices_m.reshape(-1, 3),
        triangles,
        material=Material.LEAF,
        tag=Tag.VEGETATION,
        uv_m=uv_m.reshape(-1, 2),
        normals=None if normals is None else normals.reshape(-1, 3),
        colour=colour.reshape(-1, 3),
    )


def separate_leaves(corners_m: Array, uv_m: Array, colour: NDArray[np.uint8], normals: Array) -> Mesh:
    """Triangles of three corners each (N, 3, 3) [m], with uv (3·N, 2), and a colour and a normal (N, 3)."""
    triangles = np.arange(3 * len(corners_m)).reshape(-1, 3)
    return leaf_mesh(corners_m, triangles, uv_m, np.repeat(colour, 3, axis=0), np.repeat(normals, 3, axis=0))


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
    normal = unit(0.7 * out + 0.9 * directions(rng, count))
    across = unit(cross(normal, directions(rng, count)))
    other = cross(normal, across)
    cos, sin = circle(3).T
    corner = LONG * cos[None, :, None] * across[:, None]
    corner = corner + sin[None, :, None] * other[:, None] / LONG
    vertices = points[:, None] + 0.577 * size[:, None, None] * corner
    bent = unit(0.5 * normal + 0.5 * out)
    light = rng.uniform(0.72, 1.0, (count, 1)) * np.clip(rng.normal(1.0, 0.06, (count, 3)), 0.8, 1.2)
    light = light * np.broadcast_to(shade, (count,))[:, None]
    uv = rng.uniform(0, 1, (count, 1, 2)) + 0.5 * size[:, None, None] * np.stack([cos, sin], -1)
    return separate_leaves(vertices, uv, leaf_colours(tint, light), bent)


def clumps(
    rng: np.random.Generator,
    centres: Array,
    radii: Array,
    middle: Array,
    tint: LeafTint,
    *,
    squash: float,
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
    away = unit(vertices - middle)
    normals = unit(0.55 * unit(local) + 0.45 * away)
    reach = np.sqrt(np.sum((centres - middle) ** 2, axis=-1))
    span = float(np.max(reach)) + 1e-6
    height = (centres[:, 2] - middle[2]) / span
    shade = np.clip(0.62 + 0.22 * (reach / span) + 0.20 * height, 0.4, 1.0)[:, None]
    shade = shade * rng.uniform(0.8, 1.0, (count, 12))
    hue = np.clip(rng.normal(1.0, 0.05, (count, 1, 3)), 0.85, 1.15)
    colour = np.clip(np.array(tint) * GREEN * shade[..., None] * hue, 0, 255).astype(np.uint8)
    # The octahedral map of the sphere, unfolded to about true scale.
    taxi = np.sum(np.abs(turned), axis=-1)
    uv = 1.6 * radii[:, None, None] * turned[..., :2] / taxi[..., None]
    uv = uv + 0.9 * radii[:, None, None] * np.stack([turned[..., 2], -turned[..., 2]], -1)
    uv = uv + rng.uniform(0, 1, (count, 1, 2))
    triangles = (np.arange(count)[:, None, None] * 12 + _FACES[None]).reshape(-1, 3)
    return leaf_mesh(vertices, triangles, uv, colour, normals)


def _turned(rng: np.random.Generator, count: int) -> Array:
    """The icosahedron's corners turned about the vertical at random, shape (count, 12, 3)."""
    angle = rng.uniform(0, 2 * np.pi, count)
    c, s = elementary.cos(angle)[:, None], elementary.sin(angle)[:, None]
    x, y, z = _CORNERS.T
    return np.stack([c * x - s * y, s * x + c * y, np.broadcast_to(z, (count, 12))], axis=-1)
