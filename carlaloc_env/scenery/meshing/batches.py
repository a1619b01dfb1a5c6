"""Batches of quads, triangles and props, worked out together.

Many small groups of quads and triangles worked out together, and handed out in their order.

Many copies of few props, gathered first and turned into meshes at the end.

Instance ids of what stands in a town: one counter, so that no two things share one.
"""

import itertools
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.core.transforms import cross
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, VERTEX_FIELDS, Mesh, merge, vertex_normals
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
    known, up = np.sum(normal**2, axis=1, keepdims=True) > 0.5, np.array([0.0, 0.0, 1.0], np.float32)
    normal = np.where(known, normal, up)
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


class InstanceIds:
    """Ids handed out upwards from 1; 0 is the id of what has none, such as the ground."""

    def __init__(self) -> None:
        self._next = 1

    def take(self, count: int = 1) -> int:
        """First of `count` consecutive ids that nothing else has.

        Raises:
            MapError: The ids below that of the ego are used up.
        """
        first = self._next
        if first + count > EGO_INSTANCE:
            raise MapError(f"the town holds more than {EGO_INSTANCE - 1} single things; take a smaller map")
        self._next += count
        return first


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


class PropField:
    """Props by key: how one is made, and where its copies stand."""

    def __init__(self) -> None:
        self._makers: dict[Hashable, Callable[[], Mesh]] = {}
        self._places: dict[Hashable, list[tuple[Array, Array, Array, Array]]] = {}

    def put(
        self,
        key: Hashable,
        make: Callable[[], Mesh],
        feet_m: Array,
        yaw_rad: ArrayLike = 0.0,
        scale: ArrayLike = 1.0,
        leaf_tint: ArrayLike = 1.0,
    ) -> None:
        """Choose copies of one prop.

        Args:
            key: Which prop; equal keys stand for equal props.
            make: Makes it, foot at the origin.
            feet_m: Where the copies stand [m], shape (N, 3).
            yaw_rad: Directions of their x axes [rad], a number or (N,).
            scale: Sizes, a number or (N,).
            leaf_tint: Factor on the colour of leaves, a number or (N, 3).
        """
        count = len(feet_m)
        if not count:
            return
        self._makers.setdefault(key, make)
        self._places.setdefault(key, []).append(
            (
                np.asarray(feet_m, dtype=np.float64),
                np.broadcast_to(np.asarray(yaw_rad, dtype=np.float64), (count,)),
                np.broadcast_to(np.asarray(scale, dtype=np.float64), (count,)),
                np.broadcast_to(np.asarray(leaf_tint, dtype=np.float64), (count, 3)),
            )
        )

    def feet_m(self, wanted: Callable[[Hashable], bool]) -> Array:
        """Feet of all props whose key is wanted [m], shape (K, 3)."""
        found = [place[0] for key, places in self._places.items() if wanted(key) for place in places]
        return np.concatenate(found) if found else np.zeros((0, 3))

    def meshes(self, ids: InstanceIds) -> list[Mesh]:
        """All copies, with an instance id each, in the order of their first being put."""
        found = []
        for key, places in self._places.items():
            feet, yaw, scale, tint = (np.concatenate(part) for part in zip(*places, strict=True))
            found.append(copies(self._makers[key](), poses(feet, yaw, scale), ids.take(len(feet)), tint))
        return found
