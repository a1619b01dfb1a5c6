"""Variation of reflectance within metres of one surface, the same in LiDAR intensities and pictures.

The pattern is a function of the world's coordinates alone; `packing.glsl` has it for the shaders. It fades
where a beam or a pixel covers more than its cells.
"""

import numpy as np

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import inlined
from carlaloc_env.scene.materials import Material, material_values

MOTTLE = {
    **dict.fromkeys((Material.ASPHALT, Material.ASPHALT_OLD, Material.ASPHALT_MOTORWAY), 0.16),
    **dict.fromkeys((Material.CONCRETE, Material.PAVEMENT, Material.KERB, Material.CONCRETE_PANEL), 0.13),
    **dict.fromkeys((Material.ROAD_PAINT_WHITE, Material.ROAD_PAINT_YELLOW, Material.ROOF_FLAT), 0.14),
    **dict.fromkeys((Material.BRICK_RED, Material.BRICK_BROWN, Material.ASHLAR, Material.ROOF_TILE), 0.13),
    **dict.fromkeys((Material.GRASS, Material.SOIL, Material.GRAVEL, Material.CROP, Material.FURROWS), 0.24),
    **dict.fromkeys((Material.RUBBLE, Material.BARK, Material.WOOD), 0.17),
    **dict.fromkeys((Material.PLASTER, Material.SIDING), 0.085),
}
"""Deviation of the reflectance as a share of its mean; 0 for all other materials.

On asphalt intensities of a real HDL-32E deviate by 13 % within 1.5 m (two scans of nuScenes, Caesar et al.
2020), quantum included; this is 15 % at 4 m and 9 % at 16 m. The rest are estimates.
"""
CYCLES_PER_M = (2.3, 7.1, 23.0)
"""Frequencies of the pattern's layers [1/m]: trodden and worn places, repairs of a hand's width, stones."""
_SHARES = (0.40, 0.60, 0.69)
"""Share of each layer in the deviation."""
_NOISE_DEVIATION = 0.2145
"""Deviation of the noise itself: √(1/12) · 26/35."""
GAINS = tuple(share / _NOISE_DEVIATION for share in _SHARES)
"""Factors on the layers' noise, at which their sum has the deviation 1."""
WEAR_PER_M, WEAR_SHIFT, WEAR = 0.71, 17.3, 0.16
"""The shaders' patches of dirt: frequency [1/m], shift, and strength on level ground that water darkens."""
UP = (0.43, 0.61)
"""How the patches move along x and y with height, so that they vary on walls, too."""
STEEP = 0.7
"""Cosine between normal and vertical below which the pattern lies on the wall, along it and up."""
SEEN = (0.30, 0.36, 0.58)
"""Share of each layer that pictures have. A LiDAR's spot of centimetres also meets slopes, which the light
of the whole sky evens out. With these shares, neighbouring pixels of sunlit lanes differ by 1.0 to 1.4 %; on
three of nuScenes' roads, with as many pixels per radian, by 0.9 to 1.4 %."""
BEAM_RAD = 0.003
"""Width of a LiDAR's beam, over which it sees the mean [rad]."""


def mottle_table() -> F32:
    """Strengths by material: of the pattern, and of patches of dirt, shape (len(Material), 2)."""
    fine = np.array([MOTTLE.get(material, 0.0) for material in Material])
    return np.stack([fine, WEAR * material_values("porosity") * (fine > 0)], axis=-1).astype(np.float32)


@inlined
def _lattice(i: int, j: int) -> float:
    """Random number 0..1 of a corner of the grid."""
    low = np.uint64(0xFFFFFFFF)
    h = (np.uint64(i) * np.uint64(0x9E3779B1) ^ np.uint64(j) * np.uint64(0x85EBCA77)) & low
    h ^= h >> np.uint64(15)
    h = (h * np.uint64(0x2C1B3C6D)) & low
    h ^= h >> np.uint64(13)
    return float(h >> np.uint64(8)) / 16777216.0


@inlined
def value_noise(x: float, y: float) -> float:
    """Noise 0..1 with cells of size 1: numbers of the grid's corners, and smooth curves between."""
    i, j = int(np.floor(x)), int(np.floor(y))
    f, g = x - i, y - j
    f, g = f * f * (3.0 - 2.0 * f), g * g * (3.0 - 2.0 * g)
    a, b = _lattice(i, j), _lattice(i + 1, j)
    c, d = _lattice(i, j + 1), _lattice(i + 1, j + 1)
    low, high = a + f * (b - a), c + f * (d - c)
    return low + g * (high - low)


@inlined
def tone_at(
    x: float,
    y: float,
    z: float,
    normal: tuple[float, float, float],
    footprint_m: float,
    fine: float,
    dirt: float,
) -> float:
    """Reflectance at a place of the world over its mean.

    Args:
        x: Coordinate [m].
        y: Coordinate [m].
        z: Coordinate [m].
        normal: Unit normal.
        footprint_m: Width over which it is averaged [m].
        fine: Strength of the pattern.
        dirt: Strength of the patches.
    """
    u, v = x, y
    if abs(normal[2]) < STEEP:
        u, v = normal[0] * y - normal[1] * x, z
    sum_ = 0.0
    for k in range(3):
        seen = min(max(1.6 - 2.0 * footprint_m * CYCLES_PER_M[k], 0.0), 1.0)
        if seen > 0.0:
            sum_ += GAINS[k] * seen * (value_noise(CYCLES_PER_M[k] * u, CYCLES_PER_M[k] * v) - 0.5)
    u, v = x + UP[0] * z, y + UP[1] * z
    patches = value_noise(WEAR_PER_M * u + WEAR_SHIFT, WEAR_PER_M * v + WEAR_SHIFT) - 0.5
    return max(1.0 + fine * sum_ + dirt * patches, 0.3)
