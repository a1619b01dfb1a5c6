"""Props: many copies of few meshes, gathered first and built at the end, each with its own instance id."""

from collections.abc import Callable, Hashable

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import MapError
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE, Mesh


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


def poses(bases_m: ArrayLike, yaw_rad: ArrayLike, scale: ArrayLike = 1.0) -> Array:
    """Upright poses (N, 4, 4) of props: base points [m] (N, 3), direction of their x axes [rad], scale."""
    bases = np.asarray(bases_m, dtype=np.float64).reshape(-1, 3)
    yaw = np.broadcast_to(np.asarray(yaw_rad, dtype=np.float64), (len(bases),))
    size = np.broadcast_to(np.asarray(scale, dtype=np.float64), (len(bases),))
    T = np.zeros((len(bases), 4, 4))
    T[:, 0, 0] = T[:, 1, 1] = elementary.cos(yaw) * size
    T[:, 1, 0] = elementary.sin(yaw) * size
    T[:, 0, 1] = -T[:, 1, 0]
    T[:, 2, 2] = size
    T[:, :3, 3] = bases
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
        bases_m: Array,
        yaw_rad: ArrayLike = 0.0,
        scale: ArrayLike = 1.0,
        leaf_tint: ArrayLike = 1.0,
    ) -> None:
        """Choose copies of one prop.

        Args:
            key: Which prop; equal keys stand for equal props.
            make: Makes it, foot at the origin.
            bases_m: Where the copies stand [m], shape (N, 3).
            yaw_rad: Directions of their x axes [rad], a number or (N,).
            scale: Sizes, a number or (N,).
            leaf_tint: Factor on the colour of leaves, a number or (N, 3).
        """
        count = len(bases_m)
        if not count:
            return
        self._makers.setdefault(key, make)
        self._places.setdefault(key, []).append(
            (
                np.asarray(bases_m, dtype=np.float64),
                np.broadcast_to(np.asarray(yaw_rad, dtype=np.float64), (count,)),
                np.broadcast_to(np.asarray(scale, dtype=np.float64), (count,)),
                np.broadcast_to(np.asarray(leaf_tint, dtype=np.float64), (count, 3)),
            )
        )

    def bases_m(self, wanted: Callable[[Hashable], bool]) -> Array:
        """Base points of all props whose key is wanted [m], shape (K, 3)."""
        bases = [place[0] for key, places in self._places.items() if wanted(key) for place in places]
        return np.concatenate(bases) if bases else np.zeros((0, 3))

    def meshes(self, ids: InstanceIds) -> list[Mesh]:
        """All copies, with an instance id each, in the order of their first being put."""
        meshes = []
        for key, places in self._places.items():
            bases_m, yaw, scale, tint = (np.concatenate(part) for part in zip(*places, strict=True))
            meshes.append(
                copies(self._makers[key](), poses(bases_m, yaw, scale), ids.take(len(bases_m)), tint)
            )
        return meshes
