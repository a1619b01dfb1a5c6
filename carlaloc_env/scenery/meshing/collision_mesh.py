"""The mesh that wheels and bodies touch: the ground as it is, everything else as coarse shapes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scenery.meshing.triangulation import unique_rows

POST_SIDES = 6
"""Sides of the prisms that stand for poles and trunks."""


def posts(bases_m: Array, radius_m: float, height_m: ArrayLike) -> Array:
    """Upright prisms of poles and trunks, base points (N, 3), heights one or (N,), shape (N·sides, 4, 3)."""
    angle = np.arange(POST_SIDES + 1) * (2 * np.pi / POST_SIDES)
    ring = np.stack([elementary.cos(angle), elementary.sin(angle)], axis=-1)
    low = np.repeat(bases_m[:, None, :], POST_SIDES + 1, axis=1)
    low[..., :2] += ring * radius_m
    high = low.copy()
    high[..., 2] += np.reshape(height_m, (-1, 1))
    quads = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2)
    return quads.reshape(-1, 4, 3)


def weld(meshes: Sequence[Mesh]) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.uint8]]:
    """Corners, triangles and their tags of several meshes with equal corners made one (to 0.1 mm)."""
    corners = np.concatenate([mesh.vertices_m[mesh.triangles].reshape(-1, 3) for mesh in meshes])
    key = np.round(corners.astype(np.float64) * 1e4).astype(np.int64)
    _, first, inverse = unique_rows(key)
    triangles = inverse.reshape(-1, 3)
    real = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    tags = np.concatenate([mesh.tag[mesh.triangles[:, 0]] for mesh in meshes])
    return corners[first].astype(np.float64), triangles[real].astype(np.int32), tags[real]
