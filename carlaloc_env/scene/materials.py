"""What surfaces are: materials, semantic tags, lenses of traffic lights.

Surface materials: one table for pictures (texture layer, gloss) and for LiDAR (reflectance).

Reflectances at 905 nm and roughness values: `docs/sensors.md` names their sources.

Semantic tags of CARLA ≥ 0.9.14, of CARLA ≤ 0.9.13, and the colours of both.

Source of both tables: CARLA ``Docs/ref_sensors.md`` and ``CityScapesPalette.h``.

The lenses of traffic lights.
"""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.errors import ConfigError, unknown_name


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


class Tag(IntEnum):
    """Semantic tag of a surface (CARLA ≥ 0.9.14)."""

    UNLABELED = 0
    ROAD = 1
    SIDEWALK = 2
    BUILDING = 3
    WALL = 4
    FENCE = 5
    POLE = 6
    TRAFFIC_LIGHT = 7
    TRAFFIC_SIGN = 8
    VEGETATION = 9
    TERRAIN = 10
    SKY = 11
    PEDESTRIAN = 12
    RIDER = 13
    CAR = 14
    TRUCK = 15
    BUS = 16
    TRAIN = 17
    MOTORCYCLE = 18
    BICYCLE = 19
    STATIC = 20
    DYNAMIC = 21
    OTHER = 22
    WATER = 23
    ROAD_LINE = 24
    GROUND = 25
    BRIDGE = 26
    RAIL_TRACK = 27
    GUARD_RAIL = 28


PALETTE_RGB: NDArray[np.uint8] = np.array(
    [
        (0, 0, 0), (128, 64, 128), (244, 35, 232), (70, 70, 70), (102, 102, 156),
        (190, 153, 153), (153, 153, 153), (250, 170, 30), (220, 220, 0), (107, 142, 35),
        (152, 251, 152), (70, 130, 180), (220, 20, 60), (255, 0, 0), (0, 0, 142),
        (0, 0, 70), (0, 60, 100), (0, 80, 100), (0, 0, 230), (119, 11, 32),
        (110, 190, 160), (170, 120, 50), (55, 90, 80), (45, 60, 150), (157, 234, 50),
        (81, 0, 81), (150, 100, 100), (230, 150, 140), (180, 165, 180),
    ],
    dtype=np.uint8,
)  # fmt: skip
"""Colour of each tag, sRGB 0–255, shape (29, 3)."""

TO_LEGACY: NDArray[np.uint8] = np.array(
    [0, 7, 8, 1, 11, 2, 5, 18, 12, 9, 22, 13, 4, 4, 10, 10, 10, 10, 10, 10, 19, 20, 3, 21, 6, 14, 15, 16, 17],
    dtype=np.uint8,
)
"""Tag of CARLA ≤ 0.9.13 for each tag, shape (29,); riders count as pedestrians there."""

LEGACY_PALETTE_RGB: NDArray[np.uint8] = np.array(
    [
        (0, 0, 0), (70, 70, 70), (100, 40, 40), (55, 90, 80), (220, 20, 60), (153, 153, 153),
        (157, 234, 50), (128, 64, 128), (244, 35, 232), (107, 142, 35), (0, 0, 142), (102, 102, 156),
        (220, 220, 0), (70, 130, 180), (81, 0, 81), (150, 100, 100), (230, 150, 140), (180, 165, 180),
        (250, 170, 30), (110, 190, 160), (170, 120, 50), (45, 60, 150), (145, 170, 100),
    ],
    dtype=np.uint8,
)  # fmt: skip
"""Colour of each tag of CARLA ≤ 0.9.13, sRGB 0–255, shape (23, 3)."""

TAG_TABLES = ("0.9.14", "0.9.13")
"""Tables that sensors can report tags in, named by the CARLA version that began or ended with them."""

DYNAMIC_TAGS = frozenset(
    {Tag.PEDESTRIAN, Tag.RIDER, Tag.CAR, Tag.TRUCK, Tag.BUS, Tag.TRAIN, Tag.MOTORCYCLE, Tag.BICYCLE}
)
"""Tags of things that move by themselves."""


def tags_in(table: str, tags: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Tags of this module's `Tag` as a table of `TAG_TABLES` numbers them, same shape.

    Raises:
        ConfigError: There is no such table.
    """
    if table not in TAG_TABLES:
        raise ConfigError(unknown_name("tag table", table, TAG_TABLES))
    if table == TAG_TABLES[0]:
        return tags
    legacy: NDArray[np.uint8] = TO_LEGACY[np.minimum(tags, len(TO_LEGACY) - 1)]
    return legacy


def colourise(tags: NDArray[np.uint8], table: str = TAG_TABLES[0]) -> NDArray[np.uint8]:
    """sRGB picture (..., 3) of semantic tags (...) numbered as in one of `TAG_TABLES`."""
    palette = PALETTE_RGB if table == TAG_TABLES[0] else LEGACY_PALETTE_RGB
    result: NDArray[np.uint8] = palette[np.minimum(tags, len(palette) - 1)]
    return result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalLenses:
    """Lens discs of all traffic-light heads of a town, parallel arrays of L lenses."""

    signal: NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    """Index of the signal whose state lights the lens, shape (L,)."""
    state: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    """State in which the lens is lit (1 red, 2 yellow, 3 green), shape (L,)."""
    T_world_lens: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """Pose of each lens, x out of it, shape (L, 4, 4)."""
    instance: NDArray[np.uint32] | None = None
    """Instance id of each lens' traffic light, shape (L,); none when left out."""

    def __len__(self) -> int:
        return len(self.signal)
