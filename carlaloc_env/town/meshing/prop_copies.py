"""Baking many copies of a prop into the scenery."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh


def poses(feet_m: ArrayLike, yaw_rad: ArrayLike, scale: ArrayLike = 1.0) -> Array:
    """Upright poses (N, 4, 4) of props: feet [m] (N, 3), direction of their x axes [rad], scale."""
    feet = np.asarray(feet_m, dtype=np.float64).reshape(-1, 3)
    yaw = np.broadcast_to(np.asarray(yaw_rad, dtype=np.float64), (len(feet),))
    size = np.broadcast_to(np.asarray(scale, dtype=np.float64), (len(feet),))
    T = np.zeros((len(feet), 4, 4))
    T[:, 0, 0] = T[:, 1, 1] = elementary.cos(yaw) * size
    T[:, 1, 0] = elementary.sin(yaw) * size
    T[:, 0, 1] = -T[:, 1, 0]
    T[:, 2, 2] = size
    T[:, :3, 3] = feet
    T[:, 3, 3] = 1.0
    return T


def copies(
    mesh: Mesh,
    T: Array,
    first_instance: int,
    leaf_tint: Array | None = None,
    *,
    tinted: Material = Material.LEAF,
) -> Mesh:
    """All copies of one prop as one mesh, with an instance id each.

    Args:
        mesh: The prop.
        T: Poses, rotation times a common scale, shape (N, 4, 4).
        first_instance: Instance id of the first copy; the others follow.
        leaf_tint: Factor on the colour of leaves for each copy, shape (N, 3).
        tinted: Takes the factor in the place of leaves.
    """
    count, size = len(T), len(mesh.vertices_m)
    v = mesh.vertices_m.astype(np.float64)
    n = mesh.normals.astype(np.float64)
    scale = T[:, 2, 2][:, None]
    vertices = np.stack(
        [sum(T[:, i, k, None] * v[:, k] for k in range(3)) + T[:, i, 3, None] for i in range(3)], axis=-1
    )
    normals = np.stack([sum(T[:, i, k, None] * n[:, k] for k in range(3)) / scale for i in range(3)], axis=-1)
    colour = np.tile(mesh.colour, (count, 1)).reshape(count, size, 3)
    if leaf_tint is not None:
        leaves = mesh.material == tinted
        tinted = mesh.colour[leaves][None] * leaf_tint[:, None]
        colour[:, leaves] = np.clip(tinted, 0, 255).astype(np.uint8)
    offsets = np.arange(count, dtype=np.uint32)[:, None, None] * np.uint32(size)
    return Mesh(
        vertices_m=vertices.reshape(-1, 3).astype(np.float32),
        triangles=(mesh.triangles[None] + offsets).reshape(-1, 3),
        normals=normals.reshape(-1, 3).astype(np.float32),
        uv_m=np.tile(mesh.uv_m, (count, 1)),
        colour=colour.reshape(-1, 3),
        material=np.tile(mesh.material, count),
        tag=np.tile(mesh.tag, count),
        instance=np.repeat(np.arange(first_instance, first_instance + count, dtype=np.uint32), size),
    )
