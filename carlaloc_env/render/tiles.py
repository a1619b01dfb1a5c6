"""Which lights reach which part of a picture: lists by tile, so that a pixel visits few of many lights.

Tiles of 32 pixels with the nearest and farthest depth in them are tested against each light's sphere
(tiled shading, Olsson and Assarsson 2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.geometry import cross
from carlaloc_env.render.lights import Lights
from carlaloc_env.render.projection import View
from carlaloc_env.render.tile_kernels import depth_ranges, keep_lit

Array = NDArray[np.float64]

TILE_PX = 32
GLOW_CUTOFF = 0.004
"""Exposed radiance below which the glow of a lamp in the air is not followed."""
GLOW_MOST_M = 8.0
LIGHT_CUTOFF = 3e-4
"""Exposed light of a lamp that no picture shows: half a step of 8 bits at what is dark in a town."""

FEW_TILES = 16
"""Kinds of tiles of which there are fewer run all loops."""

TILE = np.dtype([("place", "<u4", 2), ("lamps", "<u4", 2), ("beams", "<u4", 2), ("glows", "<u4", 2)])
"""One tile: column and row, then the first entry and the end of its lists."""


LOOPS: tuple[tuple[str, ...], ...] = (
    (),
    ("GLOWS",),
    ("LAMPS",),
    ("GLOWS", "LAMPS"),
    ("BEAMS",),
    ("GLOWS", "BEAMS"),
    ("LAMPS", "BEAMS"),
    ("GLOWS", "LAMPS", "BEAMS"),
)
"""Kinds of tiles by the loops that they run, a bit each: a loop without entries costs as one with one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthRange:
    """Nearest and farthest surface in every tile, planar [m]; nearest = inf where there is sky only."""

    near_m: Array
    """Shape (R, C)."""
    far_m: Array
    """Shape (R, C)."""

    @classmethod
    def of(cls, depth_m: NDArray[np.float32]) -> DepthRange:
        """Ranges of a depth picture (H, W) with 0 = sky."""
        shape = tuple(-(-size // TILE_PX) for size in depth_m.shape)
        near, far = np.empty(shape), np.empty(shape)
        depth_ranges(near, far, depth_m, TILE_PX)
        return cls(near_m=near, far_m=far)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightGrid:
    """Lights of a picture and, tile by tile, which of them to visit."""

    lights: Lights
    glow_range_m: Array
    """How far from each light the air round it is seen to glow [m], shape (N,)."""
    tiles: NDArray[np.void]
    """`TILE` rows, sorted by the loops that they need."""
    groups: dict[tuple[str, ...], tuple[int, int]]
    """By the loops: first tile and how many."""
    entries: NDArray[np.intp]
    """Indices of lights, all lists in one, first those of glows; the very first is −1, which is none."""
    glow_count: int
    """Entries of lists of glows, that of no light among them."""

    @property
    def glows(self) -> NDArray[np.intp]:
        """Entries of what lights the air."""
        return self.entries[: self.glow_count]

    @property
    def lamps(self) -> NDArray[np.intp]:
        """Entries of what lights surfaces."""
        return self.entries[self.glow_count :]


def light_grid(
    view: View,
    lights: Lights,
    depths: DepthRange,
    glow_per_cd: float,
    *,
    depth_m: NDArray[np.float32] | None = None,
    exposure: float = 0.0,
    normal_codes: NDArray[np.uint16] | None = None,
) -> LightGrid:
    """Lists of the lights that reach the surfaces and the air in every tile.

    Args:
        view: Camera.
        lights: At most as many as the shaders hold.
        depths: What the tiles show.
        glow_per_cd: Exposed radiance at 1 m beside a lamp of 1 cd, seen through endless air.
        depth_m: Planar depth, 0 = sky, shape (H, W); with it, lamps that light nothing in a tile are
            left out of its lists.
        exposure: Picture value per luminance [m²/cd].
        normal_codes: Octahedral world normals, shape (H, W, 2); with them, lamps that surfaces turn away
            from are left out, too.
    """
    centre = (
        lights.position_m + np.where(lights.beam[:, None], 0.5, 0.0) * lights.axis * (lights.range_m[:, None])
    )
    radius = np.where(lights.beam, 0.55, 1.0) * lights.range_m
    glow = np.minimum(lights.glow_cd * glow_per_cd / GLOW_CUTOFF, GLOW_MOST_M)
    glow = np.where(glow < 0.3, 0.0, glow)
    near, far = depths.near_m[..., None], depths.far_m[..., None]
    z = _along(view, centre)
    surface = _touched(view, centre, radius, near.shape) & (z + radius > near) & (z - radius < far)
    if depth_m is not None:
        _keep_lit(surface, view, lights, depth_m, exposure, normal_codes)
    # The air of a tile reaches from the eye to its farthest surface, or on where there is sky.
    sky = ~np.isfinite(near) | (far > 200.0)
    air = _touched(view, lights.position_m, glow, near.shape) & (glow > 0.0)
    air &= sky | (_along(view, lights.position_m) - glow < far)
    return _packed(lights, glow, surface & ~lights.beam, surface & lights.beam, air)


def _keep_lit(
    surface: NDArray[np.bool_],
    view: View,
    lights: Lights,
    depth_m: NDArray[np.float32],
    exposure: float,
    normal_codes: NDArray[np.uint16] | None,
) -> None:
    """Leave only lamps in the lists of tiles (R, C, N) that light what these show."""
    camera = view.camera
    keep_lit(
        surface,
        np.empty((TILE_PX * TILE_PX, 6)),
        TILE_PX,
        depth_m,
        np.zeros((0, 0, 2), np.uint16) if normal_codes is None else normal_codes,
        np.array(
            [1 / camera.fx_px, 1 / camera.fy_px, -camera.cx_px / camera.fx_px, -camera.cy_px / camera.fy_px]
        ),
        view.R_camera_world,
        lights.position_m - view.position_m,
        lights.axis,
        lights.left,
        cross(lights.axis, lights.left),
        np.column_stack(
            [
                lights.colour_cd.max(axis=1, initial=0.0) * (exposure / math.pi),
                lights.cap,
                lights.edge,
                lights.range_m,
            ]
        ),
        lights.beam,
        LIGHT_CUTOFF,
    )


def _along(view: View, points_m: Array) -> Array:
    """Planar depth of points [m], shape (N,)."""
    return np.asarray(np.sum((points_m - view.position_m) * view.R_camera_world[2], axis=1))


def _touched(view: View, centre_m: Array, radius_m: Array, shape: tuple[int, ...]) -> NDArray[np.bool_]:
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
    air: NDArray[np.bool_],
) -> LightGrid:
    rows, columns = lamps.shape[:2]
    tiles = np.zeros(rows * columns, dtype=TILE)
    tiles["place"][:, 0] = np.tile(np.arange(columns), rows)
    tiles["place"][:, 1] = np.repeat(np.arange(rows), columns)
    entries = [np.array([-1], dtype=np.intp)]
    kind, begin = np.zeros(len(tiles), dtype=np.intp), 1
    for bit, (name, mask) in enumerate((("glows", air), ("lamps", lamps), ("beams", beams))):
        flat = mask.reshape(rows * columns, len(lights))
        count = np.count_nonzero(flat, axis=1)
        end = begin + np.cumsum(count)
        tiles[name] = np.column_stack([end - count, end])
        entries.append(np.nonzero(flat)[1])
        begin = int(end[-1])
        kind |= (count > 0).astype(np.intp) << bit
    # Few tiles cost less with loops that they do not need than a program more does.
    kind[np.bincount(kind, minlength=len(LOOPS))[kind] < FEW_TILES] = len(LOOPS) - 1
    # A loop that is run without need finds the entry of no light.
    for name in ("glows", "lamps", "beams"):
        idle = (tiles[name][:, 0] == tiles[name][:, 1]) & (kind == len(LOOPS) - 1)
        tiles[name][idle] = (0, 1)
    ends = np.cumsum(np.bincount(kind, minlength=len(LOOPS)))
    return LightGrid(
        lights=lights,
        glow_range_m=glow,
        tiles=tiles[np.argsort(kind, kind="stable")],
        groups={
            loops: (int(end - many), int(many))
            for loops, end, many in zip(LOOPS, ends, np.diff(ends, prepend=0), strict=True)
        },
        entries=np.concatenate(entries),
        glow_count=len(entries[0]) + len(entries[1]),
    )
