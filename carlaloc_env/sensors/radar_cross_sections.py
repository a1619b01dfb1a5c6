"""Radar cross-sections of road users at 77 GHz, and reflectivity of scenery."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.semantic_tags import Tag

RCS_DBSM: dict[Tag, tuple[float, float, float, float]] = {
    Tag.PEDESTRIAN: (-5.0, -5.0, -4.0, -6.0),
    Tag.RIDER: (0.0, 0.0, 3.0, -1.0),
    Tag.BICYCLE: (0.0, 0.0, 3.0, -1.0),
    Tag.MOTORCYCLE: (3.0, 3.0, 6.0, 1.0),
    Tag.CAR: (11.0, 13.0, 18.0, 6.0),
    Tag.TRUCK: (18.0, 20.0, 25.0, 12.0),
    Tag.BUS: (20.0, 22.0, 28.0, 13.0),
    Tag.TRAIN: (25.0, 25.0, 33.0, 18.0),
}
"""Mean radar cross-section seen from the front, from behind, from the side and from a corner [dBsm].

Levels within the ranges of published 76–81 GHz measurements: pedestrians −10…0 dBsm (Yamada 2005;
Chen et al. 2014), cyclists −5…5 (Stolz et al. 2018), cars 0…20 with flashes at the four faces
(Geary et al. 2012; Kamel et al. 2017), trucks and buses 10…30.
"""
_FLASH_RAD = np.radians(14.0)
"""Width (one σ) of the flashes at the four faces."""
REFLECTIVITY_DB: dict[Tag, float] = {
    Tag.UNLABELED: -12.0,
    Tag.ROAD: -44.0,
    Tag.SIDEWALK: -40.0,
    Tag.BUILDING: -33.0,
    Tag.WALL: -33.0,
    Tag.FENCE: -5.0,
    Tag.POLE: 2.0,
    Tag.TRAFFIC_LIGHT: 3.0,
    Tag.TRAFFIC_SIGN: 8.0,
    Tag.VEGETATION: -19.0,
    Tag.TERRAIN: -32.0,
    Tag.STATIC: -4.0,
    Tag.DYNAMIC: -4.0,
    Tag.OTHER: -8.0,
    Tag.WATER: -45.0,
    Tag.ROAD_LINE: -44.0,
    Tag.GROUND: -38.0,
    Tag.BRIDGE: -33.0,
    Tag.RAIL_TRACK: -8.0,
    Tag.GUARD_RAIL: 3.0,
}
"""γ of the constant-γ model: cross-section per projected area of scenery, mean over aspects [dB].

Ours: in order of roughness (Ulaby and Dobson, "Handbook of Radar Scattering Statistics for Terrain",
1989), at levels that leave a street the ~250 detections a frame of the CARLA-Loc paper's radars;
smooth walls send most of their power away unless they are met at a right angle.
"""
SPECULAR_DB = 24.0
"""Gain of walls, signs and rails met at a right angle over their mean [dB]."""
_SPECULAR_RAD = np.radians(9.0)
"""Width (one σ) of that gain [rad]."""
_SMOOTH = (Tag.BUILDING, Tag.WALL, Tag.TRAFFIC_SIGN, Tag.GUARD_RAIL, Tag.BRIDGE)
"""Tags of surfaces that have it."""
REFLECTORS = (Tag.BUILDING, Tag.WALL, Tag.GUARD_RAIL, Tag.BRIDGE)
"""Tags of surfaces large and smooth enough at 4 mm wavelength to show mirror images."""
_TABLE = np.full(256, REFLECTIVITY_DB[Tag.UNLABELED])
"""Reflectivity by tag [dB], (256,)."""
for _tag, _level in REFLECTIVITY_DB.items():
    _TABLE[_tag] = _level
_ASPECTS = np.tile(np.array(RCS_DBSM[Tag.CAR]), (256, 1))
"""Cross-sections by tag, columns as in `RCS_DBSM` [dBsm], (256, 4)."""
for _tag, _levels in RCS_DBSM.items():
    _ASPECTS[_tag] = _levels
PATCH_M = 0.5
"""Size of a patch of scenery that keeps its own strength [m]."""


def actor_rcs_dbsm(tag: NDArray[np.uint8], aspect_rad: Array) -> Array:
    """Mean radar cross-section of actors [dBsm], shape (N,).

    Args:
        tag: Semantic tags, shape (N,).
        aspect_rad: Angle between the actor's nose and the direction to the radar [rad], shape (N,).
    """
    front, back, side, corner = _ASPECTS[tag].T
    from_nose = np.abs(elementary.arctan2(elementary.sin(aspect_rad), elementary.cos(aspect_rad)))
    level: Array = corner.copy()
    for peak, at in ((front, 0.0), (side, 0.5 * np.pi), (back, np.pi)):
        off = (from_nose - at) / _FLASH_RAD
        level = level + (peak - corner) * elementary.exp(-0.5 * off * off)
    return level


def texture(points_m: Array) -> Array:
    """Strength of the patch of scenery at each point over the mean, linear, mean 1, shape (N,).

    A surface is a few strong scatterers among many weak ones: Weibull clutter of shape ½ (Ward, Tough
    and Watts, "Sea Clutter", 2006, ch. 5; used for land as well). The strength belongs to the position,
    so that the same window ledge is seen again and again while the car passes.

    Args:
        points_m: Points in the world [m], shape (N, 3).
    """
    cell = np.floor(points_m / PATCH_M).astype(np.int64).astype(np.uint64)
    key = cell[:, 0] * np.uint64(0x9E3779B97F4A7C15)
    key ^= cell[:, 1] * np.uint64(0xC2B2AE3D27D4EB4F) ^ cell[:, 2] * np.uint64(0x165667B19E3779F9)
    # The finaliser of SplitMix64 makes the three products one even number.
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        key = (key ^ (key >> np.uint64(shift))) * np.uint64(factor)
    key ^= key >> np.uint64(31)
    uniform = ((key >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    log = elementary.log(uniform)
    strength: Array = 0.5 * log * log
    return strength


def scenery_db(tag: NDArray[np.uint8], cos_incidence: NDArray[np.float32]) -> Array:
    """Cross-section per projected area of scenery [dB], shape (N,).

    Args:
        tag: Semantic tags, shape (N,).
        cos_incidence: Cosine between ray and surface normal, shape (N,).
    """
    off = elementary.arccos(np.clip(cos_incidence.astype(np.float64), 0.0, 1.0)) / _SPECULAR_RAD
    flash = SPECULAR_DB * elementary.exp(-0.5 * off * off) * np.isin(tag, _SMOOTH)
    result: Array = _TABLE[tag] + flash
    return result
