"""Chunks cut into clusters: some hundred triangles that lie together and are culled as one.

In a street most triangles of a chunk lie outside the picture or behind a house; on a CPU each of them
costs as much as one that is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.scene import Mesh

Array = NDArray[np.float64]

CLUSTER_TRIANGLES = 160
"""Most triangles of a cluster."""
SIZES_M = (1.0, 8.0)
"""Edges of boxes round a triangle that part small, middling and large ones [m]: walls hide more alone."""
_BITS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clusters:
    """A mesh whose triangles are in the order of its clusters, and the boxes of these."""

    mesh: Mesh
    count: NDArray[np.int64]
    """Triangles of each cluster, shape (N,)."""
    low_m: Array
    """Lowest corners [m], shape (N, 3)."""
    high_m: Array
    """Highest corners [m], shape (N, 3)."""
    large: NDArray[np.bool_]
    """Whether a cluster has triangles of the largest size, which hide what is behind, shape (N,)."""


def cut(mesh: Mesh) -> Clusters:
    """Cut a mesh: triangles of one size in the order of a space-filling curve, in equal portions."""
    corners = mesh.vertices_m[mesh.triangles].astype(np.float64)
    low, high = corners.min(axis=1, initial=np.inf), corners.max(axis=1, initial=-np.inf)
    size = np.searchsorted(SIZES_M, (high - low).max(axis=1, initial=0.0))
    order = np.lexsort((_along_curve((low + high) / 2), size))
    size, low, high = size[order], low[order], high[order]
    rank = np.arange(len(order)) - np.searchsorted(size, size)
    begin = np.flatnonzero(rank % CLUSTER_TRIANGLES == 0)
    return Clusters(
        mesh=_reordered(mesh, order),
        count=np.diff(np.append(begin, len(order))),
        low_m=np.minimum.reduceat(low, begin, axis=0) if len(begin) else low,
        high_m=np.maximum.reduceat(high, begin, axis=0) if len(begin) else high,
        large=size[begin] == len(SIZES_M),
    )


def _along_curve(points_m: Array) -> NDArray[np.int64]:
    """Places of points (N, 3) along a Morton curve through their box, shape (N,)."""
    if not len(points_m):
        return np.zeros(0, np.int64)
    low = points_m.min(axis=0)
    edge = max(float((points_m.max(axis=0) - low).max()), 1e-3)
    cell = ((points_m - low) * ((1 << _BITS) - 1) / edge).astype(np.int64)
    place = np.zeros(len(points_m), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            place |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return place


def _reordered(mesh: Mesh, order: NDArray[np.intp]) -> Mesh:
    """The triangles in another order, and the vertices in the order in which these name them."""
    triangles = mesh.triangles[order]
    named = triangles.reshape(-1)
    first = np.full(len(mesh.vertices_m), len(named), np.int64)
    first[named[::-1]] = np.arange(len(named))[::-1]
    rows = np.argsort(first, kind="stable")
    place = np.empty(len(rows), np.uint32)
    place[rows] = np.arange(len(rows), dtype=np.uint32)
    names = ("vertices_m", "normals", "uv_m", "colour", "material", "tag", "instance")
    return replace(mesh, triangles=place[triangles], **{name: getattr(mesh, name)[rows] for name in names})
