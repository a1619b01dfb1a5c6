"""Reflection of laser pulses back towards their source: rough faces, grains, mirrors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary_kernels
from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.jit import compiled, inlined
from carlaloc_env.raycast import Hits
from carlaloc_env.scene.materials import MATERIALS, Material

_GRAINS: dict[Material, tuple[float, float]] = {
    **dict.fromkeys((Material.ASPHALT, Material.ASPHALT_OLD, Material.ASPHALT_MOTORWAY), (0.4, 0.6e-3)),
    **dict.fromkeys((Material.GRAVEL, Material.RUBBLE), (0.4, 0.6e-3)),
    **dict.fromkeys((Material.SOIL, Material.FURROWS, Material.GRASS, Material.CROP), (0.3, 0.6e-3)),
}
"""Contrast and height [m] of the grains of the ground.

Contrast: standard deviation of the reflectance of single stones, pale and dark, over their mean. Height:
0.6 mm rms is a mean profile depth of about 0.8 mm, which is usual for asphalt (ISO 13473-1).
"""
_SLOPES: dict[Material, float] = {
    **dict.fromkeys((Material.ASPHALT, Material.ASPHALT_OLD, Material.ASPHALT_MOTORWAY), 0.70),
    **dict.fromkeys((Material.GRAVEL, Material.RUBBLE, Material.SOIL, Material.FURROWS), 0.80),
    **dict.fromkeys((Material.GRASS, Material.CROP), 1.00),
    **dict.fromkeys((Material.BRICK_RED, Material.BRICK_BROWN, Material.PLASTER, Material.ASHLAR), 0.52),
    **dict.fromkeys((Material.CONCRETE, Material.PAVEMENT, Material.KERB), 0.52),
    **dict.fromkeys((Material.ROAD_PAINT_WHITE, Material.ROAD_PAINT_YELLOW), 0.52),
    **dict.fromkeys((Material.CONCRETE_PANEL, Material.ROOF_TILE, Material.ROOF_FLAT), 0.45),
    **dict.fromkeys((Material.BARK, Material.CLOTH), 0.70),
    **dict.fromkeys((Material.METAL_PAINTED, Material.CAR_PAINT, Material.SIGN, Material.PLATE), 0.10),
    **dict.fromkeys((Material.GLASS, Material.WINDOW, Material.WINDOW_WIDE, Material.WATER), 0.05),
}
"""Spread of the facets' slopes [rad]: 30° for wall plaster and 35° for sand, as Oren and Nayar measured them.

Others are set beside these: stones of asphalt are steeper than sand, and blades of grass steeper still."""
_SLOPE = 0.35
"""Spread of the slopes of other materials [rad]."""
_SCATTERED: dict[Material, float] = {
    Material.GLASS: 0.008,
    Material.WATER: 0.12,
    **dict.fromkeys((Material.WINDOW, Material.WINDOW_WIDE), 0.35),
    **dict.fromkeys((Material.CURTAIN_WALL, Material.SHOP_FRONT, Material.SHOP_FRONT_B), 0.35),
    **dict.fromkeys((Material.LAMP_WHITE, Material.LAMP_RED, Material.LAMP_AMBER, Material.LAMP_GREEN), 0.5),
    Material.LAMP_TAIL: 0.5,
    Material.CAR_PAINT: 0.85,
    **dict.fromkeys((Material.METAL_PAINTED, Material.METAL_GALVANISED, Material.SHEET_METAL), 0.8),
}
"""Share of the reflectance that is scattered; the rest is mirrored.

Of clean glass 8 % of the light come back from its two faces (n = 1.5), nearly all mirrored. Car paint has a
clear coat that mirrors 4 %.
"""
_BLADES = dict.fromkeys((Material.GRASS, Material.CROP), 2.0 / 3.0)
"""Mean cosine of the incidence on blades, which stand at all angles (de Wit 1965)."""
_PANES_RAD = 0.01
"""Least spread of the slopes of mirrors [rad]: panes of one front do not hang quite alike."""
GRAIN_M = 0.01
"""Size of the largest stones in a road's wearing course [m] (AC 11 of EN 13108-1)."""


