"""A pulsed receiver, from hits to measurements: echoes detected or lost, ranges, intensities.

The amplitude of an echo over that of the weakest one is ρ(θ)·s·f·(reach/R)³/0.1 with the reflectance
towards the source ρ(θ), the stretching s of pulses on slanting ground and the focus f near the sensor. Of a
pulse that is n times as long, a filter matched to it finds n^(−½) of the amplitude for the same energy. The
power of each shot follows from the last echo of its laser. So the first shot behind a near, bright surface
may be too weak for a far, dark one, and the first on the bright surface so strong that it has no time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock, elementary_kernels
from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.raycast import Hits
from carlaloc_env.road.road_profile import RoughTable, level_at
from carlaloc_env.road.rough_surface import class_level, wave_height
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.lidar.atmosphere import GROUND_TAGS
from carlaloc_env.sensors.lidar.reflection import (
    GRAIN_M,
    ReflectionTable,
    reflectance_towards_source,
    reflection_table,
)
from carlaloc_env.sensors.lidar_config import LidarConfig, ReceiverConfig

ROAD_TAGS = (Tag.ROAD, Tag.ROAD_LINE)
_SPREAD = 1.0 / math.sqrt(12.0)
"""Standard deviation of a beam's light over its width, evenly lit."""
_SAMPLES, _LONG_MARK_M = 3, 0.25
"""Places along a beam's mark on the ground at which its height is read, if it is longer than this [m]."""
_CLASSES = {
    **dict.fromkeys((Material.PAVEMENT, Material.CONCRETE), "B"),
    Material.GRAVEL: "D",
    **dict.fromkeys((Material.GRASS, Material.SOIL, Material.CROP), "E"),
    **dict.fromkeys((Material.FURROWS, Material.RUBBLE), "F"),
}
"""Classes of ISO 8608 beside the road; its annex has unpaved ground in D to F."""
_LEVELS = np.array([class_level(_CLASSES[m]) if m in _CLASSES else 0.0 for m in Material], np.float32)
_IS_GROUND, _IS_ROAD = (np.array([t in tags for t in Tag]) for tags in (GROUND_TAGS, ROAD_TAGS))


class ShotInputs(NamedTuple):
    """Shots of a scan in the order of their time, H of them."""

    ring: NDArray[np.uint16]
    """Laser, (H,)."""
    range_m: F32
    """Distance, inf where nothing was hit [m], (H,)."""
    material: NDArray[np.uint8]
    """Material, (H,)."""
    cos_incidence: F32
    """Cosine between ray and normal, (H,)."""
    share: F32
    """Reflectance of what returns over that of the surface: texture, details, the part of the beam, (H,)."""
    relief_m: F32
    """Height of the surface above its mesh [m], (H,)."""
    normal: Array
    """Standard normal numbers: of range, of amplitude, (2, H)."""


class ReceiverTable(NamedTuple):
    """Constants of a receiver, for compiled functions."""

    config: tuple[float, float, float, float, float, float, float, float, float]
    """Amplitude per ρ/R³ [m³], focus [m], pulse [m], noise of strong and of weak echoes [m], noise of
    amplitudes, smallest power, full scale, overload over it."""
    beam_rad: tuple[float, float]
    """Width of the beam along and across the scan [rad]."""
    quantum_m: float
    """Step of the ranges [m], 0: none."""
    whole: bool
    """Whether intensities are whole numbers."""
    offset_m: Array
    """Constant error of each laser [m], (rings,)."""
    gain: Array
    """Error of each laser in proportion to the range, (rings,)."""
    reflection: ReflectionTable
    """Reflection by material."""


def laser_errors(config: LidarConfig, seed: int) -> Array:
    """Constant range error [m] and error in proportion to the range of each laser, shape (2, rings).

    The same in all scans of a sensor under a seed. No file of a dataset names them.
    """
    receiver = config.receiver or ReceiverConfig(laser_offset_m=0.0, laser_gain=0.0)
    drawn = clock.stream(seed, f"{config.name}/lasers").standard_normal((2, len(config.elevations_deg)))
    sizes = np.array([[receiver.laser_offset_m], [receiver.laser_gain]])
    result: Array = sizes * drawn
    return result


