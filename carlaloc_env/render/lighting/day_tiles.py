"""Tiles of a picture by day: where nothing that moves can take the light, its shadows need no looking up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.geometry.geometry_pass import Casters
from carlaloc_env.render.geometry.projection import CameraView
from carlaloc_env.render.lighting.screen_tiles import FEW_TILES, TILE_PX, DepthRange, TileGroups, every_tile
from carlaloc_env.render.lighting.tile_kernels import shaded_by

LEAST_PX = 200_000
"""Pixels of pictures that are worth the sorting of their tiles."""
BLUR_M = 0.7
"""How far beside its outline a shadow's blurred edge, and the offset of what looks it up, reach [m]."""
KINDS: tuple[tuple[str, ...], ...] = ((), ("ACTORS",))
"""Kinds of tiles by what their program looks up."""


def day_groups(view: CameraView, depths: DepthRange, axes: Array | None, casters: Casters) -> TileGroups:
    """Tiles sorted by whether movable models may throw shadows there.

    Args:
        view: Camera.
        depths: What the tiles show.
        axes: World axes to the light's right, up, away, shape (3, 3); None when nothing throws shadows.
        casters: Movable models.
    """
    shape = depths.near_m.shape
    kind = np.zeros(shape, np.intp)
    if axes is not None and len(casters.instances):
        centres_m = casters.instances.T_world_model[:, :3, 3] - view.position_m
        radius_m = casters.radius_m[casters.instances.model] + BLUR_M
        kind[under(view, depths, axes, centres_m, radius_m)] = 1
    flat = kind.ravel()
    if np.count_nonzero(flat == 0) < FEW_TILES:
        flat[:] = 1
    return TileGroups.sorted_by(every_tile(shape), flat, KINDS, depths.shown.ravel())


def under(
    view: CameraView, depths: DepthRange, axes: Array, centres_m: Array, radius_m: Array
) -> NDArray[np.bool_]:
    """Tiles in which some surface may lie in the shadow of one of some spheres, shape (R, C).

    Args:
        view: Camera.
        depths: What the tiles show.
        axes: World axes to the light's right, up, away, shape (3, 3).
        centres_m: Middles of the spheres from the eye [m], shape (N, 3).
        radius_m: Their radii [m], shape (N,).
    """
    low, high = _boxes(view, depths, axes)
    out = np.empty(depths.near_m.shape, bool)
    shaded_by(out, low, high, np.sum(axes * centres_m[:, None, :], axis=2), radius_m)
    return np.asarray(out & np.isfinite(depths.near_m))


def _boxes(view: CameraView, depths: DepthRange, axes: Array) -> tuple[Array, Array]:
    """Least and largest coordinates of the tiles' surfaces along the light's axes, from the eye [m]."""
    camera, (rows, columns) = view.camera, depths.near_m.shape
    u = (np.minimum(np.arange(columns + 1) * TILE_PX, camera.width_px) - 0.5 - camera.cx_px) / camera.fx_px
    v = (np.minimum(np.arange(rows + 1) * TILE_PX, camera.height_px) - 0.5 - camera.cy_px) / camera.fy_px
    turn = np.sum(axes[:, None, :] * view.R_camera_world[None], axis=2)
    rays = u[None, :, None] * turn[:, 0] + v[:, None, None] * turn[:, 1] + turn[:, 2]
    ends = [rays[i : rows + i, j : columns + j] for i in (0, 1) for j in (0, 1)]
    near = np.where(np.isfinite(depths.near_m), depths.near_m, 0.0)
    corners = np.stack([ray * far[..., None] for ray in ends for far in (near, depths.far_m)])
    return corners.min(axis=0), corners.max(axis=0)
