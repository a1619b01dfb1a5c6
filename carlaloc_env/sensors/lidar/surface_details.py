"""Details of things that their meshes and mean reflectances lack: coats, panes and single leaves.

Houses, cars and trees of one material differ: uprights 12 to 20 m from the car of a public scan (nuScenes,
Caesar et al., CVPR 2020) have codes from 3 to 70. A pane of clean glass sends nothing back unless it is met
face on: a beam on a window ends at its frame, at what stands behind the glass, or nowhere. A leaf hangs at
any angle: of leaves at all angles the share 2c·dc of the seen area has cosines of c to c + dc (the spherical
distribution of de Wit, 1965). Places and coats are drawn once for all, the same in all sweeps and seeds.
"""

import math

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary, elementary_kernels
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.raycast import Hits
from carlaloc_env.raycast.foliage import CELL_M
from carlaloc_env.scene.materials import Material
from carlaloc_env.sensors.lidar.reflection import reflection_table

DARKEST, PALEST = 0.15, 2.4
"""Ends of the reflectances of things over that of their material: coats of paint, dirt, density of crowns.

Their logarithm is evenly spread. An estimate that gives the codes above."""
WHITEST = 0.9
"""Most that a thing reflects, as fresh white paint."""
FRAME = 0.35
"""Reflectance of frames, as of painted metal."""
DUST = 0.0005
"""What clean glass scatters back: dust that takes half a per cent of the light sends a tenth of it there."""
_WINDOW, _SHOP = (0.25, 0.35, 0.18, 0.10), (0.12, 0.45, 0.18, 0.80)
PANES: dict[Material, tuple[float, float, float, float]] = {
    **dict.fromkeys((Material.WINDOW, Material.WINDOW_WIDE), _WINDOW),
    **dict.fromkeys((Material.SHOP_FRONT, Material.SHOP_FRONT_B), _SHOP),
    Material.CURTAIN_WALL: (0.14, 0.35, 0.03, 0.10),
}
"""Share of frames, share of things behind the glass, their reflectance through it, their mean depth [m].

Shares are about those of the pictures of `render.textures`. Light crosses the glass twice: 0.3 of it come
back through double panes, 0.5 through a shop's single one, 0.06 through panes coated against the sun
(EN 410 has transmittances), from blinds of 0.6, goods of 0.35 and dark panels. Depths fall off exponentially.
"""
_FRAME_CELL_M, _THING_CELL_M = 0.25, 0.8
"""Places of this size belong to a frame or not, and have something behind them or not [m]."""
_EAST, _NORTH = 0.8290, 0.5592
"""The places' lattice is turned, so that walls along the axes do not lie between two of its cells."""
_SPREAD = float(elementary.log(np.float64(PALEST / DARKEST)))
_DIFFUSE = np.maximum(reflection_table().diffuse, 1e-6)
_MOST = WHITEST / _DIFFUSE
_PANES = np.array([PANES.get(kind, (0.0,) * 4) for kind in Material])
_PARTS = np.stack([FRAME / _DIFFUSE, _PANES[:, 2] / _DIFFUSE, DUST / _DIFFUSE], axis=1)
_LEAF = int(Material.LEAF)


def surface_details(rays: F32, hits: Hits, middle_m: Array) -> tuple[Index, F32, F32]:
    """Details of the things that rays hit; the ground has none. Leaves' cosines are put into the hits.

    Args:
        rays: Rays as `RayScene.trace` takes them, shape (N, 6).
        hits: What they meet, shape (N,).
        middle_m: World coordinates of the rays' origin of coordinates [m], shape (3,).

    Returns:
        Rows of M hits, reflectance there over the material's, and height above the mesh [m], below 0 behind
        a pane, each (M,).
    """
    rows = np.flatnonzero((hits.instance > 0) & np.isfinite(hits.range_m))
    thing_hits = hits.take(rows)
    share, height_m = np.ones(len(rows), np.float32), np.zeros(len(rows), np.float32)
    places_m = rays[rows, :3] + rays[rows, 3:] * thing_hits.range_m[:, None] + middle_m
    _details(places_m, thing_hits.material, thing_hits.instance, (thing_hits.cos_incidence, share, height_m))
    hits.cos_incidence[rows] = thing_hits.cos_incidence
    return rows, share, height_m


@inlined
def _chance(x: float, y: float, z: float, cell_m: float, kind: int) -> float:
    """Random number of (0, 1) of the cell that holds a place; numbers of several kinds are independent."""
    low, h = np.uint64(0xFFFFFFFF), np.uint64(kind)
    for at in (x * _EAST - y * _NORTH, x * _NORTH + y * _EAST, z):
        h = ((h ^ np.uint64(math.floor(at / cell_m))) * np.uint64(0x9E3779B1)) & low
        h ^= h >> np.uint64(15)
    h = (h * np.uint64(0x2C1B3C6D)) & low
    h ^= h >> np.uint64(13)
    return (float(h >> np.uint64(8)) + 0.5) / 16777216.0


@compiled
def _details(
    places_m: Array, material: NDArray[np.uint8], instance: NDArray[np.uint32], out: tuple[F32, F32, F32]
) -> None:
    cosine, share, height_m = out
    for i in range(len(places_m)):
        x, y, z = places_m[i, 0], places_m[i, 1], places_m[i, 2]
        kind = material[i]
        coat = _chance(float(instance[i]), float(kind), 0.0, 1.0, 1)
        share[i] = min(DARKEST * elementary_kernels.exp(_SPREAD * coat), _MOST[kind])
        if kind == _LEAF:
            cosine[i] = math.sqrt(_chance(x, y, z, CELL_M, 2))
        frames, things, _, depth_m = _PANES[kind]
        if frames == 0.0:
            continue
        if _chance(x, y, z, _FRAME_CELL_M, 3) < frames:
            share[i] = _PARTS[kind, 0]
        elif _chance(x, y, z, _THING_CELL_M, 4) < things / (1.0 - frames):
            share[i] = _PARTS[kind, 1]
            height_m[i] = depth_m * elementary_kernels.log(_chance(x, y, z, _FRAME_CELL_M, 5))
        else:
            share[i] = _PARTS[kind, 2]
