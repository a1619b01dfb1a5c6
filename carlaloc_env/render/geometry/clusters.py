"""Scenery cut into clusters: some hundred triangles that lie together and are culled as one.

In a street most triangles of a chunk lie outside the picture or behind a house; on a CPU each of them costs
as much as one that is seen.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.scene.mesh import Mesh

CLUSTER_TRIANGLES = 160
"""Most triangles of a cluster."""
SIZES_M = (1.0, 8.0)
"""Edges of boxes round a triangle that part small, middling and large ones [m]: walls hide more alone."""
_BITS = 10
"""Bits of a coordinate along the space-filling curve."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clusters:
    """Triangles of a mesh in the order of their clusters, and these clusters, group by group."""

    order: Index
    """Triangles of the mesh, shape (T,)."""
    count: NDArray[np.int64]
    """Triangles of each cluster, shape (N,)."""
    group: Index
    """Group of each cluster, rising, shape (N,)."""
    low_m: Array
    """Lowest corners [m], shape (N, 3)."""
    high_m: Array
    """Highest corners [m], shape (N, 3)."""
    large: NDArray[np.bool_]
    """Whether a cluster has triangles of the largest size, which hide what is behind, shape (N,)."""


def cut(mesh: Mesh, group: Index) -> Clusters:
    """Cut a mesh: triangles of one group and size in the order of a space-filling curve, in equal portions.

    Args:
        mesh: All triangles.
        group: Triangles of different groups share no cluster, shape (T,).
    """
    low, high = _triangle_boxes(mesh)
    size = np.searchsorted(SIZES_M, _longest(high - low))
    kind = group * (len(SIZES_M) + 1) + size
    place = _along_curve(_within_group((low + high) / 2, group))
    order = np.argsort((kind << (3 * _BITS)) | place, kind="stable")
    del place
    kind = kind[order]
    rank = np.arange(len(order)) - np.searchsorted(kind, kind)
    begin = np.flatnonzero(rank % CLUSTER_TRIANGLES == 0)
    low, high = low[order], high[order]
    return Clusters(
        order=order,
        count=np.diff(np.append(begin, len(order))),
        group=kind[begin] // (len(SIZES_M) + 1),
        low_m=(np.minimum.reduceat(low, begin, axis=0) if len(begin) else low).astype(np.float64),
        high_m=(np.maximum.reduceat(high, begin, axis=0) if len(begin) else high).astype(np.float64),
        large=kind[begin] % (len(SIZES_M) + 1) == len(SIZES_M),
    )


def _triangle_boxes(mesh: Mesh) -> tuple[F32, F32]:
    """Lowest and highest corners of boxes round triangles [m], shape (T, 3) each."""
    low = np.take(mesh.vertices_m, mesh.triangles[:, 0], axis=0)
    high = low.copy()
    for k in (1, 2):
        corner = np.take(mesh.vertices_m, mesh.triangles[:, k], axis=0)
        np.minimum(low, corner, out=low)
        np.maximum(high, corner, out=high)
    return low, high


def _longest(across: F32) -> F32:
    """Longest edges of boxes (N, 3), shape (N,)."""
    # Axis by axis: numpy takes ten times as long over rows of three.
    return np.asarray(np.maximum(np.maximum(across[:, 0], across[:, 1]), across[:, 2]))


def _within_group(point_m: NDArray[np.floating], group: Index) -> NDArray[np.floating]:
    """Points (T, 3) within the cube round all of their group, 0–1."""
    if not len(group):
        return point_m
    # Two bytes are sorted by counting.
    short = group.astype(np.uint16) if group.max() < 1 << 16 else group
    order = np.argsort(short, kind="stable")
    begin = np.flatnonzero(np.diff(group[order], prepend=-1))
    of = np.empty(len(group), np.intp)
    of[order] = np.repeat(np.arange(len(begin)), np.diff(np.append(begin, len(group))))
    sorted_m = np.take(point_m, order, axis=0)
    low, high = (bound.reduceat(sorted_m, begin, axis=0) for bound in (np.minimum, np.maximum))
    edge = np.maximum((high - low).max(axis=1), np.float32(1e-3))
    return np.asarray((point_m - np.take(low, of, axis=0)) / np.take(edge, of)[:, None])


def _along_curve(place: NDArray[np.floating]) -> NDArray[np.int64]:
    """Places of points (N, 3) in the unit cube along a Morton curve, shape (N,)."""
    cell = np.clip(place * (1 << _BITS), 0, (1 << _BITS) - 1).astype(np.int64)
    # Each step puts two zeros between halves of the bits that are still together.
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cell = (cell | (cell << shift)) & mask
    return np.asarray(cell[:, 0] | (cell[:, 1] << 1) | (cell[:, 2] << 2))


def in_order(mesh: Mesh, order: Index) -> Mesh:
    """Some triangles in a given order, and their vertices in the order in which they name them."""
    triangles = np.take(mesh.triangles, order, axis=0)
    named = triangles.reshape(-1)
    first = np.full(len(mesh.vertices_m), len(named), np.int64)
    first[named[::-1]] = np.arange(len(named))[::-1]
    used = np.flatnonzero(first < len(named))
    rows = used[np.argsort(first[used], kind="stable")]
    place = np.empty(len(mesh.vertices_m), np.uint32)
    place[rows] = np.arange(len(rows), dtype=np.uint32)
    return mesh.taking(rows, np.take(place, triangles))
