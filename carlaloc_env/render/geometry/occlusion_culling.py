"""Boxes that are hidden entirely by surfaces drawn before.

A half-drawn picture is read back and reduced to the farthest depth of every tile. A box whose nearest
corner lies beyond that in all tiles that it may touch shows in no pixel, so leaving it out changes
nothing. A live window cannot wait for that: it carries the surfaces of its last picture over to where
the camera is now, and takes for open whatever no surface has been carried to.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.render.views import NEAR_M, CameraView
from carlaloc_env.scene.mesh import EGO_INSTANCE

TILE_PX = 4
"""Edge of a tile; `_farthest` has it written out [px]."""
CELL_PX = 2
"""Edge of the cells that a surface must be carried into to hide anything [px]."""
MOVING_FROM = EGO_INSTANCE
"""Least instance id of what may have moved since an earlier picture."""
MARGIN_M = 0.3
"""Boxes are grown by this, for roundings and for leaves that sway [m]."""


class Depths:
    """Farthest surface in every tile of a picture so far."""

    def __init__(self, view: CameraView, depth_m: F32) -> None:
        """Reduce a picture.

        Args:
            view: Camera.
            depth_m: Planar depth of the drawn samples [m], 0 = nothing yet, shape (H, W).
        """
        self._view = view
        self.tile_px = TILE_PX
        rows, columns = (-(-size // self.tile_px) for size in depth_m.shape)
        bits = np.empty((rows, columns), np.uint32)
        _farthest(bits, depth_m.view(np.uint32), np.empty(depth_m.shape[1], np.uint32))
        bits += np.uint32(1)
        self.far_m = np.where(bits == 0, np.float32(np.inf), bits.view(np.float32))

    @classmethod
    def carried(
        cls, view: CameraView, earlier: CameraView, depth_m: F32, instance: NDArray[np.uint32]
    ) -> Depths:
        """Depths of a picture that is not drawn yet, by the surfaces of one shortly before.

        Args:
            view: Camera.
            earlier: Camera of the earlier picture.
            depth_m: Planar depth of its samples [m], 0 = sky, shape (H, W).
            instance: Instance ids of its samples, shape (H, W); what may move hides nothing.
        """
        depths = cls.__new__(cls)
        width, height = view.size_px
        depths._view, depths.tile_px = view, CELL_PX
        depths.far_m = np.empty((-(-height // CELL_PX), -(-width // CELL_PX)), np.float32)
        turn = np.sum(view.R_camera_world[:, None] * earlier.R_camera_world[None], axis=2)
        shift = np.sum(view.R_camera_world * (earlier.position_m - view.position_m), axis=1)
        to = np.column_stack([turn, shift])
        sx, sy, ox, oy = view.clip_scale
        to[0] = 0.5 * width / CELL_PX * (sx * to[0] + (ox + 1.0) * to[2])
        to[1] = 0.5 * height / CELL_PX * (sy * to[1] + (oy + 1.0) * to[2])
        _carry(depths.far_m, depth_m, instance, to, np.array(earlier.clip_scale))
        return depths

    def shown(self, corners_m: Array, *, least_px: float = 0.0) -> NDArray[np.bool_]:
        """Whether boxes may show, shape (N,).

        Args:
            corners_m: Their corners in the world [m], shape (N, 8, 3).
            least_px: Boxes that look smaller than this in both directions do not count [px].
        """
        view = self._view
        out = np.empty(len(corners_m), np.bool_)
        width, height = view.size_px
        shape = np.array([width / 2.0, height / 2.0, MARGIN_M, NEAR_M, least_px])
        _shown(
            out,
            np.ascontiguousarray(corners_m),
            view.position_m,
            view.R_camera_world,
            np.array(view.clip_scale),
            shape,
            self.far_m,
            self.tile_px,
        )
        return out


def box_corners(low_m: Array, high_m: Array) -> Array:
    """Corners of boxes (N, 3), (N, 3) along the axes, shape (N, 8, 3)."""
    pick = (np.arange(8)[:, None] >> np.arange(3)) & 1
    return np.where(pick[None] == 1, high_m[:, None], low_m[:, None])


@compiled
def _farthest(out: NDArray[np.uint32], depth_bits: NDArray[np.uint32], row: NDArray[np.uint32]) -> None:
    """Bits of the farthest depth of every tile less one, all set where there is sky; `row`: scratch.

    Bits of positive numbers are in their order, and whole numbers go through the processor's wide
    registers; the sky's zero less one becomes the largest of all.
    """
    height, width = depth_bits.shape
    whole = width // TILE_PX
    for tile in range(out.shape[0]):
        first = tile * TILE_PX
        for u in range(width):
            row[u] = np.uint32(depth_bits[first, u] - np.uint32(1))
        for v in range(first + 1, min(first + TILE_PX, height)):
            for u in range(width):
                row[u] = max(row[u], np.uint32(depth_bits[v, u] - np.uint32(1)))
        for column in range(whole):
            u = column * TILE_PX
            out[tile, column] = max(max(row[u], row[u + 1]), max(row[u + 2], row[u + 3]))
        if whole < out.shape[1]:
            far = row[width - 1]
            for u in range(whole * TILE_PX, width - 1):
                far = max(far, row[u])
            out[tile, whole] = far


@compiled
def _carry(out: F32, depth_m: F32, instance: NDArray[np.uint32], to: Array, clip: Array) -> None:
    """`to`: from the earlier optical frame to cells of this picture times depth (3, 4); `clip`: earlier."""
    height, width = depth_m.shape
    rows, columns = out.shape
    for row in range(rows):
        for column in range(columns):
            out[row, column] = -1.0
    step_x = 2.0 / (width * clip[0])
    first_x = (1.0 / width - 1.0 - clip[2]) / clip[0]
    for v in range(height):
        ray_y = (2.0 * (v + 0.5) / height - 1.0 - clip[3]) / clip[1]
        for u in range(width):
            ray_x = first_x + u * step_x
            d = np.float64(depth_m[v, u])
            # The sky lies at infinity: its directions turn, and nothing shifts them.
            per_d = 1.0 / d if d > 0.0 else 0.0
            z = to[2, 0] * ray_x + to[2, 1] * ray_y + to[2, 2] + per_d * to[2, 3]
            if z < NEAR_M * per_d or z <= 0.0:
                continue
            per_z = 1.0 / z
            x = (to[0, 0] * ray_x + to[0, 1] * ray_y + to[0, 2] + per_d * to[0, 3]) * per_z
            y = (to[1, 0] * ray_x + to[1, 1] * ray_y + to[1, 2] + per_d * to[1, 3]) * per_z
            if x < 0.0 or y < 0.0 or x >= columns or y >= rows:
                continue
            far = z * d if d > 0.0 and instance[v, u] < MOVING_FROM else math.inf
            column, row = int(x), int(y)
            if far > out[row, column]:
                out[row, column] = far
    for row in range(rows):
        for column in range(columns):
            if out[row, column] < 0.0:
                out[row, column] = np.inf


@compiled
def _shown(
    out: NDArray[np.bool_],
    corners_m: Array,
    eye_m: Array,
    rotation: Array,
    clip: Array,
    shape: Array,
    far_m: F32,
    tile_px: int,
) -> None:
    """`shape`: half of width and height [px], margin [m], nearest depth drawn [m], least size [px]."""
    rows, columns = far_m.shape
    for n in range(len(corners_m)):
        nearest = math.inf
        low_u, high_u, low_v, high_v = math.inf, -math.inf, math.inf, -math.inf
        size_u, size_v = 0.0, 0.0
        for k in range(8):
            dx = corners_m[n, k, 0] - eye_m[0]
            dy = corners_m[n, k, 1] - eye_m[1]
            dz = corners_m[n, k, 2] - eye_m[2]
            x = rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz
            y = rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz
            z = rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz
            nearest = min(nearest, z)
            z = max(z, shape[2] + shape[3])
            u = (clip[0] * x / z + clip[2] + 1.0) * shape[0]
            v = (clip[1] * y / z + clip[3] + 1.0) * shape[1]
            # How far the corner moves in the picture when it moves by the margin along every axis.
            share = shape[2] / (z - shape[2])
            grown_u = 1.0 + clip[0] * shape[0] * share * (1.0 + abs(x) / z)
            grown_v = 1.0 + clip[1] * shape[1] * share * (1.0 + abs(y) / z)
            low_u, high_u = min(low_u, u - grown_u), max(high_u, u + grown_u)
            low_v, high_v = min(low_v, v - grown_v), max(high_v, v + grown_v)
            size_u, size_v = max(size_u, grown_u), max(size_v, grown_v)
        nearest -= shape[2]
        out[n] = nearest <= shape[3]
        if out[n] or max(high_u - low_u - 2.0 * size_u, high_v - low_v - 2.0 * size_v) < shape[4]:
            continue
        first = max(int(low_u) // tile_px, 0)
        last = min(int(high_u) // tile_px, columns - 1)
        for row in range(max(int(low_v) // tile_px, 0), min(int(high_v) // tile_px, rows - 1) + 1):
            for column in range(first, last + 1):
                if far_m[row, column] >= nearest:
                    out[n] = True
                    break
            if out[n]:
                break
