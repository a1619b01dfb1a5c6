"""Radar equation: from echoes to detections, with fluctuation, resolution cells and errors.

All functions are pure; angles in radians, levels in dB, detections as parallel arrays.

Radar cross-sections at 77 GHz of road users, and reflectivity of scenery.

Directions as a radar counts them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.timeline.ego_spline import Motion


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RadarEchoes:
    """Scatterers in the radar's view, N of them."""

    range_m: Array
    """Distance [m], shape (N,)."""
    azimuth_rad: Array
    """Angle to the left of the x axis [rad], shape (N,)."""
    elevation_rad: Array
    """Angle above the x-y plane [rad], shape (N,)."""
    doppler_mps: Array
    """Rate of the distance [m/s], positive = moving away, shape (N,)."""
    rcs_m2: Array
    """Mean radar cross-section [m²], shape (N,)."""
    tag: NDArray[np.uint8]
    """Semantic `Tag`, shape (N,)."""
    instance: NDArray[np.uint32]
    """Instance id, 0 = none, shape (N,)."""

    def __len__(self) -> int:
        return len(self.range_m)

    def take(self, rows: NDArray[np.intp]) -> RadarEchoes:
        """Some of the echoes."""
        return RadarEchoes(**{name: getattr(self, name)[rows] for name in self.__slots__})


def join(parts: list[RadarEchoes]) -> RadarEchoes:
    """All echoes of several groups, in their order."""
    return RadarEchoes(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in RadarEchoes.__slots__}
    )


def snr_at(pd: float, pfa: float) -> float:
    """Mean signal-to-noise ratio at which a Swerling-1 target is detected with probability `pd`.

    Inverse of P_d = P_fa^(1/(1+S)) (Swerling 1954; Skolnik, "Introduction to Radar Systems").
    """
    return float(elementary.log(pfa) / elementary.log(pd)) - 1.0


def merge_cells(echoes: RadarEchoes, cell: tuple[float, float, float, float]) -> RadarEchoes:
    """One echo per resolution cell: cross-sections add, the position is their power-weighted middle.

    The strongest scatterer lends its tag and instance.

    Args:
        echoes: Scatterers.
        cell: Size of a cell in range [m], azimuth [rad], elevation [rad] and Doppler [m/s].
    """
    if len(echoes) == 0:
        return echoes
    values = (echoes.range_m, echoes.azimuth_rad, echoes.elevation_rad, echoes.doppler_mps)
    key = np.zeros(len(echoes), dtype=np.int64)
    for value, size in zip(values, cell, strict=True):
        key = key * 4096 + (np.floor(value / size).astype(np.int64) + 2048)
    order = np.lexsort((-echoes.rcs_m2, key))
    sorted_key = key[order]
    begins = np.flatnonzero(np.concatenate([[True], sorted_key[1:] != sorted_key[:-1]]))
    weight = echoes.rcs_m2[order]
    total = np.add.reduceat(weight, begins)

    def mean(value: Array) -> Array:
        summed: Array = np.add.reduceat(value[order] * weight, begins) / total
        return summed

    strongest = order[begins]
    range_m, azimuth, elevation, doppler = (mean(value) for value in values)
    return RadarEchoes(
        range_m=range_m,
        azimuth_rad=azimuth,
        elevation_rad=elevation,
        doppler_mps=doppler,
        rcs_m2=total,
        tag=echoes.tag[strongest],
        instance=echoes.instance[strongest],
    )


def mean_snr(
    range_m: Array,
    rcs_m2: Array,
    *,
    at_reference: float,
    reference_m: float,
    pattern: Array,
    loss_db_per_m: float = 0.0,
) -> Array:
    """Mean signal-to-noise ratio of echoes, linear, shape (N,); falls with R⁻⁴ (radar equation).

    Args:
        range_m: Distances of scatterers or cells [m], shape (N,).
        rcs_m2: Their mean radar cross-sections [m²], shape (N,).
        at_reference: Ratio of a target of 1 m² on the axis at the reference distance.
        reference_m: Reference distance [m].
        pattern: Two-way antenna gain relative to the axis, linear, shape (N,).
        loss_db_per_m: One-way attenuation of the air [dB/m].
    """
    ratio = reference_m / range_m
    squared = ratio * ratio
    air: Array = elementary.power(10.0, -0.2 * loss_db_per_m * range_m)
    return at_reference * rcs_m2 * squared * squared * pattern * air


