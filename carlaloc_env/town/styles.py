"""Building styles: measures, materials and tints, after common building practice."""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.materials import Material

Tint = tuple[int, int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """How the buildings of one style are made."""

    name: str
    """Name of the style."""
    walls: tuple[tuple[Material, Tint], ...]
    """Wall materials with their linear tints, one of which a building takes."""
    trims: tuple[Tint, ...]
    """Linear tints of sills, cornices and frames."""
    storeys: tuple[int, int]
    """Fewest and most storeys, the ground floor included."""
    storey_m: float
    """Height of a storey [m]."""
    ground_m: float
    """Height of the ground floor [m]."""
    width_m: tuple[float, float]
    """Shortest and longest front [m]."""
    depth_m: tuple[float, float]
    """Smallest and largest depth [m]."""
    bay_m: float
    """Distance of windows [m]."""
    window_m: tuple[float, float]
    """Width and height of a window [m]."""
    sill_m: float
    """Height of the window's lower edge above the floor [m]."""
    recess_m: float = 0.12
    """Depth of the window behind the wall [m]."""
    ground: str = "dwelling"
    """Ground floor: dwelling, shop, lobby or hall."""
    cornice_m: tuple[float, float] = (0.3, 0.5)
    """How far the cornice stands out, and its height [m]."""
    courses: bool = False
    """Whether a thin moulding runs round below each storey."""
    pilaster_m: float = 0.0
    """Width of the piers that stand out between windows [m]; 0 for none."""
    balconies: float = 0.0
    """Share of windows of the upper storeys that have a balcony."""
    roof: str = "flat"
    """Roof: flat, gable or mansard."""
    setback_storeys: int = 0
    """Storeys after which the next part of a tower stands back; 0 for never."""
    gap_m: float = 0.0
    """Distance to the next building [m]."""
    front_m: float = 0.0
    """Distance of the front from the pavement [m]."""


_BRICKS = tuple(
    (material, tint)
    for material in (Material.BRICK_RED, Material.BRICK_BROWN)
    for tint in ((255, 255, 255), (255, 225, 200), (205, 190, 185), (255, 240, 190), (170, 160, 165))
)
_PLASTERS = tuple(
    (Material.PLASTER, tint)
    for tint in (
        (250, 246, 235), (245, 214, 150), (238, 190, 140), (205, 215, 190), (190, 205, 225), (240, 205, 190),
        (225, 225, 215), (235, 170, 120), (250, 232, 180), (180, 185, 180), (215, 150, 125), (250, 240, 210),
    )
)  # fmt: skip
_STONES = tuple(
    (Material.ASHLAR, tint)
    for tint in ((255, 252, 240), (240, 225, 195), (215, 210, 205), (250, 235, 205), (200, 185, 165))
)
_PANELS = tuple(
    (Material.CONCRETE_PANEL, tint)
    for tint in ((255, 255, 250), (225, 220, 210), (245, 230, 205), (200, 205, 210), (180, 170, 160))
)
_TOWERS = tuple(
    (Material.CURTAIN_WALL, tint)
    for tint in ((200, 225, 255), (180, 200, 190), (255, 240, 215), (150, 170, 190), (225, 225, 225))
)
_SHEETS = tuple(
    (Material.METAL_PAINTED, tint)
    for tint in ((215, 215, 210), (150, 175, 200), (190, 180, 150), (150, 165, 140), (200, 140, 110))
)
_BOARDS = ((Material.WOOD, (200, 90, 70)), (Material.WOOD, (170, 150, 130)))
_LIGHT = ((250, 248, 240), (225, 220, 210), (200, 195, 185))
_DARK = ((70, 70, 72), (110, 100, 90), (60, 75, 70), (90, 50, 40))

STYLES: dict[str, Style] = {
    style.name: style
    for style in (
        Style(
            name="brick_row", walls=_BRICKS, trims=_LIGHT + _DARK, storeys=(3, 5), storey_m=3.1, ground_m=3.8,
            width_m=(11.0, 19.0), depth_m=(11.0, 15.0), bay_m=2.7, window_m=(1.05, 1.6), sill_m=0.85,
            ground="shop", cornice_m=(0.45, 0.7), recess_m=0.14,
        ),
        Style(
            name="brick_walkup", walls=_BRICKS, trims=_LIGHT, storeys=(3, 4), storey_m=3.0, ground_m=3.3,
            width_m=(12.0, 20.0), depth_m=(10.0, 14.0), bay_m=2.9, window_m=(1.15, 1.5), sill_m=0.85,
            cornice_m=(0.35, 0.5), balconies=0.25, gap_m=2.0, front_m=1.5,
        ),
        Style(
            name="european", walls=_PLASTERS, trims=_LIGHT, storeys=(4, 6), storey_m=3.2, ground_m=4.2,
            width_m=(13.0, 22.0), depth_m=(12.0, 15.0), bay_m=2.8, window_m=(1.1, 1.85), sill_m=0.6,
            ground="shop", courses=True, balconies=0.3, roof="mansard", cornice_m=(0.5, 0.45),
        ),
        Style(
            name="civic", walls=_STONES, trims=_LIGHT, storeys=(3, 5), storey_m=4.0, ground_m=5.2,
            width_m=(22.0, 34.0), depth_m=(15.0, 20.0), bay_m=3.7, window_m=(1.5, 2.5), sill_m=0.8,
            ground="lobby", courses=True, pilaster_m=0.8, cornice_m=(0.7, 0.9), recess_m=0.3, front_m=2.0,
        ),
        Style(
            name="slab", walls=_PANELS + _PLASTERS[:6], trims=_LIGHT, storeys=(6, 10), storey_m=2.9,
            ground_m=3.4, width_m=(20.0, 32.0), depth_m=(12.0, 14.0), bay_m=3.3, window_m=(1.8, 1.45),
            sill_m=0.85, balconies=0.5, cornice_m=(0.1, 0.3), gap_m=5.0, front_m=3.0,
        ),
        Style(
            name="office", walls=_PANELS + _STONES, trims=_DARK + _LIGHT, storeys=(6, 14), storey_m=3.6,
            ground_m=4.8, width_m=(18.0, 32.0), depth_m=(15.0, 20.0), bay_m=3.0, window_m=(2.45, 1.9),
            sill_m=0.9, ground="lobby", cornice_m=(0.12, 0.6), pilaster_m=0.4, recess_m=0.2,
        ),
        Style(
            name="stepped", walls=_STONES + _BRICKS[5:8], trims=_LIGHT, storeys=(12, 22), storey_m=3.6,
            ground_m=5.0, width_m=(20.0, 30.0), depth_m=(18.0, 24.0), bay_m=2.4, window_m=(1.2, 1.95),
            sill_m=0.8, ground="shop", pilaster_m=0.5, setback_storeys=8, recess_m=0.2,
        ),
        Style(
            name="tower", walls=_TOWERS, trims=_DARK, storeys=(18, 40), storey_m=3.9, ground_m=6.0,
            width_m=(22.0, 32.0), depth_m=(20.0, 28.0), bay_m=3.0, window_m=(2.9, 3.7), sill_m=0.1,
            ground="lobby", setback_storeys=14, cornice_m=(0.1, 0.8), recess_m=0.05, front_m=3.0, gap_m=4.0,
        ),
        Style(
            name="shop_row", walls=_BRICKS + _PLASTERS, trims=_LIGHT + _DARK, storeys=(1, 2), storey_m=3.2,
            ground_m=4.2, width_m=(9.0, 16.0), depth_m=(12.0, 16.0), bay_m=3.0, window_m=(1.4, 1.4),
            sill_m=0.9, ground="shop", cornice_m=(0.25, 0.6),
        ),
        Style(
            name="house", walls=_PLASTERS + _BRICKS[:4], trims=_LIGHT, storeys=(1, 2), storey_m=2.8,
            ground_m=2.9, width_m=(9.0, 13.0), depth_m=(8.0, 10.5), bay_m=3.0, window_m=(1.25, 1.25),
            sill_m=0.9, roof="gable", cornice_m=(0.0, 0.0), gap_m=5.0, front_m=6.0, recess_m=0.1,
        ),
        Style(
            name="warehouse", walls=_SHEETS + _PANELS[:2] + _BRICKS[:2], trims=_DARK, storeys=(1, 1),
            storey_m=7.0, ground_m=7.5, width_m=(24.0, 42.0), depth_m=(18.0, 28.0), bay_m=5.5,
            window_m=(3.6, 1.0), sill_m=5.2, ground="hall", cornice_m=(0.08, 0.4), gap_m=8.0, front_m=6.0,
        ),
        Style(
            name="barn", walls=_BOARDS, trims=_LIGHT, storeys=(1, 1), storey_m=4.5, ground_m=4.5,
            width_m=(18.0, 28.0), depth_m=(10.0, 14.0), bay_m=6.0, window_m=(0.9, 0.9), sill_m=2.6,
            ground="hall", roof="gable", cornice_m=(0.0, 0.0), gap_m=25.0, front_m=15.0,
        ),
    )
}  # fmt: skip
"""All styles by name."""

ZONE_STYLES: dict[str, tuple[tuple[str, float], ...]] = {
    "downtown": (
        ("brick_row", 3.0), ("european", 2.5), ("civic", 1.2), ("office", 2.5), ("stepped", 1.2),
        ("shop_row", 0.6), ("slab", 0.5),
    ),
    "skyscraper": (("tower", 4.0), ("stepped", 2.5), ("office", 2.5), ("civic", 0.6)),
    "residential": (("house", 4.0), ("brick_walkup", 1.5), ("slab", 0.4)),
    "small_town": (("house", 2.0), ("shop_row", 2.0), ("brick_walkup", 1.5), ("brick_row", 0.8)),
    "industrial": (("warehouse", 4.0), ("office", 0.5), ("shop_row", 0.5)),
    "rural": (("barn", 1.0), ("house", 1.0)),
    "highway": (),
    "waterfront": (("european", 3.0), ("civic", 1.0), ("brick_row", 1.5), ("tower", 0.5)),
    "park": (),
    "water": (),
}  # fmt: skip
"""Styles of a zone with their weights."""
