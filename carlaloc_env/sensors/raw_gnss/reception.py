"""How signals come to an antenna: in sight, blocked, or reflected by one wall of the town."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.raycast import Hits, RayScene
from carlaloc_env.samples.gnss_signals import BLOCKED, REFLECTED
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.timeline import Timeline

SIGHT_M = 800.0
"""Distance within which buildings and hills hide satellites [m]."""
WALLS_M = 150.0
"""Distance within which walls reflect; beyond it receivers tell the late signal apart (half a chip of L1)."""
_AZIMUTHS, _ELEVATIONS_DEG = 120, (4.0, 15.0, 35.0)
"""Rays that search for walls."""
_UPRIGHT = 0.05
"""Largest vertical part of the unit normal of a wall."""
_SAME_M = 0.1
"""Distance of a hit from a wall's plane up to which it is on the wall [m]."""
_GRAZING = 0.02
"""Least cosine between a ray and the normal of a wall that reflects it."""
_LEAF_DB = 6.0
"""Loss in leaves [dB]."""
ANTENNA_DB = 3.0
"""Further loss of a reflected signal, whose turn of polarisation is wrong for the antenna [dB]."""
_PERMITTIVITY = {
    Material.GLASS: 6.31, Material.WINDOW: 6.31, Material.SHOP_FRONT: 6.31, Material.CURTAIN_WALL: 6.31,
    Material.BRICK_RED: 3.91, Material.BRICK_BROWN: 3.91, Material.WOOD: 1.99, Material.SIDING: 1.99,
    Material.METAL_GALVANISED: 1e6, Material.METAL_PAINTED: 1e6, Material.SHEET_METAL: 1e6,
}  # fmt: skip
"""Relative permittivities (ITU-R P.2040-3, table 3); other walls are concrete."""
_CONCRETE = 5.24


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reception:
    """Ways of N satellites' signals to an antenna."""

    state: NDArray[np.uint8]
    """`IN_SIGHT`, `REFLECTED` or `BLOCKED`, shape (N,)."""
    loss_db: Array
    """Loss by leaves and reflection [dB], shape (N,)."""
    extra_m: Array
    """Detour of the reflected path [m], 0 in sight, shape (N,)."""
    normal: Array
    """Unit normal of the wall, towards the antenna, world; zeros without a wall, shape (N, 3)."""
    wall_m: Array
    """Where the wall reflects, world [m]; NaN without a wall, shape (N, 3)."""
    wall_tag: NDArray[np.uint8]
    """Semantic `Tag` of the wall, shape (N,)."""

    @classmethod
    def open_sky(cls, count: int) -> Reception:
        """All signals in sight."""
        zero, none = np.zeros(count, np.uint8), np.zeros((count, 3))
        return cls(
            state=zero, loss_db=np.zeros(count), extra_m=np.zeros(count), normal=none,
            wall_m=np.full((count, 3), np.nan), wall_tag=zero.copy(),
        )  # fmt: skip


def receive(rays: RayScene, timeline: Timeline, stamp_ns: int, antenna_m: Array, to: Array) -> Reception:
    """Ways of signals to an antenna at an instant.

    Args:
        rays: The town.
        timeline: Where everything is; the ego's own body hides nothing.
        stamp_ns: When [ns].
        antenna_m: The antenna, world [m], shape (3,).
        to: Unit vectors to the satellites, world, shape (N, 3).
    """
    ways = Reception.open_sky(len(to))
    clear, ways.loss_db[:] = _passing(_cast(rays, timeline, stamp_ns, antenna_m, to))
    ways.state[~clear] = BLOCKED
    hidden = np.flatnonzero(~clear)
    if len(hidden):
        _reflect(rays, timeline, stamp_ns, antenna_m, to, hidden, ways)
    return ways


def _cast(rays: RayScene, timeline: Timeline, stamp_ns: int, from_m: Array, to: Array) -> Hits:
    """What rays meet, the ego's own body left out."""
    origins = np.broadcast_to(from_m, to.shape)
    return rays.cast(origins, to, np.full(len(to), stamp_ns), timeline, SIGHT_M, ego=False)


def _passing(hits: Hits) -> tuple[NDArray[np.bool_], Array]:
    """Whether nothing but leaves lies on rays, and the leaves' loss [dB]."""
    met = np.isfinite(hits.range_m)
    leaves = met & (hits.tag == Tag.VEGETATION)
    return ~met | leaves, np.where(leaves, _LEAF_DB, 0.0)


