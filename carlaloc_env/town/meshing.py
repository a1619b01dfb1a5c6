"""Gathering triangles of many materials into one mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.geometry import cross
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, merge, vertex_normals
from carlaloc_env.semantics import Tag

Array = NDArray[np.float64]
WHITE = (255, 255, 255)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Quads:
    """Quads of one call: corners (N, 4, 3), texture coordinates (N, 4, 2), the rest per quad or corner."""

    corners_m: Array
    uv_m: Array | None
    colour: Array
    material: NDArray[np.uint8]
    tag: Tag
    instance: NDArray[np.uint32]


class MeshBuilder:
    """Collects quads, grids and triangles; `build` gives one mesh of all of them in their order."""

    def __init__(self) -> None:
        self._parts: list[Mesh] = []
        # Buildings add thousands of small groups of quads: their normals are worked out many at a time.
        self._quads: list[_Quads] = []

    def add(self, mesh: Mesh) -> None:
        """Append a finished mesh."""
        if len(mesh.triangles):
            self._join_quads()
            self._parts.append(mesh)

    def quads(
        self,
        corners_m: ArrayLike,
        *,
        material: ArrayLike,
        tag: Tag,
        uv_m: ArrayLike | None = None,
        colour: ArrayLike = WHITE,
        instance: ArrayLike = 0,
    ) -> None:
        """Flat four-cornered faces.

        Args:
            corners_m: Corners [m], anticlockwise seen from outside, shape (N, 4, 3).
            material: One `Material` or one per quad, shape (N,).
            tag: Semantic tag.
            uv_m: Texture coordinates [m], shape (N, 4, 2); when left out, metres along the first edge and
                across it, anchored in the world so that neighbours in one plane continue each other.
            colour: Linear tint, shape (3,), (N, 3) or (N, 4, 3).
            instance: One instance id or one per quad, shape (N,).
        """
        c = np.asarray(corners_m, dtype=np.float64).reshape(-1, 4, 3)
        if not len(c):
            return
        self._quads.append(
            _Quads(
                corners_m=c,
                uv_m=None if uv_m is None else np.asarray(uv_m, dtype=np.float64).reshape(-1, 4, 2),
                colour=_per_corner(colour, len(c)),
                material=np.broadcast_to(np.asarray(material, dtype=np.uint8), (len(c),)),
                tag=tag,
                instance=np.broadcast_to(np.asarray(instance, dtype=np.uint32), (len(c),)),
            )
        )

    def grid(
        self,
        points_m: ArrayLike,
        *,
        material: Material,
        tag: Tag,
        uv_m: ArrayLike | None = None,
        colour: ArrayLike = WHITE,
        instance: int = 0,
    ) -> None:
        """A smooth surface over rows and columns; its outside is the side where rows × columns points.

        Args:
            points_m: Corners [m], shape (R, C, 3).
            material: Material of the surface.
            tag: Semantic tag.
            uv_m: Texture coordinates [m], shape (R, C, 2); world x, y when left out.
            colour: Linear tint, shape (3,) or (R, C, 3).
            instance: Instance id.
        """
        p = np.asarray(points_m, dtype=np.float64)
        rows, columns = p.shape[:2]
        if rows < 2 or columns < 2:
            return
        index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
        a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
        triangles = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
        colours = np.broadcast_to(np.asarray(colour), (rows, columns, 3)).reshape(-1, 3)
        self.triangles(
            p.reshape(-1, 3),
            triangles,
            material=material,
            tag=tag,
            uv_m=None if uv_m is None else np.asarray(uv_m).reshape(-1, 2),
            colour=colours,
            instance=instance,
        )

    def triangles(
        self,
        vertices_m: ArrayLike,
        triangles: ArrayLike,
        *,
        material: Material,
        tag: Tag,
        uv_m: ArrayLike | None = None,
        colour: ArrayLike = WHITE,
        instance: int = 0,
    ) -> None:
        """Smoothly shaded triangles over shared corners, shapes (V, 3) and (T, 3)."""
        v = np.asarray(vertices_m, dtype=np.float64).reshape(-1, 3)
        t = np.asarray(triangles, dtype=np.uint32).reshape(-1, 3)
        corner = v[t]
        flat = np.sum(cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) ** 2, axis=-1) < 1e-14
        t = t[~flat]
        if not len(t):
            return
        self._join_quads()
        self._append(
            v,
            t,
            vertex_normals(v.astype(np.float32), t),
            v[:, :2] if uv_m is None else np.asarray(uv_m, dtype=np.float64),
            np.broadcast_to(np.asarray(colour), (len(v), 3)),
            np.full(len(v), material, dtype=np.uint8),
            np.full(len(v), tag, dtype=np.uint8),
            np.full(len(v), instance, dtype=np.uint32),
        )

    def build(self) -> Mesh:
        """Everything gathered so far as one mesh."""
        self._join_quads()
        return merge(self._parts)

    def _join_quads(self) -> None:
        """Make one part of all quads gathered since the last part."""
        if not self._quads:
            return
        groups, self._quads = self._quads, []
        c = np.concatenate([group.corners_m for group in groups])
        size = [len(group.corners_m) for group in groups]
        normal = _unit(cross(c[:, 2] - c[:, 0], c[:, 3] - c[:, 1]))
        uv = planar_uv(c, normal)
        end = 0
        for group, count in zip(groups, size, strict=True):
            end += count
            if group.uv_m is not None:
                uv[end - count : end] = group.uv_m
        base = np.arange(len(c), dtype=np.uint32)[:, None] * 4
        self._append(
            c.reshape(-1, 3),
            (base + np.array([[0, 1, 2, 0, 2, 3]], dtype=np.uint32)).reshape(-1, 3),
            np.repeat(normal, 4, axis=0),
            uv.reshape(-1, 2),
            np.concatenate([group.colour for group in groups]),
            np.repeat(np.concatenate([group.material for group in groups]), 4),
            np.repeat(np.array([group.tag for group in groups], dtype=np.uint8), np.array(size) * 4),
            np.repeat(np.concatenate([group.instance for group in groups]), 4),
        )

    def _append(
        self,
        vertices: Array,
        triangles: NDArray[np.uint32],
        normals: ArrayLike,
        uv: Array,
        colour: ArrayLike,
        material: NDArray[np.uint8],
        tag: NDArray[np.uint8],
        instance: NDArray[np.uint32],
    ) -> None:
        normal = np.asarray(normals, dtype=np.float32)
        # Slivers have no direction of their own; a zero normal would turn pictures black.
        normal = np.where(
            np.sum(normal**2, axis=1, keepdims=True) > 0.5, normal, np.array([0.0, 0.0, 1.0], np.float32)
        )
        self._parts.append(
            Mesh(
                vertices_m=vertices.astype(np.float32),
                triangles=triangles,
                normals=normal,
                uv_m=uv.astype(np.float32),
                colour=np.clip(np.asarray(colour), 0, 255).astype(np.uint8),
                material=material,
                tag=tag,
                instance=instance,
            )
        )


def planar_uv(corners_m: Array, normal: Array) -> Array:
    """World-anchored texture coordinates [m] of flat quads, shape (N, 4, 2)."""
    along = _unit(corners_m[:, 1] - corners_m[:, 0])
    across = cross(normal, along)
    u = np.sum(corners_m * along[:, None], axis=-1)
    v = np.sum(corners_m * across[:, None], axis=-1)
    return np.stack([u, v], axis=-1)


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


def _per_corner(colour: ArrayLike, count: int) -> NDArray[np.float64]:
    c = np.asarray(colour, dtype=np.float64)
    if c.ndim == 2:
        c = c[:, None]
    return np.broadcast_to(c, (count, 4, 3)).reshape(-1, 3)


def _unit(v: Array) -> Array:
    length = np.sqrt(np.sum(v * v, axis=-1, keepdims=True))
    result: Array = v / np.where(length > 1e-12, length, 1.0)
    return result
