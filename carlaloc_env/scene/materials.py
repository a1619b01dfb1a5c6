"""Surface materials: one table for pictures (texture layer, gloss) and for LiDAR (reflectance).

Reflectances at 905 nm and roughness values: `docs/sensors.md` names their sources.
"""

from __future__ import annotations

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


@dataclass(frozen=True, slots=True, kw_only=True)
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


def _info(
    tile_m: float,
    roughness: float,
    porosity: float,
    reflectance: float,
    retro: float = 0.0,
    emission_cd_m2: float = 0.0,
) -> MaterialInfo:
    return MaterialInfo(
        tile_m=tile_m,
        roughness=roughness,
        porosity=porosity,
        reflectance=reflectance,
        retro=retro,
        emission_cd_m2=emission_cd_m2,
    )


MATERIALS: dict[Material, MaterialInfo] = {
    Material.PLAIN: _info(1.0, 0.8, 0.0, 0.40),
    Material.ASPHALT: _info(2.5, 0.90, 1.0, 0.15),
    Material.ASPHALT_OLD: _info(2.5, 0.92, 1.0, 0.20),
    Material.ROAD_PAINT_WHITE: _info(2.0, 0.60, 0.2, 0.65, 0.10),
    Material.ROAD_PAINT_YELLOW: _info(2.0, 0.60, 0.2, 0.50, 0.10),
    Material.CONCRETE: _info(4.0, 0.80, 0.8, 0.35),
    Material.PAVEMENT: _info(2.4, 0.80, 0.8, 0.30),
    Material.KERB: _info(2.0, 0.80, 0.8, 0.35),
    Material.GRASS: _info(4.0, 0.90, 0.3, 0.50),
    Material.SOIL: _info(4.0, 0.95, 0.9, 0.25),
    Material.BRICK_RED: _info(2.58, 0.85, 0.7, 0.35),
    Material.BRICK_BROWN: _info(2.58, 0.85, 0.7, 0.30),
    Material.PLASTER: _info(4.0, 0.90, 0.6, 0.55),
    Material.ASHLAR: _info(3.6, 0.80, 0.6, 0.45),
    Material.CONCRETE_PANEL: _info(6.0, 0.80, 0.7, 0.40),
    Material.CURTAIN_WALL: _info(3.0, 0.10, 0.0, 0.10),
    Material.WINDOW: _info(1.0, 0.08, 0.0, 0.08),
    Material.SHOP_FRONT: _info(3.0, 0.10, 0.0, 0.10),
    Material.ROOF_TILE: _info(2.0, 0.80, 0.7, 0.30),
    Material.ROOF_FLAT: _info(4.0, 0.90, 0.7, 0.25),
    Material.BARK: _info(1.0, 0.90, 0.5, 0.35),
    Material.LEAF: _info(2.0, 0.50, 0.1, 0.50),
    Material.METAL_GALVANISED: _info(1.0, 0.45, 0.0, 0.40),
    Material.METAL_PAINTED: _info(1.0, 0.40, 0.0, 0.35),
    Material.CAR_PAINT: _info(1.0, 0.10, 0.0, 0.40),
    Material.GLASS: _info(1.0, 0.05, 0.0, 0.06),
    Material.RUBBER: _info(0.5, 0.90, 0.2, 0.08),
    Material.PLASTIC: _info(1.0, 0.50, 0.0, 0.25),
    Material.SIGN: _info(1.0, 0.40, 0.0, 0.60, 0.90),
    Material.CLOTH: _info(0.5, 0.95, 0.5, 0.35),
    Material.SKIN: _info(0.5, 0.60, 0.0, 0.45),
    Material.WATER: _info(8.0, 0.05, 0.0, 0.03),
    Material.LAMP_WHITE: _info(0.3, 0.30, 0.0, 0.40, 0.0, 12000.0),
    Material.LAMP_RED: _info(0.3, 0.30, 0.0, 0.30, 0.3, 6000.0),
    Material.LAMP_AMBER: _info(0.3, 0.30, 0.0, 0.30, 0.3, 7000.0),
    Material.LAMP_GREEN: _info(0.3, 0.30, 0.0, 0.30, 0.0, 7000.0),
    Material.WOOD: _info(1.5, 0.80, 0.6, 0.35),
    Material.POSTER: _info(1.0, 0.50, 0.0, 0.45),
    Material.GRAVEL: _info(2.0, 0.95, 0.8, 0.30),
    Material.DOOR: _info(1.0, 0.60, 0.1, 0.35),
    Material.PLATE: _info(1.0, 0.40, 0.0, 0.60, 0.90),
    # Dimmer than real ones: a night picture's fixed exposure shows no difference to a brake lamp above 16.
    Material.LAMP_TAIL: _info(0.3, 0.30, 0.0, 0.30, 0.3, 5.0),
    Material.SIDING: _info(2.4, 0.75, 0.2, 0.50),
    Material.SHEET_METAL: _info(2.0, 0.50, 0.1, 0.40),
    Material.RUBBLE: _info(2.4, 0.85, 0.6, 0.40),
    Material.ROOF_SLATE: _info(2.0, 0.60, 0.4, 0.20),
    Material.CROP: _info(3.0, 0.90, 0.3, 0.50),
    Material.FURROWS: _info(4.0, 0.95, 0.9, 0.25),
    Material.SHOP_SIGN: _info(1.0, 0.45, 0.0, 0.40),
    Material.BILLBOARD: _info(1.0, 0.50, 0.0, 0.45),
    Material.WINDOW_WIDE: _info(1.0, 0.08, 0.0, 0.08),
    Material.SHOP_FRONT_B: _info(3.0, 0.10, 0.0, 0.10),
    Material.ASPHALT_MOTORWAY: _info(2.5, 0.90, 1.0, 0.17),
}
"""What light and LiDAR meet, for each material."""


def table(field: str) -> NDArray[np.float32]:
    """One property of all materials as an array indexed by `Material`, shape (len(Material),)."""
    return np.array([getattr(MATERIALS[material], field) for material in Material], dtype=np.float32)
