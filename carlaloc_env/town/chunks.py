"""Cutting the scenery into squares, so that far parts can be left out of a picture."""

from __future__ import annotations

import numpy as np

from carlaloc_env.scene import Mesh

CHUNK_M = 60.0
"""Side of a square [m]."""
FAR_CHUNK_M = 240.0
"""Side of a square in the town's surroundings [m]."""


def split_chunks(mesh: Mesh, size_m: float = CHUNK_M) -> tuple[Mesh, ...]:
    """Meshes of the squares of a world-fixed grid; each triangle goes where its centre lies."""
    if not len(mesh.triangles):
        return ()
    corners = mesh.vertices_m[mesh.triangles][:, :, :2]
    centre = corners.mean(axis=1)
    cell = np.floor(centre / size_m).astype(np.int64)
    key = (cell[:, 0] + (1 << 20)) * (1 << 22) + cell[:, 1] + (1 << 20)
    # The far land's triangles are larger than squares; one chunk holds them all.
    key[np.ptp(corners, axis=1).max(axis=1) > size_m] = -2
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-3))
    ends = np.append(starts[1:], len(order))
    return tuple(_part(mesh, order[a:b]) for a, b in zip(starts, ends, strict=True))


def _part(mesh: Mesh, rows: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Mesh:
    triangles = mesh.triangles[rows]
    low = triangles.min()
    taken = np.zeros(triangles.max() - low + 1, dtype=bool)
    taken[triangles - low] = True
    used = np.flatnonzero(taken) + low
    renumbered = (np.cumsum(taken, dtype=np.uint32) - np.uint32(1))[triangles - low]
    return Mesh(
        vertices_m=mesh.vertices_m[used],
        triangles=renumbered,
        normals=mesh.normals[used],
        uv_m=mesh.uv_m[used],
        colour=mesh.colour[used],
        material=mesh.material[used],
        tag=mesh.tag[used],
        instance=mesh.instance[used],
    )
