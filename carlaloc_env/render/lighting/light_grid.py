"""Lists of lights by tile of the picture, so that a pixel visits few of many lights.

Tiles with the nearest and farthest depth in them are tested against each light's sphere (tiled shading,
Olsson and Assarsson 2011), then against the light that reaches samples of their surfaces.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import cross
from carlaloc_env.render.lighting.light_sources import (
    Lights,
)
from carlaloc_env.render.lighting.light_tiles import (
    FEW_TILES,
    TILE_PX,
    DepthRange,
    TileGroups,
    every_tile,
)
from carlaloc_env.render.lighting.lit_tiles import keep_lit
from carlaloc_env.render.views import CameraView

GLOW_CUTOFF = 0.004
"""Exposed radiance below which the glow of a lamp in the air is not followed."""
GLOW_LEAST_M, GLOW_MOST_M = 0.3, 8.0
"""Glows that reach less far are left out, and none is followed farther [m]."""
SKY_M = 1000.0
"""How far the air glows before the sky [m]."""
LIGHT_CUTOFF = 3e-4
"""Exposed light of a lamp that no picture shows: half a step of 8 bits at what is dark in a town."""
LOOPS = tuple(
    tuple(name for bit, name in enumerate(("GLOWS", "LAMPS", "BEAMS")) if kind >> bit & 1)
    for kind in range(8)
)
"""Kinds of tiles by the loops that they run, a bit each: a loop without entries costs as one with one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fog:
    """Air that scatters the light of lamps."""

    extinction_per_m: float
    """Where the eye is [1/m]."""
    start_m: float
    """All air nearer than this is clear [m]."""

    def glow_range_m(self, lights: Lights, exposure: float) -> Array:
        """Distance from each lamp up to which the air is followed [m], 0 for lamps too faint, shape (N,)."""
        reach = lights.glow_cd * (0.25 * self.extinction_per_m * exposure / GLOW_CUTOFF)
        return np.where(reach < GLOW_LEAST_M, 0.0, np.minimum(reach, GLOW_MOST_M))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightGrid:
    """Lights of a picture and, tile by tile, which of them to visit."""

    lights: Lights
    glow_range_m: Array
    """How far from each light the air round it is seen to glow [m], shape (N,)."""
    groups: TileGroups
    """Tiles by the loops that they need."""
    entries: NDArray[np.intp]
    """Indices of lights, all lists in one, first those of glows; the very first is −1, which is none."""
    glow_count: int
    """Entries of lists of glows, that of no light among them."""

    @property
    def glows(self) -> NDArray[np.intp]:
        """Entries of lights of the air."""
        return self.entries[: self.glow_count]

    @property
    def lamps(self) -> NDArray[np.intp]:
        """Entries of lights of surfaces."""
        return self.entries[self.glow_count :]


def light_grid(
    view: CameraView,
    lights: Lights,
    depths: DepthRange,
    *,
    exposure: float = 0.0,
    fog: Fog | None = None,
    depth_m: NDArray[np.float32] | None = None,
    normal_codes: NDArray[np.uint16] | None = None,
    least: float = LIGHT_CUTOFF,
) -> LightGrid:
    """Lists of the lights that reach the surfaces and the air in every tile.

    Args:
        view: Camera.
        lights: At most as many as the shaders hold.
        depths: Depths of the surfaces in the tiles.
        exposure: Picture value per luminance [m²/cd].
        fog: Air that glows round the lamps; clear when left out.
        depth_m: Planar depth, 0 = sky, shape (H, W); with it, lamps that light nothing in a tile are
            left out of its lists.
        normal_codes: Octahedral world normals, shape (H, W, 2); with them, lamps that surfaces turn away
            from are left out, too.
        least: Exposed light of one lamp that is not seen.
    """
    ahead = np.where(lights.beam[:, None], 0.5, 0.0) * lights.axis * lights.range_m[:, None]
    centre = lights.position_m + ahead
    radius = np.where(lights.beam, 0.55, 1.0) * lights.range_m
    glow = np.zeros(len(lights)) if fog is None else fog.glow_range_m(lights, exposure)
    near, far = depths.near_m[..., None], depths.far_m[..., None]
    z = _along(view, centre)
    surface = _touched(view, centre, radius, near.shape) & (z + radius > near) & (z - radius < far)
    if depth_m is not None:
        _keep_lit(surface, view, lights, depth_m, exposure, normal_codes, least)
    # The air of a tile reaches from the eye to its farthest surface, or on where there is sky.
    far = np.where(depths.sky[..., None], SKY_M, far)
    glowing = _touched(view, lights.position_m, glow, near.shape) & (glow > 0.0)
    glowing &= _along(view, lights.position_m) - glow < far
    return _packed(lights, glow, surface & ~lights.beam, surface & lights.beam, glowing, depths.shown)


