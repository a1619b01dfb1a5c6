"""One wall of a building in its own coordinates, and the shapes that facades are made of."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array


def _table(*faces: str) -> NDArray[np.int64]:
    """Faces from their corners: least (0) or largest (1) a, b and z of each, for instance 000 100 101."""
    numbers = np.array([[[int(c) for c in corner] for corner in face.split()] for face in faces])
    return np.moveaxis(numbers + np.array([0, 2, 4]), 2, 0)


_OUTER, _TOP, _BOTTOM = _table("010 110 111 011"), _table("001 011 111 101"), _table("000 100 110 010")


_FRONT, _LEFT, _RIGHT = _table("000 100 101 001"), _table("000 010 011 001"), _table("110 100 101 111")


_BOX = np.concatenate([_OUTER, _LEFT, _RIGHT, _TOP, _BOTTOM], axis=1)


_REVEAL = _table("010 000 001 011", "100 110 111 101", "000 010 110 100", "001 101 111 011")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """A vertical rectangle: a runs along it, b out of it, z up.

    Every shape is given by arrays of its limits (N,) or numbers, and comes back as quads (M, 4, 3) in the
    building's frame, anticlockwise seen from where they can be seen.
    """

    origin_m: Array
    """Foot of the wall's left end, seen from outside [m], shape (3,)."""
    along: Array
    """Unit vector along a, horizontal, shape (3,)."""
    width_m: float
    """Length of the wall [m]."""

    def moved(self, shift_m: tuple[float, float, float]) -> Wall:
        """The same wall somewhere else."""
        return replace(self, origin_m=self.origin_m + np.array(shift_m))

    def points(self, a: ArrayLike, b: ArrayLike, z: ArrayLike) -> Array:
        """Points [m] of wall coordinates, shape (..., 3)."""
        a, b, z = (np.asarray(x, dtype=np.float64) for x in (a, b, z))
        c, s = float(self.along[0]), float(self.along[1])
        points = np.empty((*np.broadcast(a, b, z).shape, 3))
        points[..., 0] = self.origin_m[0] + a * c + b * s
        points[..., 1] = self.origin_m[1] + a * s - b * c
        points[..., 2] = self.origin_m[2] + z
        return points

    def front(self, a0: ArrayLike, a1: ArrayLike, z0: ArrayLike, z1: ArrayLike, b: ArrayLike = 0.0) -> Array:
        """Faces that look outwards."""
        return self._faces(_FRONT, a0, a1, b, b, z0, z1)

    def top(self, a0: ArrayLike, a1: ArrayLike, b0: ArrayLike, b1: ArrayLike, z: ArrayLike) -> Array:
        """Faces that look up."""
        return self._faces(_TOP, a0, a1, b0, b1, z, z)

    def left_side(self, a: ArrayLike, b0: ArrayLike, b1: ArrayLike, z0: ArrayLike, z1: ArrayLike) -> Array:
        """Faces that look against a."""
        return self._faces(_LEFT, a, a, b0, b1, z0, z1)

    def right_side(self, a: ArrayLike, b0: ArrayLike, b1: ArrayLike, z0: ArrayLike, z1: ArrayLike) -> Array:
        """Faces that look along a."""
        return self._faces(_RIGHT, a, a, b0, b1, z0, z1)

    def box(
        self,
        a0: ArrayLike,
        a1: ArrayLike,
        z0: ArrayLike,
        z1: ArrayLike,
        out: ArrayLike,
        inner: ArrayLike = 0.0,
    ) -> Array:
        """Boxes that stand out of the wall from `inner` to `out` [m], without their backs."""
        return self._faces(_BOX, a0, a1, inner, out, z0, z1)

    def reveal(self, a0: ArrayLike, a1: ArrayLike, z0: ArrayLike, z1: ArrayLike, depth: ArrayLike) -> Array:
        """The four inner faces of openings that go `depth` [m] into the wall."""
        return self._faces(_REVEAL, a0, a1, -np.asarray(depth, dtype=np.float64), 0.0, z0, z1)

    def _faces(self, table: NDArray[np.int64], *limits: ArrayLike) -> Array:
        """Quads of a table of faces, one face after the other for all N shapes, (F · N, 4, 3).

        Args:
            table: Number of the limit of each corner along a, b and z, shape (3, F, 4).
            limits: Least and largest a, b and z [m], (N,) or numbers.
        """
        sizes = [np.size(limit) for limit in limits]
        count = max(sizes) if all(sizes) else 0
        if count == 0:
            return np.zeros((0, 4, 3))
        values = np.empty((6, count))
        for k, limit in enumerate(limits):
            values[k] = limit
        a, b, z = values[table]
        c, s = float(self.along[0]), float(self.along[1])
        quads = np.empty((a.shape[0], count, 4, 3))
        x, y, up = np.moveaxis(quads, (3, 0, 2, 1), (0, 1, 2, 3))
        np.add(self.origin_m[0] + a * c, b * s, out=x)
        np.subtract(self.origin_m[1] + a * s, b * c, out=y)
        np.add(self.origin_m[2], z, out=up)
        return quads.reshape(-1, 4, 3)


def around(width_m: float, depth_m: float, base_m: float = 0.0) -> list[Wall]:
    """Walls of a rectangle whose front runs from (0, 0) to (width, 0): front, right, back, left."""
    corners = np.array([(0, 0), (width_m, 0), (width_m, depth_m), (0, depth_m)], dtype=np.float64)
    walls = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        along = np.append((end - start) / length, 0.0)
        walls.append(Wall(origin_m=np.append(start, base_m), along=along, width_m=length))
    return walls
