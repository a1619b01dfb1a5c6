"""Cuts the scenery into squares, so that far parts can be left out of a picture."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.scene.mesh import Mesh

CHUNK_M = 60.0
"""Side of a square [m]."""
FAR_CHUNK_M = 240.0
"""Side of a square in the town's surroundings [m]."""


def split_chunks(mesh: Mesh, size_m: float = CHUNK_M) -> tuple[Mesh, ...]:
    """Meshes of the squares of a world-fixed grid; each triangle goes where its centre lies."""
    if not len(mesh.triangles):
        return ()
    a, b, c = (mesh.vertices_m[mesh.triangles[:, k], :2] for k in range(3))
    centre = (a + b + c) / np.float32(3.0)
    cell = np.floor(centre / size_m).astype(np.int64)
    key = (cell[:, 0] + (1 << 20)) * (1 << 22) + cell[:, 1] + (1 << 20)
    # The far land's triangles are larger than squares; one chunk holds them all.
    extent = np.maximum(np.maximum(a, b), c) - np.minimum(np.minimum(a, b), c)
    key[extent.max(axis=1) > size_m] = -2
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-3))
    ends = np.append(starts[1:], len(order))
    taken = np.zeros(len(mesh.vertices_m), dtype=bool)
    number = np.zeros(len(mesh.vertices_m), dtype=np.uint32)
    return tuple(_part(mesh, order[a:b], taken, number) for a, b in zip(starts, ends, strict=True))


def _part(mesh: Mesh, rows: NDArray[np.int64], taken: NDArray[np.bool_], number: NDArray[np.uint32]) -> Mesh:
    """Some triangles with their own vertices; `taken` (all false) and `number` are room for all vertices."""
    triangles = mesh.triangles[rows]
    taken[triangles] = True
    low, high = int(triangles.min()), int(triangles.max()) + 1
    used = np.flatnonzero(taken[low:high]) + low
    taken[used] = False
    number[used] = np.arange(len(used), dtype=np.uint32)
    return mesh.taking(used, number[triangles])
