"""Motion of everything between two pictures of a camera, both ways, and surfaces that pass over tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.cores import over_bands
from carlaloc_env.core.jit import compiled
from carlaloc_env.sensors.imaging.frame import Frame, Optics
from carlaloc_env.sensors.imaging.motion_field import SKY_M, SURFACE_RATIO, TILE_PX, ScenePoses, motion_field

_RIM_PX = np.float32(0.6)
"""A pixel shows what is half a pixel beside it, and a little more for roundings [px]."""


def passing_surfaces(field: F32) -> F32:
    """Nearest surface that is over each tile at some time between the pictures, shape (h, w, 4).

    A pole that sweeps past within one period is surfaces by no pixel that sees neither its beginning
    nor its end: the tiles along its way remember it. Same four numbers as the field.
    """
    shape = -(-field.shape[0] // TILE_PX), -(-field.shape[1] // TILE_PX)
    surfaces, best = np.zeros((*shape, 4), np.float32), np.full(shape, np.float32(2 * SKY_M))
    _fill_passing(field, surfaces, best)
    return surfaces


@compiled
def _fill_passing(field: Any, surfaces: Any, best: Any) -> None:
    rows, columns = best.shape
    size, one = np.float32(TILE_PX), np.float32(1)
    for row in range(rows):
        for column in range(columns):
            y0, x0 = row * TILE_PX, column * TILE_PX
            y1, x1 = min(y0 + TILE_PX, field.shape[0]), min(x0 + TILE_PX, field.shape[1])
            # The nearest surface of the tile.
            y, x, depth = y0, x0, field[y0, x0, 3]
            for j in range(y0, y1):
                for i in range(x0, x1):
                    if field[j, i, 3] < depth:
                        y, x, depth = j, i, field[j, i, 3]
            if depth >= np.float32(SKY_M):
                continue
            left, right, top, bottom = x1, x0, y1, y0
            du, dv, ratio = field[y, x, 0], field[y, x, 1], field[y, x, 2]
            du_low, du_high, dv_low, dv_high = du, du, dv, dv
            for j in range(y0, y1):
                for i in range(x0, x1):
                    if field[j, i, 3] < np.float32(SURFACE_RATIO) * depth:
                        left, right, top, bottom = min(left, i), max(right, i), min(top, j), max(bottom, j)
                        du_low, du_high = min(du_low, field[j, i, 0]), max(du_high, field[j, i, 0])
                        dv_low, dv_high = min(dv_low, field[j, i, 1]), max(dv_high, field[j, i, 1])
            length = max(max(-du_low, du_high), max(-dv_low, dv_high))
            steps = min(int(length / (0.5 * TILE_PX)) + 1, 1024)
            tau_before, scale_before = np.float32(0), one
            for k in range(1, steps + 1):
                s = np.float32(k) / np.float32(steps)
                scale = (one - s) + s * ratio
                tau = s * ratio / scale
                # All that lies between where it was one step before and where it is now.
                west = left - _RIM_PX + min(tau * du_low, tau_before * du_low)
                east = right + _RIM_PX + max(tau * du_high, tau_before * du_high)
                north = top - _RIM_PX + min(tau * dv_low, tau_before * dv_low)
                south = bottom + _RIM_PX + max(tau * dv_high, tau_before * dv_high)
                near = depth * min(scale_before, scale)
                tau_before, scale_before = tau, scale
                q0, q1 = int(np.floor(north / size)), int(np.floor(south / size))
                p0, p1 = int(np.floor(west / size)), int(np.floor(east / size))
                for q in range(max(q0, 0), min(q1 + 1, rows)):
                    for p in range(max(p0, 0), min(p1 + 1, columns)):
                        if near < best[q, p]:
                            best[q, p] = near
                            surfaces[q, p, 0], surfaces[q, p, 1] = du, dv
                            surfaces[q, p, 2], surfaces[q, p, 3] = ratio, depth


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameGeometry:
    """Geometry of one picture: poses, depths and instances."""

    poses: ScenePoses
    """Where everything was."""
    depth_m: F32
    """Planar depth [m], 0 = sky, shape (H, W)."""
    instance: NDArray[np.uint32]
    """Instance ids, shape (H, W)."""

    @classmethod
    def of(cls, frame: Frame, poses: ScenePoses) -> FrameGeometry:
        """Geometry of a drawn picture."""
        return cls(poses=poses, depth_m=frame.depth_m, instance=frame.labels[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameMotion:
    """Motion of everything between two pictures, see `motion_field`."""

    forward: F32
    """Field of the first picture, towards the second, shape (H, W, 4)."""
    backward: F32
    """Field of the second picture, towards the first, shape (H, W, 4)."""
    passing: F32
    """Surfaces that pass over tiles, of the first picture, shape (h, w, 4)."""

    @classmethod
    def none(cls, shape: tuple[int, int]) -> FrameMotion:
        """Nothing moves: intensities change linearly."""
        field = np.zeros((*shape, 4), np.float32)
        field[..., 2:] = 1.0
        return cls(forward=field, backward=field, passing=passing_surfaces(field))


def motion_between(optics: Optics, before: FrameGeometry, after: FrameGeometry) -> FrameMotion:
    """Motion of everything between two pictures of a camera."""

    def field(now: FrameGeometry, then: FrameGeometry) -> F32:
        seen = now.depth_m, now.instance, now.poses
        return motion_field(optics.pinhole, *seen, then.poses, lens=optics.lens, rays=optics.rays)

    forward = field(before, after)
    # In parallel, since neither job can share all of its work among threads.
    jobs = (lambda: passing_surfaces(forward), lambda: field(after, before))
    passing, backward = over_bands(lambda job, _: jobs[job](), len(jobs), 1)
    return FrameMotion(forward=forward, backward=backward, passing=passing)