def _keep_lit(
    surface: NDArray[np.bool_],
    view: CameraView,
    lights: Lights,
    depth_m: NDArray[np.float32],
    exposure: float,
    normal_codes: NDArray[np.uint16] | None,
    least: float,
) -> None:
    """Leave only lamps in the lists of tiles (R, C, N) that light what these show."""
    strength = lights.colour_cd.max(axis=1, initial=0.0) * (exposure / math.pi)
    keep_lit(
        surface,
        np.empty((7, TILE_PX * TILE_PX)),
        TILE_PX,
        depth_m,
        np.zeros((0, 0, 2), np.uint16) if normal_codes is None else normal_codes,
        np.array(view.unproject),
        view.R_camera_world,
        lights.position_m - view.position_m,
        lights.axis,
        lights.left,
        cross(lights.axis, lights.left),
        np.column_stack([strength, lights.cap, lights.edge, lights.range_m]),
        lights.beam,
        least,
    )


def _along(view: CameraView, points_m: Array) -> Array:
    """Planar depth of points [m], shape (N,)."""
    return np.asarray(np.sum((points_m - view.position_m) * view.R_camera_world[2], axis=1))


def _touched(view: CameraView, centre_m: Array, radius_m: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether spheres reach into the pyramids of the tiles, shape (R, C, N)."""
    camera = view.camera
    p = np.sum((centre_m - view.position_m)[:, None, :] * view.R_camera_world[None], axis=2)
    masks = []
    for count, axis, size, f, c in (
        (shape[0], 1, camera.height_px, camera.fy_px, camera.cy_px),
        (shape[1], 0, camera.width_px, camera.fx_px, camera.cx_px),
    ):
        edge = (np.minimum(np.arange(count + 1) * TILE_PX, size) - 0.5 - c) / f
        # Distance from the planes x = edge · z, positive towards larger x.
        away = (p[None, :, axis] - edge[:, None] * p[None, :, 2]) / np.sqrt(1.0 + edge[:, None] ** 2)
        masks.append((away[:-1] > -radius_m) & (away[1:] < radius_m))
    ahead = p[:, 2] > -radius_m
    return np.asarray(masks[0][:, None, :] & masks[1][None, :, :] & ahead)


def _packed(
    lights: Lights,
    glow: Array,
    lamps: NDArray[np.bool_],
    beams: NDArray[np.bool_],
    glowing: NDArray[np.bool_],
    shown: NDArray[np.intp],
) -> LightGrid:
    tiles = every_tile(lamps.shape[:2])
    masks = (("glows", glowing), ("lamps", lamps), ("beams", beams))
    lists = [np.array([-1], dtype=np.intp)]
    kind, begin = np.zeros(len(tiles), dtype=np.intp), 1
    for bit, (name, mask) in enumerate(masks):
        owner, light = np.nonzero(mask.reshape(len(tiles), -1))
        lists.append(light)
        ends = begin + np.searchsorted(owner, np.arange(len(tiles) + 1))
        tiles[name] = np.column_stack([ends[:-1], ends[1:]])
        begin = int(ends[-1])
        kind |= (ends[1:] > ends[:-1]).astype(np.intp) << bit
    # Few tiles cost less with loops that they do not need than a program more does.
    every = len(LOOPS) - 1
    kind[np.bincount(kind, minlength=len(LOOPS))[kind] < FEW_TILES] = every
    # A loop that is run without need finds the entry of no light.
    for name in ("glows", "lamps", "beams"):
        idle = (tiles[name][:, 0] == tiles[name][:, 1]) & (kind == every)
        tiles[name][idle] = (0, 1)
    return LightGrid(
        lights=lights,
        glow_range_m=glow,
        groups=TileGroups.sorted_by(tiles, kind, LOOPS, shown.ravel()),
        entries=np.concatenate(lists),
        glow_count=1 + len(lists[1]),
    )