class Receiver:
    """Receiver of one LiDAR under one seed."""

    def __init__(self, config: LidarConfig, receiver: ReceiverConfig, seed: int) -> None:
        self.seed = seed
        """Seed of the lasers' errors."""
        self._table = _table(config, receiver, laser_errors(config, seed))

    def measure(
        self, ring: NDArray[np.uint16], hits: Hits, share: F32, relief_m: F32, normal: Array
    ) -> tuple[F32, F32]:
        """Measured ranges [m], inf where no echo is detected, and intensities 0–255, each (H,).

        Args:
            ring: Laser of each shot, in the order of time, shape (H,).
            hits: First surfaces.
            share: Reflectance over the material's, times the part of each beam's light there, shape (H,).
            relief_m: Height of the surface above its mesh [m], shape (H,).
            normal: Standard normal numbers of range and amplitude, shape (2, H).
        """
        range_m, intensity = np.empty(len(hits), np.float32), np.empty(len(hits), np.float32)
        shots = ShotInputs(
            ring=ring,
            range_m=hits.range_m,
            material=hits.material,
            cos_incidence=hits.cos_incidence,
            share=share * hits.tone,
            relief_m=relief_m,
            normal=normal,
        )
        _receive(shots, self._table, np.ones(len(self._table.offset_m)), range_m, intensity)
        return range_m, intensity


def _table(config: LidarConfig, receiver: ReceiverConfig, errors: Array) -> ReceiverTable:
    least = 0.1 / (receiver.reach_m * receiver.reach_m * receiver.reach_m)
    return ReceiverTable(
        config=(
            1.0 / least,
            receiver.focus_m,
            receiver.pulse_m,
            config.range_noise_m,
            receiver.weak_noise_m,
            receiver.noise_amplitude,
            1.0 / (1 << (receiver.power_levels - 1)),
            receiver.full_scale,
            receiver.overload,
        ),
        beam_rad=(1e-3 * receiver.beam_mrad[0], 1e-3 * receiver.beam_mrad[1]),
        quantum_m=receiver.range_quantum_m,
        whole=receiver.whole_intensity,
        offset_m=np.ascontiguousarray(errors[0]),
        gain=np.ascontiguousarray(errors[1]),
        reflection=reflection_table(grains=receiver.relief),
    )