class ReflectionTable(NamedTuple):
    """Reflection by material, for compiled functions; columns of shape (materials,)."""

    diffuse: NDArray[np.float64]
    """Scattered part of the reflectance face on."""
    mirrored: NDArray[np.float64]
    """Mirrored part."""
    rough: NDArray[np.float64]
    """B/A of Oren and Nayar."""
    mirror_slope: NDArray[np.float64]
    """Beckmann's m of the mirroring facets, the square of the roughness."""
    retro: NDArray[np.float64]
    """Share of retro-reflection."""
    contrast: NDArray[np.float64]
    """Contrast of grains."""
    grain_height_m: NDArray[np.float64]
    """Height of grains, rms [m]."""


def reflection_table(*, grains: bool = True) -> ReflectionTable:
    """Reflection of all materials of `Material`; without grains the ground is even to beams."""
    rows = []
    for kind in Material:
        info, share = MATERIALS[kind], _SCATTERED.get(kind, 1.0)
        a, b = oren_nayar(_SLOPES.get(kind, _SLOPE))
        level = info.reflectance * _BLADES.get(kind, 1.0)
        parts = level * share, level * (1.0 - share)
        uneven = _GRAINS.get(kind, (0.0, 0.0)) if grains else (0.0, 0.0)
        rows.append((*parts, b / a, max(info.roughness**2, _PANES_RAD), info.retro, *uneven))
    return ReflectionTable(*(np.ascontiguousarray(column) for column in np.array(rows).T))


def oren_nayar(slope_rad: float) -> tuple[float, float]:
    """A and B of Oren and Nayar for facets whose slopes have a spread [rad].

    Oren and Nayar, "Generalization of Lambert's reflectance model" (SIGGRAPH 1994): where source and eye
    coincide, the radiance over that of a white surface face on is ρ·(cosθ + (B/A)·sin²θ) with
    A = 1 − σ²/(2·(σ² + 0.33)) and B = 0.45·σ²/(σ² + 0.09); ρ is the hemispherical reflectance in light from
    above, as spectral libraries have it. So asphalt hardly darkens towards the horizon. Terrestrial scanners
    find gravel and sand nearly independent of the incidence as well (Kaasalainen et al., Remote Sensing 3,
    2011).
    """
    square = slope_rad * slope_rad
    return 1.0 - 0.5 * square / (square + 0.33), 0.45 * square / (square + 0.09)


@inlined
def reflectance_towards_source(table: ReflectionTable, kind: int, cosine: float) -> float:
    """Radiance of a surface in a laser's light, seen from the laser, over that of a white one face on.

    Smooth surfaces scatter a part of their reflectance and mirror the rest: facets of Cook and Torrance, "A
    reflectance model for computer graphics" (1982), whose slopes have Beckmann's distribution. They shine
    when met face on and are dark otherwise.

    Args:
        table: Reflection by material.
        kind: Number of the material.
        cosine: Cosine between ray and surface normal.
    """
    sine_squared = 1.0 - cosine * cosine
    scattered = table.diffuse[kind] * (cosine + table.rough[kind] * sine_squared)
    mirrored = 0.0
    if table.mirrored[kind] > 0.0 and cosine > 0.5:
        width = table.mirror_slope[kind] * table.mirror_slope[kind]
        tangent_squared = sine_squared / (cosine * cosine)
        fifth = cosine * (1.0 - sine_squared) * (1.0 - sine_squared)
        lobe = elementary_kernels.exp(-tangent_squared / width) / (4.0 * width * fifth)
        mirrored = table.mirrored[kind] * lobe
    return float(scattered + mirrored)


def echo_power(table: ReflectionTable, hits: Hits) -> Array:
    """Strength of echoes without their R⁻², ten times as much for retro-reflectors, of N hits, shape (N,)."""
    powers = np.empty(len(hits))
    _powers(table, hits.material, hits.cos_incidence, hits.tone, powers)
    return powers


@compiled
def _powers(
    table: ReflectionTable, material: NDArray[np.uint8], cos_incidence: F32, tone: F32, out: Array
) -> None:
    for i in range(len(material)):
        kind = material[i]
        scattered = tone[i] * reflectance_towards_source(table, kind, max(float(cos_incidence[i]), 0.01))
        out[i] = scattered + 10.0 * table.retro[kind]
