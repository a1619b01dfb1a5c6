"""Gathers triangles of many materials into one mesh."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.areas import Area
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import WHITE, Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.meshing.batches import Quads, Triangles, joined
from carlaloc_env.scenery.meshing.triangulation import triangulate


class MeshBuilder:
    """Collects quads, grids and triangles; `build` gives one mesh of all of them in their order."""

    def __init__(self) -> None:
        self._parts: list[Mesh] = []
        # Towns are thousands of small groups: their normals are worked out many at a time.
        self._pending: list[Quads | Triangles] = []

    def add(self, mesh: Mesh) -> None:
        """Append a finished mesh."""
        if len(mesh.triangles):
            self._join()
            self._parts.append(mesh)

    def quads(
        self,
        corners_m: ArrayLike,
        *,
        material: ArrayLike,
        tag: Tag,
        uv_m: ArrayLike | None = None,
        colour: ArrayLike = WHITE,
    ) -> None:
        """Flat four-cornered faces.

        Args:
            corners_m: Corners [m], anticlockwise seen from outside, shape (N, 4, 3).
            material: One `Material` or one per quad, shape (N,).
            tag: Semantic tag.
            uv_m: Texture coordinates [m], shape (N, 4, 2); when left out, metres along the first edge and
                across it, anchored in the world so that neighbours in one plane continue each other.
            colour: Linear tint, shape (3,), (N, 3) or (N, 4, 3).
        """
        c = np.asarray(corners_m, dtype=np.float64).reshape(-1, 4, 3)
        uv = None if uv_m is None else np.asarray(uv_m, dtype=np.float64).reshape(-1, 4, 2)
        if len(c):
            self._pending.append(Quads(c, uv, colour, material, tag))

    def grid(
        self,
        points_m: ArrayLike,
        *,
        material: Material,
        tag: Tag,
        uv_m: ArrayLike | None = None,
        colour: ArrayLike = WHITE,
    ) -> None:
        """A smooth surface over rows and columns; its outside is the side where rows × columns points.

        Args:
            points_m: Corners [m], shape (R, C, 3).
            material: Material of the surface.
            tag: Semantic tag.
            uv_m: Texture coordinates [m], shape (R, C, 2); world x, y when left out.
            colour: Linear tint, shape (3,) or (R, C, 3).
        """
        p = np.asarray(points_m, dtype=np.float64)
        rows, columns = p.shape[:2]
        if rows < 2 or columns < 2:
            return
        uv, tint = None if uv_m is None else np.asarray(uv_m).reshape(-1, 2), np.asarray(colour)
        if tint.ndim > 1:
            tint = np.broadcast_to(tint, p.shape).reshape(-1, 3)
        triangles = _grid_triangles(rows, columns)
        self.triangles(p.reshape(-1, 3), triangles, material=material, tag=tag, uv_m=uv, colour=tint)

    def triangles(
        self,
        vertices_m: ArrayLike,
        triangles: ArrayLike,
        *,
        material: Material,
        tag: Tag,
        uv_m: ArrayLike | None = None,
        colour: ArrayLike = WHITE,
    ) -> None:
        """Smoothly shaded triangles over shared corners, shapes (V, 3) and (T, 3)."""
        v = np.asarray(vertices_m, dtype=np.float64).reshape(-1, 3)
        t = np.asarray(triangles, dtype=np.uint32).reshape(-1, 3)
        if len(t):
            self._pending.append(
                Triangles(
                    corners_m=v,
                    triangles=t,
                    uv_m=None if uv_m is None else np.asarray(uv_m, dtype=np.float64),
                    colour=colour,
                    material=material,
                    tag=tag,
                )
            )

    def sheet(
        self,
        area: Area,
        cell_m: float,
        height: Callable[[Array], Array],
        *,
        lift_m: float = 0.0,
        material: Material,
        tag: Tag,
        colour: ArrayLike = WHITE,
    ) -> None:
        """A surface over an area, cut along a grid of `cell_m`, at `lift_m` above the heights [m]."""
        xy, triangles = triangulate(area, cell_m)
        if len(xy):
            points = np.column_stack([xy, height(xy) + lift_m])
            self.triangles(points, triangles, material=material, tag=tag, colour=colour)

    def build(self) -> Mesh:
        """Builds one mesh of all that was gathered."""
        self._join()
        return merge(self._parts)

    def _join(self) -> None:
        """Make parts of all groups gathered since the last part, in their order."""
        groups, self._pending = self._pending, []
        self._parts += joined(groups)


def box_quads(low_m: ArrayLike, high_m: ArrayLike, *, bottom: bool = False) -> Array:
    """Faces of axis-aligned boxes, lowest and highest corners (..., 3), shape (N·5 or N·6, 4, 3)."""
    low = np.asarray(low_m, dtype=np.float64).reshape(-1, 3)
    high = np.asarray(high_m, dtype=np.float64).reshape(-1, 3)
    picks = [
        ["lll", "hll", "hlh", "llh"],
        ["hll", "hhl", "hhh", "hlh"],
        ["hhl", "lhl", "lhh", "hhh"],
        ["lhl", "lll", "llh", "lhh"],
        ["llh", "hlh", "hhh", "lhh"],
    ]
    if bottom:
        picks.append(["lll", "lhl", "hhl", "hll"])
    choose = {"l": low, "h": high}
    faces = [
        np.stack([np.stack([choose[p[i]][:, i] for i in range(3)], -1) for p in face], 1) for face in picks
    ]
    return np.concatenate(faces)


def turned(points_m: Array, origin_m: ArrayLike, yaw_rad: float) -> Array:
    """Points (..., 2 or 3) turned about the vertical and moved in plan to an origin (2 or 3,)."""
    c, s = elementary.cos(yaw_rad), elementary.sin(yaw_rad)
    x, y = points_m[..., 0], points_m[..., 1]
    origin, moved = np.asarray(origin_m), points_m.copy()
    moved[..., 0] = origin[0] + c * x - s * y
    moved[..., 1] = origin[1] + s * x + c * y
    return moved


def extrude(line_m: Array, top_m: Array) -> tuple[Array, Array]:
    """Upright quads between a polyline and the line above it, both (N, 3); outside = its right-hand side.

    Returns:
        Corners (N − 1, 4, 3) [m], and texture coordinates (N − 1, 4, 2) [m]: along the line and up.
    """
    step = np.sqrt(np.sum(np.diff(line_m[:, :2], axis=0) ** 2, axis=1))
    u = np.concatenate([[0.0], np.cumsum(step)])
    low, high = np.stack([u, line_m[:, 2]], axis=-1), np.stack([u, top_m[:, 2]], axis=-1)
    corners, uv = (
        np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1) for a, b in ((line_m, top_m), (low, high))
    )
    return corners, uv


@lru_cache(maxsize=256)
def _grid_triangles(rows: int, columns: int) -> NDArray[np.uint32]:
    """Triangles of a grid of corners stored row by row, shape (T, 3)."""
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    triangles.setflags(write=False)
    return triangles
