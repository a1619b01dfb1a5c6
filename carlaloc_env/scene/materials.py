"""Materials of surfaces: one table for pictures (texture layer, gloss) and for LiDAR (reflectance at 905 nm).

`docs/sensors.md` names the sources of reflectances and roughness values.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class Material(IntEnum):
    """Index of a material; stored per vertex of every mesh."""

    PLAIN = 0
    ASPHALT = 1
    ASPHALT_OLD = 2
    ROAD_PAINT_WHITE = 3
    ROAD_PAINT_YELLOW = 4
    CONCRETE = 5
    PAVEMENT = 6
    KERB = 7
    GRASS = 8
    SOIL = 9
    BRICK_RED = 10
    BRICK_BROWN = 11
    PLASTER = 12
    ASHLAR = 13
    CONCRETE_PANEL = 14
    CURTAIN_WALL = 15
    WINDOW = 16
    SHOP_FRONT = 17
    ROOF_TILE = 18
    ROOF_FLAT = 19
    BARK = 20
    LEAF = 21
    METAL_GALVANISED = 22
    METAL_PAINTED = 23
    CAR_PAINT = 24
    GLASS = 25
    RUBBER = 26
    PLASTIC = 27
    SIGN = 28
    CLOTH = 29
    SKIN = 30
    WATER = 31
    LAMP_WHITE = 32
    LAMP_RED = 33
    LAMP_AMBER = 34
    LAMP_GREEN = 35
    WOOD = 36
    POSTER = 37
    GRAVEL = 38
    DOOR = 39
    PLATE = 40
    LAMP_TAIL = 41
    SIDING = 42
    SHEET_METAL = 43
    RUBBLE = 44
    ROOF_SLATE = 45
    CROP = 46
    FURROWS = 47
    SHOP_SIGN = 48
    BILLBOARD = 49
    WINDOW_WIDE = 50
    SHOP_FRONT_B = 51
    ASPHALT_MOTORWAY = 52


@dataclass(frozen=True, slots=True)
class MaterialInfo:
    """Properties of one material."""

    tile_m: float
    """Length of one texture repeat [m]; `uv` of meshes is in metres and is divided by it."""
    roughness: float
    """Microfacet roughness 0–1, dry."""
    porosity: float
    """How much water darkens it, 0 (metal, paint) to 1 (asphalt)."""
    reflectance: float
    """Diffuse reflectance at 905 nm, 0–1."""
    retro: float = 0.0
    """Retro-reflective share of the LiDAR return, 0–1."""
    emission_cd_m2: float = 0.0
    """Luminance when lit [cd/m²]."""


MATERIALS: dict[Material, MaterialInfo] = {
    Material.PLAIN: MaterialInfo(1.0, 0.8, 0.0, 0.40),
    Material.ASPHALT: MaterialInfo(2.5, 0.90, 1.0, 0.15),
    Material.ASPHALT_OLD: MaterialInfo(2.5, 0.92, 1.0, 0.20),
    Material.ROAD_PAINT_WHITE: MaterialInfo(2.0, 0.60, 0.2, 0.65, 0.10),
    Material.ROAD_PAINT_YELLOW: MaterialInfo(2.0, 0.60, 0.2, 0.50, 0.10),
    Material.CONCRETE: MaterialInfo(4.0, 0.80, 0.8, 0.35),
    Material.PAVEMENT: MaterialInfo(2.4, 0.80, 0.8, 0.30),
    Material.KERB: MaterialInfo(2.0, 0.80, 0.8, 0.35),
    Material.GRASS: MaterialInfo(4.0, 0.90, 0.3, 0.50),
    Material.SOIL: MaterialInfo(4.0, 0.95, 0.9, 0.25),
    Material.BRICK_RED: MaterialInfo(2.58, 0.85, 0.7, 0.35),
    Material.BRICK_BROWN: MaterialInfo(2.58, 0.85, 0.7, 0.30),
    Material.PLASTER: MaterialInfo(4.0, 0.90, 0.6, 0.55),
    Material.ASHLAR: MaterialInfo(3.6, 0.80, 0.6, 0.45),
    Material.CONCRETE_PANEL: MaterialInfo(6.0, 0.80, 0.7, 0.40),
    Material.CURTAIN_WALL: MaterialInfo(3.0, 0.10, 0.0, 0.10),
    Material.WINDOW: MaterialInfo(1.0, 0.08, 0.0, 0.08),
    Material.SHOP_FRONT: MaterialInfo(3.0, 0.10, 0.0, 0.10),
    Material.ROOF_TILE: MaterialInfo(2.0, 0.80, 0.7, 0.30),
    Material.ROOF_FLAT: MaterialInfo(4.0, 0.90, 0.7, 0.25),
    Material.BARK: MaterialInfo(1.0, 0.90, 0.5, 0.35),
    Material.LEAF: MaterialInfo(2.0, 0.50, 0.1, 0.50),
    Material.METAL_GALVANISED: MaterialInfo(1.0, 0.45, 0.0, 0.40),
    Material.METAL_PAINTED: MaterialInfo(1.0, 0.40, 0.0, 0.35),
    Material.CAR_PAINT: MaterialInfo(1.0, 0.10, 0.0, 0.40),
    Material.GLASS: MaterialInfo(1.0, 0.05, 0.0, 0.06),
    Material.RUBBER: MaterialInfo(0.5, 0.90, 0.2, 0.08),
    Material.PLASTIC: MaterialInfo(1.0, 0.50, 0.0, 0.25),
    Material.SIGN: MaterialInfo(1.0, 0.40, 0.0, 0.60, 0.90),
    Material.CLOTH: MaterialInfo(0.5, 0.95, 0.5, 0.35),
    Material.SKIN: MaterialInfo(0.5, 0.60, 0.0, 0.45),
    Material.WATER: MaterialInfo(8.0, 0.05, 0.0, 0.03),
    Material.LAMP_WHITE: MaterialInfo(0.3, 0.30, 0.0, 0.40, 0.0, 12000.0),
    Material.LAMP_RED: MaterialInfo(0.3, 0.30, 0.0, 0.30, 0.3, 6000.0),
    Material.LAMP_AMBER: MaterialInfo(0.3, 0.30, 0.0, 0.30, 0.3, 7000.0),
    Material.LAMP_GREEN: MaterialInfo(0.3, 0.30, 0.0, 0.30, 0.0, 7000.0),
    Material.WOOD: MaterialInfo(1.5, 0.80, 0.6, 0.35),
    Material.POSTER: MaterialInfo(1.0, 0.50, 0.0, 0.45),
    Material.GRAVEL: MaterialInfo(2.0, 0.95, 0.8, 0.30),
    Material.DOOR: MaterialInfo(1.0, 0.60, 0.1, 0.35),
    Material.PLATE: MaterialInfo(1.0, 0.40, 0.0, 0.60, 0.90),
    # Dimmer than real ones: a night picture's fixed exposure shows no difference to a brake lamp above 16.
    Material.LAMP_TAIL: MaterialInfo(0.3, 0.30, 0.0, 0.30, 0.3, 5.0),
    Material.SIDING: MaterialInfo(2.4, 0.75, 0.2, 0.50),
    Material.SHEET_METAL: MaterialInfo(2.0, 0.50, 0.1, 0.40),
    Material.RUBBLE: MaterialInfo(2.4, 0.85, 0.6, 0.40),
    Material.ROOF_SLATE: MaterialInfo(2.0, 0.60, 0.4, 0.20),
    Material.CROP: MaterialInfo(3.0, 0.90, 0.3, 0.50),
    Material.FURROWS: MaterialInfo(4.0, 0.95, 0.9, 0.25),
    Material.SHOP_SIGN: MaterialInfo(1.0, 0.45, 0.0, 0.40),
    Material.BILLBOARD: MaterialInfo(1.0, 0.50, 0.0, 0.45),
    Material.WINDOW_WIDE: MaterialInfo(1.0, 0.08, 0.0, 0.08),
    Material.SHOP_FRONT_B: MaterialInfo(3.0, 0.10, 0.0, 0.10),
    Material.ASPHALT_MOTORWAY: MaterialInfo(2.5, 0.90, 1.0, 0.17),
}
"""Optical properties of each material."""


def material_values(field: str) -> NDArray[np.float32]:
    """One property of all materials as an array indexed by `Material`, shape (len(Material),)."""
    return np.array([getattr(MATERIALS[material], field) for material in Material], dtype=np.float32)
