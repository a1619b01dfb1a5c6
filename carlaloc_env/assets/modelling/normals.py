"""Faces of meshes: smooth normals, the volume inside, and points thrown onto them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.mesh import Mesh, face_vectors


def crease(mesh: Mesh, crease_deg: float) -> Mesh:
    """The mesh with normals averaged over neighbouring faces that meet below an angle [deg].

    Degenerate triangles are dropped; corners are split where the normal differs.
    """
    tri = mesh.triangles.astype(np.int64)
    face = face_vectors(mesh.vertices_m.astype(np.float64), tri)
    area = np.sqrt(np.sum(face * face, axis=-1))
    keep = area > 1e-9
    tri, face, area = tri[keep], face[keep], area[keep]
    corner = tri.ravel()
    if not len(corner):
        return mesh
    place = np.round(mesh.vertices_m[corner].astype(np.float64) * 1e4).astype(np.int64)
    _, weld = np.unique(_packed(place, 21), return_inverse=True)
    normals = _corner_normals(weld, np.repeat(face, 3, axis=0), np.repeat(area, 3), crease_deg)
    key = (corner << 33) + _packed(np.round(normals * 500).astype(np.int64), 11)
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    taken = corner[first]
    found = mesh.taking(taken, index.reshape(-1, 3).astype(np.uint32))
    return replace(found, normals=normals[first].astype(np.float32))


def _packed(rows: NDArray[np.int64], bits: int) -> NDArray[np.int64]:
    """Three whole numbers of a few bits in one, so that sorting is fast, shape (N,)."""
    shifted = (rows + (1 << (bits - 1))) & ((1 << bits) - 1)
    packed: NDArray[np.int64] = (shifted[:, 0] << (2 * bits)) | (shifted[:, 1] << bits) | shifted[:, 2]
    return packed


def _corner_normals(weld: NDArray[np.int64], face: Array, area: Array, crease_deg: float) -> Array:
    order = np.argsort(weld, kind="stable")
    count = np.bincount(weld)
    start = np.cumsum(count) - count
    corner = np.repeat(np.arange(len(weld)), count[weld])
    within = np.arange(len(corner)) - np.repeat(np.cumsum(count[weld]) - count[weld], count[weld])
    neighbour = order[start[weld[corner]] + within]
    unit = face / area[:, None]
    near = np.sum(unit[corner] * unit[neighbour], axis=-1) > elementary.cos(np.radians(crease_deg))
    corner, neighbour = corner[near], neighbour[near]
    sums = [np.bincount(corner, face[neighbour, axis], minlength=len(weld)) for axis in range(3)]
    total = np.stack(sums, axis=-1)
    return np.asarray(total / np.sqrt(np.sum(total * total, axis=-1, keepdims=True)))