def _reflect(
    rays: RayScene,
    timeline: Timeline,
    stamp_ns: int,
    antenna_m: Array,
    to: Array,
    hidden: NDArray[np.intp],
    ways: Reception,
) -> None:
    """Put the strongest reflection of each hidden satellite where there is one.

    Mirrored at a wall with the unit normal n, a satellite in direction s is seen in s − 2(s·n)n. The path by
    the wall at distance D is 2·D·(s·n) longer than the straight one.
    """
    normals, distances = _walls(rays, antenna_m)
    cosines = np.sum(to[hidden, None, :] * normals[None], axis=-1)
    satellite, wall = np.nonzero(cosines > _GRAZING)
    cosine, normal = cosines[satellite, wall], normals[wall]
    along_m, satellite = distances[wall] / cosine, hidden[satellite]
    mirrored = to[satellite] - 2.0 * cosine[:, None] * normal
    # The town alone refuses most; the movers of the two ways of the rest are looked for together.
    found = rays.cast_town(np.broadcast_to(antenna_m, mirrored.shape), mirrored, SIGHT_M)
    rows = _on_wall(found, along_m, cosine)
    if not len(rows):
        return
    satellite, cosine, normal, along_m = satellite[rows], cosine[rows], normal[rows], along_m[rows]
    at_m = antenna_m + along_m[:, None] * mirrored[rows]
    starts_m = np.concatenate([np.broadcast_to(antenna_m, at_m.shape), at_m + 0.02 * normal])
    both = _cast(rays, timeline, stamp_ns, starts_m, np.concatenate([mirrored[rows], to[satellite]]))
    hits = both.take(np.arange(len(rows)))
    clear, leaves_db = (part[len(rows) :] for part in _passing(both))
    loss = leaves_db + reflection_db(hits.material, cosine)
    # The strongest reflection of each satellite is written last.
    order = _on_wall(hits, along_m, cosine)
    order = order[clear[order]]
    order = order[np.argsort(-loss[order], kind="stable")]
    chosen = satellite[order]
    ways.state[chosen], ways.loss_db[chosen] = REFLECTED, loss[order]
    ways.extra_m[chosen] = 2.0 * along_m[order] * cosine[order] * cosine[order]
    ways.normal[chosen], ways.wall_m[chosen] = normal[order], at_m[order]
    ways.wall_tag[chosen] = hits.tag[order]


def _on_wall(hits: Hits, along_m: Array, cosine: Array) -> NDArray[np.intp]:
    """Rows of the rays that end on the planes which they meet after some way at some angle."""
    near = np.abs(hits.range_m - along_m) * cosine < _SAME_M
    return np.flatnonzero(near & (hits.tag != Tag.VEGETATION))


def _walls(rays: RayScene, antenna_m: Array) -> tuple[Array, Array]:
    """Planes of upright surfaces around: unit normals towards the antenna (K, 3) and distances [m] (K,)."""
    fan = _fan()
    hits, normals = rays.surfaces(antenna_m, fan, WALLS_M)
    upright = np.abs(normals[:, 2]) < _UPRIGHT
    keep = np.isfinite(hits.range_m) & upright & (hits.tag != Tag.VEGETATION)
    normal, away = normals[keep], hits.range_m[keep, None] * fan[keep]
    normal[:, 2] = 0.0
    normal /= np.hypot(normal[:, 0], normal[:, 1])[:, None]
    distance = np.sum(normal * away, axis=-1)
    normal *= -np.sign(distance)[:, None]
    distance = np.abs(distance)
    # Planes that agree to 1° and half a metre are one.
    east, north, far = (np.rint(x).astype(np.int64) for x in (*(normal[:, :2] * 50.0).T, distance / 0.5))
    _, first = np.unique((far * 128 + east) * 128 + north, return_index=True)
    first = np.sort(first)
    return normal[first], distance[first]


@functools.cache
def _fan() -> Array:
    """Directions of the rays that search for walls, shape (N, 3)."""
    azimuth = np.tile(np.arange(_AZIMUTHS) * (2.0 * math.pi / _AZIMUTHS), len(_ELEVATIONS_DEG))
    up = np.repeat(np.radians(_ELEVATIONS_DEG), _AZIMUTHS)
    flat = elementary.cos(up)
    return np.stack(
        [flat * elementary.cos(azimuth), flat * elementary.sin(azimuth), elementary.sin(up)], axis=-1
    )


def reflection_db(material: NDArray[np.uint8], cosine: Array) -> Array:
    """Loss of a reflection [dB]: Fresnel's mean power of both polarisations, and `ANTENNA_DB`.

    Args:
        material: `Material` of the surface, shape (N,).
        cosine: Cosine of the angle between the ray and the normal, shape (N,).
    """
    table = np.full(len(Material), _CONCRETE)
    table[[int(one) for one in _PERMITTIVITY]] = list(_PERMITTIVITY.values())
    permittivity = table[material]
    inside = np.sqrt(permittivity - 1.0 + cosine * cosine)
    across = (cosine - inside) / (cosine + inside)
    along = (permittivity * cosine - inside) / (permittivity * cosine + inside)
    power = np.maximum(0.5 * (across * across + along * along), 1e-6)
    loss: Array = ANTENNA_DB - 10.0 * elementary.log10(power)
    return loss
