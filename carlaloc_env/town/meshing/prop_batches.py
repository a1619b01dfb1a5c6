"""Many copies of few props, gathered first and turned into meshes at the end."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np
from numpy.typing import ArrayLike

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.town.meshing.instance_ids import InstanceIds
from carlaloc_env.town.meshing.prop_copies import copies, poses


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