def detect(snr: Array, pfa: float, uniform: Array) -> tuple[NDArray[np.intp], Array]:
    """Which fluctuating echoes cross the threshold of a square-law detector, and how far.

    The detector's output of a Swerling-1 target is exponential with mean 1 + S; the threshold
    −ln P_fa gives P_d = P_fa^(1/(1+S)).

    Args:
        snr: Mean ratios, linear, shape (N,).
        pfa: Probability of a false alarm per cell.
        uniform: Uniform numbers of (0, 1], shape (N,).

    Returns:
        Indices of detections (M,) and their measured ratios, linear (M,).
    """
    output = -(1.0 + snr) * elementary.log(uniform)
    seen = np.flatnonzero(output > -elementary.log(pfa))
    return seen, output[seen] - 1.0


def errors(snr: Array, resolution: float, normal: Array) -> Array:
    """Measuring errors: standard deviation resolution / √(2 SNR), no less than a tenth of the resolution.

    The bound of a single echo's delay, angle or frequency (Richards, "Fundamentals of Radar Signal
    Processing", ch. 7); the floor stands for quantisation and calibration.
    """
    return normal * np.maximum(resolution / np.sqrt(2.0 * snr), 0.1 * resolution)


RAIN_77_GHZ = (1.13, 0.718)
"""k and α of γ = k·R^α [dB/km], R in mm/h, at 77 GHz; ITU-R P.838-3, between its rows of 70 and 80 GHz."""


def rain_loss_db_per_m(rain_mmph: float) -> float:
    """One-way attenuation by rain at 77 GHz [dB/m]; fog and dust are negligible at 4 mm wavelength."""
    k, alpha = RAIN_77_GHZ
    return 1e-3 * k * float(elementary.power(rain_mmph, alpha)) if rain_mmph > 0 else 0.0


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


PATCH_M = 0.5
"""Size of a patch of scenery that keeps its own strength [m]."""


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


def polar(local_m: Array) -> tuple[Array, Array, Array]:
    """Distance [m], azimuth and elevation [rad] of points (N, 3) in a sensor's frame."""
    flat = np.sqrt(local_m[:, 0] * local_m[:, 0] + local_m[:, 1] * local_m[:, 1])
    distance = np.sqrt(flat * flat + local_m[:, 2] * local_m[:, 2])
    return distance, elementary.arctan2(local_m[:, 1], local_m[:, 0]), elementary.arctan2(local_m[:, 2], flat)


def direction(azimuth_rad: Array, elevation_rad: Array) -> Array:
    """Unit vectors at azimuths and elevations of one shape, shape (..., 3)."""
    flat, up = elementary.cos(elevation_rad), elementary.sin(elevation_rad)
    return np.stack([flat * elementary.cos(azimuth_rad), flat * elementary.sin(azimuth_rad), up], axis=-1)


def into(motion: Motion, vectors: Array) -> Array:
    """Vectors (N, 3) from world axes to those of the radar."""
    return transforms.quat_rotate(transforms.quat_conjugate(motion.quat_xyzw), vectors)


def out_of(motion: Motion, vectors: Array) -> Array:
    """Vectors (N, 3) from the axes of the radar to those of the world."""
    return transforms.quat_rotate(motion.quat_xyzw, vectors)


def dot(vectors: Array, other: Array) -> Array:
    """Scalar products of vectors (N, 3) with others or with one, shape (N,), without BLAS."""
    product = vectors * other
    result: Array = product[:, 0] + product[:, 1] + product[:, 2]
    return result
