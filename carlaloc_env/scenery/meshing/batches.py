"""Batches of quads and triangles: many small groups worked out together, and handed out in their order."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import cross
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import VERTEX_FIELDS, Mesh, merge, vertex_normals
from carlaloc_env.scene.semantic_tags import Tag


@dataclass(frozen=True, slots=True, eq=False)
class Quads:
    """Quads of one call: corners (N, 4, 3), texture coordinates (N, 4, 2), the rest as it was given."""

    corners_m: Array
    uv_m: Array | None
    colour: ArrayLike
    material: ArrayLike
    tag: Tag


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """Triangles of one call: corners (V, 3) and their indices (T, 3), the rest as it was given."""

    corners_m: Array
    uv_m: Array | None
    colour: ArrayLike
    material: Material
    tag: Tag
    triangles: NDArray[np.uint32]


def joined(groups: Sequence[Quads | Triangles]) -> list[Mesh]:
    """Meshes of all groups in their order, one for each run of groups of one kind."""
    flat = _quad_parts([group for group in groups if isinstance(group, Quads)])
    smooth = _triangle_parts([group for group in groups if isinstance(group, Triangles)])
    meshes = []
    for kind, run in itertools.groupby(groups, type):
        made = flat if kind is Quads else smooth
        meshes.append(made.take(sum(1 for _ in run)))
    return meshes


def planar_uv(corners_m: Array, normal: Array) -> Array:
    """World-anchored texture coordinates [m] of flat quads, shape (N, 4, 2)."""
    along = _unit(corners_m[:, 1] - corners_m[:, 0])
    across = cross(normal, along)
    u = np.sum(corners_m * along[:, None], axis=-1)
    v = np.sum(corners_m * across[:, None], axis=-1)
    return np.stack([u, v], axis=-1)


class _Parts:
    """One mesh of many groups, handed out again a few groups at a time."""

    def __init__(self, mesh: Mesh, vertices: NDArray[np.int64], triangles: NDArray[np.int64]) -> None:
        """How many vertices and triangles each group has, (G,)."""
        self._mesh = mesh
        self._vertex = np.concatenate([[0], np.cumsum(vertices)])
        self._triangle = np.concatenate([[0], np.cumsum(triangles)])
        self._next = 0

    def take(self, groups: int) -> Mesh:
        """The next groups as a mesh of their own."""
        first, self._next = self._next, self._next + groups
        vertices = slice(self._vertex[first], self._vertex[self._next])
        rows = slice(self._triangle[first], self._triangle[self._next])
        part = {name: getattr(self._mesh, name)[vertices] for name in VERTEX_FIELDS}
        return Mesh(triangles=self._mesh.triangles[rows] - np.uint32(vertices.start), **part)


def _quad_parts(groups: Sequence[Quads]) -> _Parts:
    size = np.array([len(group.corners_m) for group in groups], dtype=np.int64)
    count = int(size.sum())
    if not count:
        return _Parts(merge([]), size, size)
    corners = np.concatenate([group.corners_m for group in groups])
    normal = _unit(cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]))
    uv = planar_uv(corners, normal)
    colour = np.empty((count, 4, 3))
    material, tag = np.empty(count, np.uint8), np.empty(count, np.uint8)
    end = 0
    for group in groups:
        part = slice(end, end := end + len(group.corners_m))
        if group.uv_m is not None:
            uv[part] = group.uv_m
        tint = np.asarray(group.colour)
        colour[part] = tint[:, None] if tint.ndim == 2 else tint
        material[part], tag[part] = group.material, group.tag
    base = np.arange(count, dtype=np.uint32)[:, None] * 4
    mesh = _mesh(
        corners.reshape(-1, 3),
        (base + np.array([[0, 1, 2, 0, 2, 3]], dtype=np.uint32)).reshape(-1, 3),
        np.repeat(normal, 4, axis=0),
        uv.reshape(-1, 2),
        colour.reshape(-1, 3),
        np.repeat(material, 4),
        np.repeat(tag, 4),
    )
    return _Parts(mesh, size * 4, size * 2)


def _triangle_parts(groups: Sequence[Triangles]) -> _Parts:
    size = np.array([len(group.corners_m) for group in groups], dtype=np.int64)
    count = int(size.sum())
    if not count:
        return _Parts(merge([]), size, size)
    v = np.concatenate([group.corners_m for group in groups])
    first = np.cumsum(size) - size
    t = np.concatenate([group.triangles + np.uint32(at) for group, at in zip(groups, first, strict=True)])
    owner = np.repeat(np.arange(len(groups)), [len(group.triangles) for group in groups])
    corner = v[t]
    flat = np.sum(cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) ** 2, axis=-1) < 1e-14
    t, owner = t[~flat], owner[~flat]
    triangles = np.bincount(owner, minlength=len(groups))
    uv, colour = v[:, :2].copy(), np.empty((count, 3))
    material, tag = np.empty(count, np.uint8), np.empty(count, np.uint8)
    for group, start in zip(groups, first, strict=True):
        part = slice(start, start + len(group.corners_m))
        if group.uv_m is not None:
            uv[part] = group.uv_m
        colour[part], material[part], tag[part] = group.colour, group.material, group.tag
    # Groups of slivers alone are left out, corners included.
    kept = np.repeat(triangles > 0, size)
    t = (np.cumsum(kept, dtype=np.uint32) - np.uint32(1))[t]
    v = v[kept]
    normals = vertex_normals(v.astype(np.float32), t)
    mesh = _mesh(v, t, normals, uv[kept], colour[kept], material[kept], tag[kept])
    return _Parts(mesh, np.where(triangles > 0, size, 0), triangles)


def _mesh(
    vertices: Array,
    triangles: NDArray[np.uint32],
    normals: ArrayLike,
    uv: Array,
    colour: Array,
    material: NDArray[np.uint8],
    tag: NDArray[np.uint8],
) -> Mesh:
    normal = np.asarray(normals, dtype=np.float32)
    # Slivers have no direction of their own; a zero normal would turn pictures black.
    proper, up = np.sum(normal**2, axis=1, keepdims=True) > 0.5, np.array([0.0, 0.0, 1.0], np.float32)
    normal = np.where(proper, normal, up)
    return Mesh(
        vertices_m=vertices.astype(np.float32),
        triangles=triangles,
        normals=normal,
        uv_m=uv.astype(np.float32),
        colour=np.clip(colour, 0, 255).astype(np.uint8),
        material=material,
        tag=tag,
        instance=np.zeros(len(vertices), np.uint32),
    )


def _unit(v: Array) -> Array:
    length = np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
    result: Array = v / np.where(length > 1e-12, length, 1.0)
    return result
