"""One wall of a building in its own coordinates, and the shapes that facades are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


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

    @property
    def outward(self) -> Array:
        """Unit vector along b, shape (3,)."""
        return np.array([self.along[1], -self.along[0], 0.0])

    def points(self, a: ArrayLike, b: ArrayLike, z: ArrayLike) -> Array:
        """Points [m] of wall coordinates, shape (..., 3)."""
        a, b, z = (np.asarray(x, dtype=np.float64) for x in (a, b, z))
        c, s = float(self.along[0]), float(self.along[1])
        x = self.origin_m[0] + a * c + b * s
        y = self.origin_m[1] + a * s - b * c
        return np.stack(np.broadcast_arrays(x, y, self.origin_m[2] + z), axis=-1)

    def front(self, a0: ArrayLike, a1: ArrayLike, z0: ArrayLike, z1: ArrayLike, b: ArrayLike = 0.0) -> Array:
        """Faces that look outwards."""
        return self._faces([(a0, b, z0), (a1, b, z0), (a1, b, z1), (a0, b, z1)])

    def top(self, a0: ArrayLike, a1: ArrayLike, b0: ArrayLike, b1: ArrayLike, z: ArrayLike) -> Array:
        """Faces that look up."""
        return self._faces([(a0, b0, z), (a0, b1, z), (a1, b1, z), (a1, b0, z)])

    def bottom(self, a0: ArrayLike, a1: ArrayLike, b0: ArrayLike, b1: ArrayLike, z: ArrayLike) -> Array:
        """Faces that look down."""
        return self._faces([(a0, b0, z), (a1, b0, z), (a1, b1, z), (a0, b1, z)])

    def left_side(self, a: ArrayLike, b0: ArrayLike, b1: ArrayLike, z0: ArrayLike, z1: ArrayLike) -> Array:
        """Faces that look against a."""
        return self._faces([(a, b0, z0), (a, b1, z0), (a, b1, z1), (a, b0, z1)])

    def right_side(self, a: ArrayLike, b0: ArrayLike, b1: ArrayLike, z0: ArrayLike, z1: ArrayLike) -> Array:
        """Faces that look along a."""
        return self._faces([(a, b1, z0), (a, b0, z0), (a, b0, z1), (a, b1, z1)])

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
        return np.concatenate(
            [
                self.front(a0, a1, z0, z1, out),
                self.left_side(a0, inner, out, z0, z1),
                self.right_side(a1, inner, out, z0, z1),
                self.top(a0, a1, inner, out, z1),
                self.bottom(a0, a1, inner, out, z0),
            ]
        )

    def reveal(self, a0: ArrayLike, a1: ArrayLike, z0: ArrayLike, z1: ArrayLike, depth: ArrayLike) -> Array:
        """The four inner faces of openings that go `depth` [m] into the wall."""
        back = -np.asarray(depth, dtype=np.float64)
        return np.concatenate(
            [
                self.right_side(a0, back, 0.0, z0, z1),
                self.left_side(a1, back, 0.0, z0, z1),
                self.top(a0, a1, back, 0.0, z0),
                self.bottom(a0, a1, back, 0.0, z1),
            ]
        )

    def _faces(self, corners: list[tuple[ArrayLike, ArrayLike, ArrayLike]]) -> Array:
        columns = [np.atleast_1d(np.asarray(x, dtype=np.float64)) for corner in corners for x in corner]
        count = max(len(column) for column in columns) if all(map(len, columns)) else 0
        if count == 0:
            return np.zeros((0, 4, 3))
        a, b, z = (np.empty((count, 4)) for _ in range(3))
        for k in range(4):
            a[:, k], b[:, k], z[:, k] = columns[3 * k : 3 * k + 3]
        return self.points(a, b, z)


def around(width_m: float, depth_m: float, base_m: float = 0.0) -> list[Wall]:
    """Walls of a rectangle whose front runs from (0, 0) to (width, 0): front, right, back, left."""
    corners = np.array([(0, 0), (width_m, 0), (width_m, depth_m), (0, depth_m)], dtype=np.float64)
    walls = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(end - start)))
        along = np.append((end - start) / length, 0.0)
        walls.append(Wall(origin_m=np.append(start, base_m), along=along, width_m=length))
    return walls
