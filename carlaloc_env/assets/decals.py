"""Thin parts laid onto a body: lamps, grilles, seams, handles, cut out of the body's own surface."""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.assets.primitives import Look, mirrored
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.mesh import Mesh, face_vectors

_RANGE_M = 1.0
"""How far behind the foremost point of nose or tail a patch may lie [m]."""
_FACING = 0.04
"""Least component of a triangle's normal along the view for it to carry a patch."""


class Decals:
    """Patches that follow a body exactly: its triangles, clipped by an outline and lifted a little."""

    def __init__(self, body: Mesh, lift_m: float = 0.005) -> None:
        self.body = body
        self.meshes: list[Mesh] = []
        self._lift_m = lift_m
        self._corners = body.vertices_m[body.triangles].astype(np.float64)
        self._low, self._high = self._corners.min(axis=1), self._corners.max(axis=1)
        self._normals = body.normals[body.triangles].astype(np.float64)
        self._lifts = _welded_normals(body)[body.triangles]
        self._face = face_vectors(body.vertices_m.astype(np.float64), body.triangles)
        self._face /= np.maximum(np.sqrt(np.sum(self._face**2, axis=1, keepdims=True)), 1e-12)

    def front(self, look: Look, outline_yz: ArrayLike, layer: int = 0) -> None:
        """Patch on the nose inside a convex outline of points (y, z), shape (N, 2)."""
        self._patch(look, outline_yz, 0, 1.0, layer)

    def rear(self, look: Look, outline_yz: ArrayLike, layer: int = 0) -> None:
        """Patch on the tail inside a convex outline of points (y, z)."""
        self._patch(look, outline_yz, 0, -1.0, layer)

    def sides(self, look: Look, outline_xz: ArrayLike, layer: int = 0) -> None:
        """Patch on both sides inside a convex outline of points (x, z)."""
        self._patch(look, outline_xz, 1, 1.0, layer, pair=True)

    def side(self, look: Look, outline_xz: ArrayLike, side: float, layer: int = 0) -> None:
        """Patch on the left (+1) or right (−1) side inside a convex outline of points (x, z)."""
        self._patch(look, outline_xz, 1, side, layer)

    def pair_front(self, look: Look, outline_yz: ArrayLike, layer: int = 0) -> None:
        """Patch on the left of the nose and its mirror image."""
        self._patch(look, outline_yz, 0, 1.0, layer, pair=True)

    def pair_rear(self, look: Look, outline_yz: ArrayLike, layer: int = 0) -> None:
        """Patch on the left of the tail and its mirror image."""
        self._patch(look, outline_yz, 0, -1.0, layer, pair=True)

    def seam(self, look: Look, line_xz: ArrayLike, width_m: float) -> None:
        """Thin line on both sides through points (x, z), e.g. a door gap."""
        line = np.asarray(line_xz, dtype=np.float64)
        for a, b in pairwise(line):
            along = (b - a) / max(float(np.sqrt(np.sum((b - a) ** 2))), 1e-6)
            across = 0.5 * width_m * np.array([-along[1], along[0]])
            self.sides(look, np.stack([a - across, b - across, b + across, a + across]))

    def surface_x(self, y_m: float, z_m: float, facing: float) -> float:
        """Position along x of nose (facing +1) or tail (−1) at a place seen from ahead or behind [m]."""
        return float(self._depth((y_m, z_m), 0, facing))

    def surface_z(self, x_m: float, y_m: float) -> float:
        """Height of the body at a place seen from above [m]."""
        return float(self._depth((x_m, y_m), 2, 1.0))

    def _depth(self, point: tuple[float, float], axis: int, facing: float) -> float:
        across = [a for a in range(3) if a != axis]
        a, b, c = (self._corners[:, i][:, across] for i in range(3))
        e1, e2, s = b - a, c - a, np.asarray(point) - a
        det = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
        safe = np.where(np.abs(det) > 1e-12, det, np.inf)
        u = (s[:, 0] * e2[:, 1] - s[:, 1] * e2[:, 0]) / safe
        v = (e1[:, 0] * s[:, 1] - e1[:, 1] * s[:, 0]) / safe
        inside = (u > -1e-9) & (v > -1e-9) & (u + v < 1 + 1e-9) & np.isfinite(safe)
        x = self._corners[:, :, axis]
        at = (1 - u - v) * x[:, 0] + u * x[:, 1] + v * x[:, 2]
        return facing * float(np.max(np.where(inside, facing * at, -np.inf)))

    def _patch(
        self, look: Look, outline: ArrayLike, axis: int, facing: float, layer: int, *, pair: bool = False
    ) -> None:
        """Add the part of the surface inside an outline, if there is any, and its mirror image for a pair."""
        across = [a for a in range(3) if a != axis]
        edge = np.asarray(outline, dtype=np.float64)
        turn = edge - edge.mean(axis=0)
        area = np.sum(turn[:, 0] * np.roll(turn[:, 1], -1) - np.roll(turn[:, 0], -1) * turn[:, 1])
        edge = edge if area > 0 else edge[::-1]
        points, normals, lifts = list[Array](), list[Array](), list[Array]()
        triangles: list[tuple[int, int, int]] = []
        for k in self._candidates(edge, axis, facing, across):
            flat = self._corners[k][:, across]
            clipped = clip(flat, edge)
            if len(clipped) < 3:
                continue
            share = _barycentric(flat, clipped)
            begin = sum(len(p) for p in points)
            # Written out without BLAS, so that a model has the same bits on every machine.
            points.append(np.sum(share[:, :, None] * self._corners[k][None], axis=1))
            normals.append(np.sum(share[:, :, None] * self._normals[k][None], axis=1))
            lifts.append(np.sum(share[:, :, None] * self._lifts[k][None], axis=1))
            triangles += [(begin, begin + i, begin + i + 1) for i in range(1, len(clipped) - 1)]
        if not triangles:
            return
        at, normal = np.concatenate(points), np.concatenate(normals)
        normal /= np.maximum(np.sqrt(np.sum(normal**2, axis=1, keepdims=True)), 1e-9)
        lift = self._lift_m + 0.003 * layer
        uv = at[:, across] - edge.min(axis=0)
        self.meshes.append(look.mesh(at + lift * np.concatenate(lifts), triangles, uv, normal))
        if pair:
            self.meshes.append(mirrored(self.meshes[-1]))

    def _candidates(self, edge: Array, axis: int, facing: float, across: list[int]) -> NDArray[np.intp]:
        """Triangles that face the viewer and whose box meets the outline's."""
        low, high = self._low, self._high
        touching = np.all(
            (high[:, across] >= edge.min(axis=0)) & (low[:, across] <= edge.max(axis=0)), axis=1
        )
        depth = facing * (high if facing > 0 else low)[:, axis]
        near = depth > depth.max() - _RANGE_M if axis == 0 else depth > 0.3 * depth.max()
        return np.flatnonzero(touching & near & (facing * self._face[:, axis] > _FACING))