@compiled
def _receive(
    shots: ShotInputs, table: ReceiverTable, power: Array, out_range_m: F32, out_intensity: F32
) -> None:
    """Measure H shots.

    Args:
        shots: The shots.
        table: The receiver.
        power: Power of each laser's next shot over the full one, changed on the way, shape (rings,).
        out_range_m: Receives ranges [m], shape (H,).
        out_intensity: Receives intensities, shape (H,).
    """
    scale, focus_m, pulse_m, strong_m, weak_m, hiss, least_power, full_scale, overload = table.config
    wide, tall = table.beam_rad
    for i in range(len(shots.range_m)):
        laser, r = shots.ring[i], float(shots.range_m[i])
        out_range_m[i], out_intensity[i] = np.inf, 0.0
        if not r < np.inf:
            power[laser] = 1.0
            continue
        kind, cosine = shots.material[i], max(float(shots.cos_incidence[i]), 0.01)
        diffuse = shots.share[i] * reflectance_towards_source(table.reflection, kind, cosine)
        retro = shots.share[i] * table.reflection.retro[kind] * math.sqrt(cosine)
        slant_m = _SPREAD * tall * r * math.sqrt(1.0 - cosine * cosine) / cosine
        stretch = 1.0 / math.sqrt(math.sqrt(1.0 + slant_m * slant_m / (pulse_m * pulse_m)))
        focus = 1.0 - elementary_kernels.exp(-(r * r) / (focus_m * focus_m))
        full = scale * (diffuse + 10.0 * retro) * stretch * focus / (r * r * r)
        noise = hiss * shots.normal[1, i]
        amplitude, strong = power[laser] * full + noise, power[laser] > least_power
        if amplitude < 1.0:
            power[laser] = 1.0
            continue
        full_measured, chosen = amplitude / power[laser], 1.0
        while chosen * full_measured > full_scale and chosen > least_power:
            chosen *= 0.5
        power[laser] = chosen
        if strong and amplitude > overload * full_scale:
            continue
        grains = max(wide * r * tall * r / (cosine * GRAIN_M * GRAIN_M), 1.0)
        uneven_m = table.reflection.grain_height_m[kind] / cosine
        shifted_m = slant_m * table.reflection.contrast[kind]
        faint_m = weak_m / (amplitude * stretch)
        surface = (uneven_m * uneven_m + shifted_m * shifted_m) / grains
        deviation_m = math.sqrt(strong_m * strong_m + faint_m * faint_m + surface)
        measured_m = r - shots.relief_m[i] / cosine
        measured_m += table.offset_m[laser] + table.gain[laser] * r + deviation_m * shots.normal[0, i]
        if table.quantum_m > 0.0:
            measured_m = table.quantum_m * math.floor(measured_m / table.quantum_m + 0.5)
        # The sensor knows its own power and R⁻², neither the slant of surfaces nor its focus.
        bright = stretch * focus * (100.0 * diffuse * (1.0 + noise / (amplitude - noise)) + 155.0 * retro)
        bright = min(max(bright, 0.0), 255.0 if retro > 0.0 else 100.0)
        out_range_m[i] = measured_m
        out_intensity[i] = math.floor(bright + 0.5) if table.whole else bright


def ground_relief(rays: F32, hits: Hits, rough: RoughTable, place: tuple[float, float, float]) -> F32:
    """Height of the ground above its mesh at each hit [m], 0 off the ground, shape (N,).

    The meshes leave waves shorter than 10 m to the wheels.

    Args:
        rays: Rays as `RayScene.trace` takes them, shape (N, 6).
        hits: What they meet.
        rough: Roughness of the town's roads.
        place: World x and y of the rays' origin of coordinates [m], and the height of the beam [rad]: waves
            shorter than its mark on the ground are levelled out.
    """
    relief_m = np.zeros(len(hits), np.float32)
    surface = hits.range_m, hits.tag, hits.material, hits.cos_incidence
    _heights(rays, surface, rough, _LEVELS, place, relief_m)
    return relief_m


@compiled
def _heights(
    rays: F32,
    hits: tuple[F32, NDArray[np.uint8], NDArray[np.uint8], F32],
    rough: RoughTable,
    levels: NDArray[np.float32],
    place: tuple[float, float, float],
    out: F32,
) -> None:
    range_m, tag, material, cos_incidence = hits
    middle_x, middle_y, beam_rad = place
    for i in range(len(rays)):
        r, kind = float(range_m[i]), tag[i]
        if not r < np.inf or kind >= len(_IS_GROUND) or not _IS_GROUND[kind]:
            continue
        east, north = float(rays[i, 3]), float(rays[i, 4])
        x, y = middle_x + rays[i, 0] + r * east, middle_y + rays[i, 1] + r * north
        level = float(levels[material[i]])
        if level == 0.0 and _IS_ROAD[kind]:
            level = level_at(rough.level, x, y)
        if level == 0.0:
            continue
        flat = math.sqrt(east * east + north * north)
        mark_m = beam_rad * r / max(float(cos_incidence[i]), 0.01)
        samples = _SAMPLES if mark_m > _LONG_MARK_M else 1
        step, total = mark_m / (samples * max(flat, 1e-6)), 0.0
        for k in range(samples):
            along = (k - 0.5 * (samples - 1)) * step
            total += wave_height(rough.waves, x + along * east, y + along * north)
        out[i] = level * total / samples
