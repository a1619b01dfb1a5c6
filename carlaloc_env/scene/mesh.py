"""Triangle meshes, a library of movable models, and the poses of its instances.

Meshes laid end to end in a few arrays, as files hold them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import F32
from carlaloc_env.core.parallel_arrays import ParallelArrays
from carlaloc_env.core.transforms import cross
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag

Colour = tuple[int, int, int]
"""Linear red, green and blue, 0 to 255 each."""
WHITE: Colour = (255, 255, 255)
"""Tint that leaves the texture as it is; on CAR_PAINT and CLOTH it stands for the instance's tint."""
EGO_INSTANCE = 1 << 23
"""Instance id of the ego's own body; static things lie below, other actors above."""
VERTEX_FIELDS = ("vertices_m", "normals", "uv_m", "colour", "material", "tag", "instance")
"""Attributes of a mesh that have a row for every vertex."""
_FIELDS = ("triangles", *VERTEX_FIELDS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mesh:
    """Triangles with all that a camera and a LiDAR need; attributes never change inside a triangle."""

    vertices_m: F32
    """Corner positions [m], shape (V, 3)."""
    triangles: NDArray[np.uint32]
    """Corner indices, counter-clockwise seen from outside, shape (T, 3)."""
    normals: F32
    """Unit shading normals, shape (V, 3)."""
    uv_m: F32
    """Texture coordinates [m along the surface], shape (V, 2); the material's `tile_m` scales them."""
    colour: NDArray[np.uint8]
    """Linear-light tint 0–255 that multiplies the texture (255 = unchanged), shape (V, 3)."""
    material: NDArray[np.uint8]
    """`Material` of each vertex, shape (V,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag` of each vertex, shape (V,)."""
    instance: NDArray[np.uint32]
    """Instance id of each vertex, 0 = none, shape (V,); below 2**23 for static things."""

    def __post_init__(self) -> None:
        count = len(self.vertices_m)
        for name in VERTEX_FIELDS[1:]:
            if len(getattr(self, name)) != count:
                raise ValueError(f"Mesh.{name} has {len(getattr(self, name))} rows, vertices_m has {count}")

    def transformed(self, T: ArrayLike) -> Mesh:
        """The same mesh moved by a rigid transform (4, 4)."""
        m = np.asarray(T, dtype=np.float64)
        vertices_m = elementary.matrix_product(self.vertices_m, m[:3, :3].T) + m[:3, 3]
        normals = elementary.matrix_product(self.normals, m[:3, :3].T)
        return replace(self, vertices_m=vertices_m.astype(np.float32), normals=normals.astype(np.float32))

    def with_instance(self, instance: int) -> Mesh:
        """The same mesh with one instance id."""
        return replace(self, instance=np.full(len(self.vertices_m), instance, dtype=np.uint32))

    def taking(self, vertices: NDArray[np.integer], triangles: NDArray[np.uint32]) -> Mesh:
        """Some of the vertices by number, shape (V,), and triangles (T, 3) between these."""
        # Rows are taken several times faster by their numbers than by a mask.
        taken = {name: np.take(getattr(self, name), vertices, axis=0) for name in VERTEX_FIELDS}
        return Mesh(triangles=triangles, **taken)

    @property
    def bounds_m(self) -> F32:
        """Lowest and highest corner of the axis-aligned box [m], shape (2, 3)."""
        # Axis by axis: numpy takes ten times as long over rows of three.
        axes = self.vertices_m.T
        return np.array([[axis.min() for axis in axes], [axis.max() for axis in axes]], dtype=np.float32)


def make_mesh(
    vertices_m: ArrayLike,
    triangles: ArrayLike,
    *,
    material: Material,
    tag: Tag,
    uv_m: ArrayLike | None = None,
    normals: ArrayLike | None = None,
    colour: ArrayLike = (255, 255, 255),
    instance: int = 0,
) -> Mesh:
    """Mesh of one material and tag.

    Args:
        vertices_m: Corner positions [m], shape (V, 3).
        triangles: Corner indices, shape (T, 3).
        material: Material of all triangles.
        tag: Semantic tag of all triangles.
        uv_m: Texture coordinates [m], shape (V, 2); x, y of the corners when left out.
        normals: Unit normals, shape (V, 3); area-weighted means of the triangles' when left out.
        colour: Linear tint 0–255, shape (3,) or (V, 3).
        instance: Instance id.
    """
    v = np.ascontiguousarray(vertices_m, dtype=np.float32).reshape(-1, 3)
    t = np.ascontiguousarray(triangles, dtype=np.uint32).reshape(-1, 3)
    count = len(v)
    return Mesh(
        vertices_m=v,
        triangles=t,
        normals=vertex_normals(v, t) if normals is None else np.asarray(normals, dtype=np.float32),
        uv_m=v[:, :2].copy() if uv_m is None else np.asarray(uv_m, dtype=np.float32),
        colour=np.broadcast_to(np.asarray(colour, dtype=np.uint8), (count, 3)).copy(),
        material=np.full(count, material, dtype=np.uint8),
        tag=np.full(count, tag, dtype=np.uint8),
        instance=np.full(count, instance, dtype=np.uint32),
    )


def vertex_normals(vertices_m: F32, triangles: NDArray[np.uint32]) -> F32:
    """Area-weighted unit normals, shape (V, 3)."""
    corners = triangles.ravel()
    weights = np.repeat(face_vectors(vertices_m.astype(np.float64), triangles), 3, axis=0)
    sums = [np.bincount(corners, weights[:, axis], minlength=len(vertices_m)) for axis in range(3)]
    total = np.stack(sums, axis=-1)
    length = np.linalg.norm(total, axis=-1, keepdims=True)
    return (total / np.where(length > 0, length, 1.0)).astype(np.float32)


def face_vectors(vertices_m: NDArray[np.floating], triangles: NDArray[np.integer]) -> NDArray[np.floating]:
    """Vectors across triangles, twice as long as their area [m²], shape (T, 3)."""
    a, b, c = (np.take(vertices_m, triangles[:, i], axis=0) for i in range(3))
    return np.asarray(cross(b - a, c - a))


def merge(meshes: Iterable[Mesh]) -> Mesh:
    """One mesh out of several, in their order; an empty mesh out of none."""
    parts = [mesh for mesh in meshes if len(mesh.vertices_m)]
    if not parts:
        return make_mesh(np.zeros((0, 3)), np.zeros((0, 3)), material=Material.PLAIN, tag=Tag.UNLABELED)
    offsets = np.cumsum([0] + [len(mesh.vertices_m) for mesh in parts[:-1]])
    triangles = [mesh.triangles + np.uint32(offset) for mesh, offset in zip(parts, offsets, strict=True)]
    joined = {name: np.concatenate([getattr(mesh, name) for mesh in parts]) for name in VERTEX_FIELDS}
    return Mesh(triangles=np.concatenate(triangles), **joined)


class ModelLibrary:
    """Movable models by index: vehicles, walkers in each phase of their gait, lit lenses.

    Camera and LiDAR draw from the same library, so that both see the same shape.
    """

    def __init__(self, models: Mapping[str, Mesh]) -> None:
        self.names: tuple[str, ...] = tuple(models)
        self.meshes: tuple[Mesh, ...] = tuple(models.values())
        self._index = {name: index for index, name in enumerate(self.names)}

    def index(self, name: str) -> int:
        """Index of a model's name."""
        return self._index[name]

    def without(self, family: str) -> ModelLibrary:
        """The models but those of a family: itself, and its parts."""
        pairs = zip(self.names, self.meshes, strict=True)
        return ModelLibrary({name: mesh for name, mesh in pairs if name.partition("/")[0] != family})

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Instances(ParallelArrays):
    """Models standing in the world at one instant, parallel arrays."""

    model: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Index in the `ModelLibrary`, shape (N,)."""
    T_world_model: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """Pose of each model, shape (N, 4, 4)."""
    instance: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    """Instance id to write in pictures and clouds, shape (N,)."""
    tint: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 3), np.uint8))
    """Linear colour 0–255 of the model's CAR_PAINT and CLOTH surfaces, shape (N, 3)."""

    def __len__(self) -> int:
        return len(self.model)


def meshes_to_arrays(meshes: Sequence[Mesh]) -> dict[str, NDArray[Any]]:
    """Arrays of meshes, one for each of their attributes, and the numbers of their vertices and triangles."""
    arrays: dict[str, NDArray[Any]] = {
        "vertex_counts": np.array([len(mesh.vertices_m) for mesh in meshes], dtype=np.int64),
        "triangle_counts": np.array([len(mesh.triangles) for mesh in meshes], dtype=np.int64),
    }
    for name in _FIELDS:
        arrays[f"mesh_{name}"] = np.concatenate([getattr(mesh, name) for mesh in meshes])
    return arrays


def meshes_from_arrays(arrays: Mapping[str, NDArray[Any]]) -> tuple[Mesh, ...]:
    """The meshes again, as views of the arrays.

    Raises:
        KeyError: an array is missing.
        ValueError: their lengths do not fit each other.
    """
    vertex = np.concatenate([[0], np.cumsum(arrays["vertex_counts"])])
    triangle = np.concatenate([[0], np.cumsum(arrays["triangle_counts"])])
    meshes = []
    for index in range(len(vertex) - 1):
        rows = dict.fromkeys(_FIELDS, slice(vertex[index], vertex[index + 1]))
        rows["triangles"] = slice(triangle[index], triangle[index + 1])
        meshes.append(Mesh(**{name: arrays[f"mesh_{name}"][part] for name, part in rows.items()}))
    return tuple(meshes)