def _welded_normals(body: Mesh) -> Array:
    """Normals that are the same at a place on both sides of an edge, so that patches do not gape there."""
    place = np.round(body.vertices_m.astype(np.float64) * 1e4).astype(np.int64)
    _, weld = np.unique(place, axis=0, return_inverse=True)
    sums = [np.bincount(weld.ravel(), body.normals[:, k].astype(np.float64)) for k in range(3)]
    total: Array = np.stack(sums, axis=1).astype(np.float64)
    length = np.maximum(np.sqrt(np.sum(total**2, axis=1, keepdims=True)), 1e-9)
    return np.asarray((total / length)[weld.ravel()], dtype=np.float64)


def clip(polygon: Array, outline: Array) -> Array:
    """Part of a convex polygon (K, 2) inside a convex anticlockwise outline (N, 2) (Sutherland, Hodgman)."""
    points = [(float(p[0]), float(p[1])) for p in polygon]
    corners = [(float(p[0]), float(p[1])) for p in outline]
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if not points:
            break
        inside = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for x, y in points]
        kept: list[tuple[float, float]] = []
        for i, (x, y) in enumerate(points):
            j = (i + 1) % len(points)
            if inside[i] >= 0.0:
                kept.append((x, y))
            if (inside[i] >= 0.0) != (inside[j] >= 0.0):
                t = inside[i] / (inside[i] - inside[j])
                kept.append((x + t * (points[j][0] - x), y + t * (points[j][1] - y)))
        points = kept
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def _barycentric(triangle: Array, points: Array) -> Array:
    """Shares of the corners of a triangle (3, 2) at points (K, 2), shape (K, 3)."""
    a, b, c = triangle
    e1, e2, s = b - a, c - a, points - a
    det = e1[0] * e2[1] - e1[1] * e2[0]
    u = (s[:, 0] * e2[1] - s[:, 1] * e2[0]) / det
    v = (e1[0] * s[:, 1] - e1[1] * s[:, 0]) / det
    return np.stack([1 - u - v, u, v], axis=1)
