"""Culling of triangles that cannot show in a picture, one by one.

On a CPU a triangle that shows in no pixel still costs as much as hundreds of multiplications: it is
turned, clipped, cut into tiles and held against the depth of every pixel that it touches. Here it costs a
few dozen: backs of closed bodies, triangles between the centres of pixels and triangles behind what has
been drawn are left out. The picture is the same without them.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, U32, Array
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.render.geometry.occlusion_culling import Depths
from carlaloc_env.render.views import NEAR_M, CameraView

SNAP_PX = 0.03
"""How far a corner may lie from where it is computed here, since drivers snap to fractions of a pixel."""
ROUNDING_M = 2e-4
"""The same in the world, for coordinates of a kilometre in single precision [m]."""
BEHIND_M = 0.02
"""How far behind a surface a triangle must lie to be hidden [m]."""
BEHIND_RATIO = 1e-3
"""The same as a part of its depth, on top of it."""

STILL = np.eye(3, 4, dtype=np.float32)[None]
"""Pose of what is in the world's frame already, as rows of instances."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """Triangles in memory, of which some are picked."""

    vertices_m: F32
    """Corners, shape (V, 3)."""
    triangles: U32
    """Three corners each, shape (T, 3)."""
    solid: NDArray[np.bool_]
    """Whether the back of a triangle is never seen, shape (T,)."""


class TriangleCuller:
    """Keeps the triangles that may show in a view, given what has been drawn of it so far."""

    def __init__(self, view: CameraView, hidden: Depths | None = None) -> None:
        """Make ready for a view; without `hidden` nothing has been drawn yet."""
        width, height = view.size_px
        sx, sy, ox, oy = view.clip_scale
        R = view.R_camera_world
        to_u = 0.5 * width * (sx * R[0] + (ox + 1.0) * R[2])
        to_v = 0.5 * height * (sy * R[1] + (oy + 1.0) * R[2])
        turn = np.stack([to_u, to_v, R[2]])
        # In single precision, as the graphics get it.
        eye = view.position_m.astype(np.float32).astype(np.float64)
        self._to = np.column_stack([turn, -np.sum(turn * eye, axis=1)])
        self._shape = np.array([width, height, 0.5 * max(width * sx, height * sy)])
        self._far_m = np.zeros((0, 0), np.float32) if hidden is None else hidden.far_m
        self._tile_px = 1 if hidden is None else hidden.tile_px

    def keep(self, body: Body, first: U32, count: U32, poses: F32 = STILL) -> tuple[U32, NDArray[np.int64]]:
        """Corners of the triangles that may show, three for each, and how many of them in each range.

        Args:
            body: Triangles.
            first: First index of every range, shape (N,).
            count: Number of its indices, shape (N,).
            poses: Pose of every range, or one for all, shape (N or 1, 3, 4).
        """
        to = np.sum(self._to[None, :, :3, None] * poses[:, None, :, :], axis=2)
        to[:, :, 3] += self._to[:, 3]
        out = np.empty(int(count.sum()), np.uint32)
        kept = np.empty(len(first), np.int64)
        _keep(
            out,
            kept,
            body.vertices_m,
            body.triangles,
            body.solid,
            first.astype(np.int64) // 3,
            count.astype(np.int64) // 3,
            to,
            self._shape,
            self._far_m,
            self._tile_px,
        )
        return out[: kept.sum()], kept


@inlined
def _is_behind(
    near_m: float, first_column: float, last_column: float, first_row: float, last_row: float, far_m: F32
) -> bool:
    """Whether all that has been drawn in tiles (far_m: its farthest depth) lies before a depth."""
    near_m -= BEHIND_M + BEHIND_RATIO * near_m
    rows, columns = far_m.shape
    for row in range(int(max(first_row, 0.0)), min(int(last_row), rows - 1) + 1):
        for column in range(int(max(first_column, 0.0)), min(int(last_column), columns - 1) + 1):
            if far_m[row, column] >= near_m:
                return False
    return True


@compiled
def _keep(
    out: U32,
    kept: NDArray[np.int64],
    vertices_m: F32,
    triangles: U32,
    solid: NDArray[np.bool_],
    first: NDArray[np.int64],
    count: NDArray[np.int64],
    to: Array,
    shape: Array,
    far_m: F32,
    tile_px: int,
) -> None:
    """`to`: to (pixel · depth, depth), (N or 1, 3, 4); `shape`: width, height, focal length [px]."""
    at = 0
    width, height, focal = shape[0], shape[1], shape[2]
    is_drawn, per_tile = len(far_m) > 0, 1.0 / tile_px
    for n in range(len(first)):
        k = n if len(to) > 1 else 0
        # Written out: the compiler keeps the twelve numbers in registers.
        m00, m01, m02, m03 = to[k, 0, 0], to[k, 0, 1], to[k, 0, 2], to[k, 0, 3]
        m10, m11, m12, m13 = to[k, 1, 0], to[k, 1, 1], to[k, 1, 2], to[k, 1, 3]
        m20, m21, m22, m23 = to[k, 2, 0], to[k, 2, 1], to[k, 2, 2], to[k, 2, 3]
        begun = at
        for t in range(first[n], first[n] + count[n]):
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            x, y, z = vertices_m[a, 0], vertices_m[a, 1], vertices_m[a, 2]
            u0, v0, z0 = (
                m00 * x + m01 * y + m02 * z + m03,
                m10 * x + m11 * y + m12 * z + m13,
                m20 * x + m21 * y + m22 * z + m23,
            )
            x, y, z = vertices_m[b, 0], vertices_m[b, 1], vertices_m[b, 2]
            u1, v1, z1 = (
                m00 * x + m01 * y + m02 * z + m03,
                m10 * x + m11 * y + m12 * z + m13,
                m20 * x + m21 * y + m22 * z + m23,
            )
            x, y, z = vertices_m[c, 0], vertices_m[c, 1], vertices_m[c, 2]
            u2, v2, z2 = (
                m00 * x + m01 * y + m02 * z + m03,
                m10 * x + m11 * y + m12 * z + m13,
                m20 * x + m21 * y + m22 * z + m23,
            )
            near = min(z0, min(z1, z2))
            if near < NEAR_M + 0.01:
                # A triangle that reaches behind the eye has no outline in the picture to test.
                if max(z0, max(z1, z2)) > NEAR_M - 0.01:
                    out[at], out[at + 1], out[at + 2] = a, b, c
                    at += 3
                continue
            i0, i1, i2 = 1.0 / z0, 1.0 / z1, 1.0 / z2
            u0, u1, u2, v0, v1, v2 = u0 * i0, u1 * i1, u2 * i2, v0 * i0, v1 * i1, v2 * i2
            slack = SNAP_PX + focal * ROUNDING_M / near
            low_u, high_u = min(u0, min(u1, u2)) - slack, max(u0, max(u1, u2)) + slack
            low_v, high_v = min(v0, min(v1, v2)) - slack, max(v0, max(v1, v2)) + slack
            if high_u < 0.0 or high_v < 0.0 or low_u > width or low_v > height:
                continue
            if math.floor(high_u - 0.5) < low_u - 0.5 or math.floor(high_v - 0.5) < low_v - 0.5:
                continue
            if solid[t]:
                area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
                if area > slack * (high_u - low_u + high_v - low_v):
                    continue
            if is_drawn and _is_behind(
                near, low_u * per_tile, high_u * per_tile, low_v * per_tile, high_v * per_tile, far_m
            ):
                continue
            out[at], out[at + 1], out[at + 2] = a, b, c
            at += 3
        kept[n] = at - begun
