"""Building styles: measures, materials and tints, after common building practice."""

from dataclasses import dataclass

from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour
from carlaloc_env.scenery.buildings.palettes import (
    ACCENTS,
    BOARDS,
    BRICKS,
    DARK,
    LIGHT,
    PANELS,
    PLASTERS,
    SHEETS,
    SIDINGS,
    SLATES,
    STONES,
    TILES,
    TOWERS,
)

ZONE_STYLES: dict[str, tuple[tuple[str, float], ...]] = {
    "downtown": (
        ("brick_row", 2.5), ("european", 2.5), ("civic", 1.0), ("office", 1.6), ("ribbon", 1.6),
        ("deco", 1.8), ("stepped", 1.0), ("shop_row", 0.5), ("pavilion", 0.6), ("flats", 0.5),
    ),
    "skyscraper": (
        ("tower", 4.0), ("stepped", 2.2), ("office", 1.5), ("ribbon", 1.2), ("deco", 1.2), ("civic", 0.6),
    ),
    "residential": (
        ("house", 2.0), ("bungalow", 1.6), ("villa", 1.6), ("clapboard", 1.6), ("terrace", 1.2),
        ("flats", 0.6), ("brick_walkup", 0.5),
    ),
    "small_town": (
        ("townhouse", 2.2), ("timbered", 1.6), ("shop_row", 1.6), ("terrace", 1.2), ("house", 1.0),
        ("clapboard", 0.8), ("brick_walkup", 0.6), ("brick_row", 0.5),
    ),
    "industrial": (("warehouse", 2.5), ("factory", 2.0), ("depot", 2.5), ("ribbon", 0.4), ("shop_row", 0.3)),
    "rural": (("barn", 0.8), ("farmhouse", 1.2), ("house", 0.5)),
    "highway": (),
    "waterfront": (
        ("european", 2.5), ("flats", 1.5), ("deco", 1.0), ("pavilion", 1.0), ("brick_row", 0.8),
        ("civic", 0.6),
    ),
    "park": (),
    "water": (),
}  # fmt: skip
"""Styles of a zone with their weights."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """How the buildings of one style are made."""

    name: str
    """Name of the style."""
    walls: tuple[tuple[Material, Colour], ...]
    """Wall materials with their linear tints, one of which a building takes."""
    trims: tuple[Colour, ...]
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
    recess_m: float = 0.20
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
    """Roof: flat, gable, front_gable, hip, mansard or sawtooth."""
    roofs: tuple[tuple[Material, Colour], ...] = TILES
    """Materials of a pitched roof with their linear tints, one of which a building takes."""
    accents: tuple[Colour, ...] = ACCENTS
    """Linear tints of shutters, rails and timber."""
    wide: bool = False
    """Whether its windows are wider than high."""
    ornaments: tuple[str, ...] = ()
    """Any of shutters, oriels, timber, quoins, fire_stairs, coolers, plinth, columns, porch, spandrels,
    loggias, docks, bands."""
    setback_storeys: int = 0
    """Storeys after which the next part of a tower stands back; 0 for never."""
    gap_m: float = 0.0
    """Distance to the next building [m]."""
    detail_m: float = 24.0
    """Above this height windows have no sills and reveals, which cannot be seen from the street [m]."""
    front_m: float = 0.0
    """Distance of the front from the sidewalk [m]."""


STYLES: dict[str, Style] = {
    style.name: style
    for style in (
        Style(
            name="brick_row", walls=BRICKS, trims=LIGHT + DARK, storeys=(3, 5), storey_m=3.1, ground_m=3.8,
            width_m=(11.0, 19.0), depth_m=(11.0, 15.0), bay_m=2.7, window_m=(1.2, 1.65), sill_m=0.85,
            ground="shop", cornice_m=(0.45, 0.7), recess_m=0.14,
            ornaments=("fire_stairs", "coolers", "bands"),
        ),
        Style(
            name="brick_walkup", walls=BRICKS, trims=LIGHT, storeys=(3, 4), storey_m=3.0, ground_m=3.3,
            width_m=(12.0, 20.0), depth_m=(10.0, 14.0), bay_m=2.9, window_m=(1.2, 1.5), sill_m=0.85,
            cornice_m=(0.35, 0.5), balconies=0.3, gap_m=2.0, front_m=1.5, ornaments=("plinth", "coolers"),
        ),
        Style(
            name="european", walls=PLASTERS, trims=LIGHT, storeys=(4, 6), storey_m=3.2, ground_m=4.2,
            width_m=(13.0, 22.0), depth_m=(12.0, 15.0), bay_m=2.8, window_m=(1.2, 1.85), sill_m=0.6,
            ground="shop", courses=True, balconies=0.3, roof="mansard", cornice_m=(0.5, 0.45),
            roofs=SLATES + TILES[:2], ornaments=("quoins", "shutters"),
        ),
        Style(
            name="civic", walls=STONES, trims=LIGHT, storeys=(3, 5), storey_m=4.0, ground_m=5.2,
            width_m=(22.0, 34.0), depth_m=(15.0, 20.0), bay_m=3.7, window_m=(1.5, 2.5), sill_m=0.8,
            ground="lobby", courses=True, pilaster_m=0.8, cornice_m=(0.7, 0.9), recess_m=0.3, front_m=2.0,
            ornaments=("columns", "quoins"),
        ),
        Style(
            name="slab", walls=PANELS + PLASTERS[:6], trims=LIGHT, storeys=(6, 10), storey_m=2.9,
            ground_m=3.4, width_m=(20.0, 32.0), depth_m=(12.0, 14.0), bay_m=3.3, window_m=(1.5, 1.45),
            sill_m=0.85, balconies=0.5, cornice_m=(0.1, 0.3), gap_m=5.0, front_m=3.0, wide=True,
            ornaments=("loggias", "coolers"),
        ),
        Style(
            name="office", walls=PANELS + STONES, trims=DARK + LIGHT, storeys=(6, 14), storey_m=3.6,
            ground_m=4.8, width_m=(18.0, 32.0), depth_m=(15.0, 20.0), bay_m=3.0, window_m=(2.45, 1.7),
            sill_m=0.95, ground="lobby", cornice_m=(0.12, 0.6), pilaster_m=0.4, recess_m=0.2, wide=True,
        ),
        Style(
            name="ribbon", walls=PANELS + BRICKS[:5] + STONES[:2], trims=DARK + LIGHT, storeys=(5, 11),
            storey_m=3.6, ground_m=4.4, width_m=(20.0, 34.0), depth_m=(14.0, 19.0), bay_m=2.4,
            window_m=(2.3, 1.6), sill_m=1.0, ground="lobby", cornice_m=(0.15, 0.5), recess_m=0.1, wide=True,
            ornaments=("spandrels",),
        ),
        Style(
            name="deco", walls=STONES + PLASTERS[:4], trims=LIGHT + DARK, storeys=(5, 9), storey_m=3.4,
            ground_m=4.6, width_m=(15.0, 24.0), depth_m=(14.0, 18.0), bay_m=2.6, window_m=(1.4, 1.9),
            sill_m=0.7, ground="shop", pilaster_m=0.9, recess_m=0.25, setback_storeys=6,
            cornice_m=(0.2, 1.0), ornaments=("spandrels", "bands"),
        ),
        Style(
            name="flats", walls=PLASTERS + SIDINGS[:3], trims=LIGHT + DARK, storeys=(4, 6), storey_m=3.0,
            ground_m=3.2, width_m=(16.0, 26.0), depth_m=(12.0, 15.0), bay_m=3.4, window_m=(1.5, 1.5),
            sill_m=0.8, balconies=0.6, cornice_m=(0.06, 0.3), gap_m=4.0, front_m=3.0, wide=True,
            ornaments=("loggias", "plinth"),
        ),
        Style(
            name="stepped", walls=STONES + BRICKS[5:8], trims=LIGHT, storeys=(12, 22), storey_m=3.6,
            ground_m=5.0, width_m=(20.0, 30.0), depth_m=(18.0, 24.0), bay_m=2.4, window_m=(1.2, 1.95),
            sill_m=0.8, ground="shop", pilaster_m=0.5, setback_storeys=8, recess_m=0.2,
        ),
        Style(
            name="tower", walls=TOWERS, trims=DARK, storeys=(18, 40), storey_m=3.9, ground_m=6.0,
            width_m=(22.0, 32.0), depth_m=(20.0, 28.0), bay_m=3.0, window_m=(2.9, 3.7), sill_m=0.1,
            ground="lobby", setback_storeys=14, cornice_m=(0.1, 0.8), recess_m=0.05, front_m=3.0, gap_m=4.0,
        ),
        Style(
            name="pavilion", walls=TOWERS, trims=DARK + LIGHT, storeys=(2, 3), storey_m=4.0, ground_m=4.6,
            width_m=(16.0, 30.0), depth_m=(14.0, 20.0), bay_m=2.4, window_m=(2.3, 3.7), sill_m=0.1,
            ground="shop", cornice_m=(0.9, 0.5), recess_m=0.05, front_m=1.0, gap_m=3.0,
        ),
        Style(
            name="shop_row", walls=BRICKS + PLASTERS + SIDINGS[:6], trims=LIGHT + DARK, storeys=(1, 2),
            storey_m=3.2, ground_m=4.2, width_m=(8.0, 15.0), depth_m=(12.0, 16.0), bay_m=3.0,
            window_m=(1.4, 1.4), sill_m=0.9, ground="shop", cornice_m=(0.25, 0.6),
            ornaments=("coolers", "bands"),
        ),
        Style(
            name="timbered", walls=PLASTERS[:3] + PLASTERS[6:9], trims=LIGHT, storeys=(2, 3), storey_m=2.8,
            ground_m=3.2, width_m=(8.0, 13.0), depth_m=(10.0, 13.0), bay_m=2.2, window_m=(1.2, 1.25),
            sill_m=0.85, ground="shop", roof="front_gable", cornice_m=(0.0, 0.0), recess_m=0.1, front_m=0.6,
            accents=((70, 46, 30), (50, 34, 24), (96, 40, 30)), ornaments=("timber",), gap_m=0.4,
        ),
        Style(
            name="townhouse", walls=PLASTERS + BRICKS[:5], trims=LIGHT, storeys=(3, 4), storey_m=3.0,
            ground_m=3.4, width_m=(6.5, 9.5), depth_m=(11.0, 14.0), bay_m=2.3, window_m=(1.2, 1.7),
            sill_m=0.75, roof="front_gable", cornice_m=(0.0, 0.0), recess_m=0.14, front_m=0.8,
            ornaments=("shutters", "plinth"), gap_m=0.1, roofs=TILES + SLATES,
        ),
        Style(
            name="terrace", walls=BRICKS + STONES[:2], trims=LIGHT, storeys=(2, 3), storey_m=3.0,
            ground_m=3.2, width_m=(11.0, 19.0), depth_m=(9.0, 11.0), bay_m=3.2, window_m=(1.2, 1.6),
            sill_m=0.8, roof="gable", cornice_m=(0.0, 0.0), recess_m=0.14, front_m=2.6, roofs=SLATES,
            ornaments=("oriels", "plinth"), gap_m=0.3,
        ),
        Style(
            name="house", walls=PLASTERS + BRICKS[:4], trims=LIGHT, storeys=(1, 2), storey_m=2.8,
            ground_m=2.9, width_m=(9.0, 13.0), depth_m=(8.0, 10.5), bay_m=3.0, window_m=(1.25, 1.25),
            sill_m=0.9, roof="gable", cornice_m=(0.0, 0.0), gap_m=5.0, front_m=6.0, recess_m=0.1,
            ornaments=("shutters", "plinth"), roofs=TILES + SLATES[:1],
        ),
        Style(
            name="bungalow", walls=SIDINGS, trims=LIGHT, storeys=(1, 1), storey_m=2.8, ground_m=2.9,
            width_m=(11.0, 16.0), depth_m=(8.5, 11.0), bay_m=3.1, window_m=(1.5, 1.25), sill_m=0.9,
            roof="hip", cornice_m=(0.0, 0.0), gap_m=5.0, front_m=6.5, recess_m=0.08, wide=True,
            ornaments=("porch",), roofs=SLATES + TILES[1:2],
        ),
        Style(
            name="villa", walls=PLASTERS[:8] + STONES[:2], trims=LIGHT, storeys=(2, 2), storey_m=3.0,
            ground_m=3.2, width_m=(11.0, 15.0), depth_m=(10.0, 12.0), bay_m=2.9, window_m=(1.2, 1.6),
            sill_m=0.75, roof="hip", cornice_m=(0.0, 0.0), gap_m=6.0, front_m=7.0, recess_m=0.14,
            balconies=0.25, courses=True, ornaments=("quoins", "shutters", "porch"), roofs=TILES + SLATES[:1],
        ),
        Style(
            name="clapboard", walls=SIDINGS, trims=LIGHT, storeys=(2, 2), storey_m=2.8, ground_m=2.9,
            width_m=(9.0, 12.0), depth_m=(9.0, 11.0), bay_m=2.8, window_m=(1.2, 1.4), sill_m=0.8,
            roof="front_gable", cornice_m=(0.0, 0.0), gap_m=5.0, front_m=6.0, recess_m=0.08,
            ornaments=("porch", "shutters"), roofs=SLATES + TILES[4:],
        ),
        Style(
            name="warehouse", walls=SHEETS + PANELS[:2] + BRICKS[:2], trims=DARK, storeys=(1, 1),
            storey_m=7.0, ground_m=7.5, width_m=(24.0, 42.0), depth_m=(18.0, 28.0), bay_m=5.5,
            window_m=(3.6, 1.0), sill_m=5.2, ground="hall", cornice_m=(0.08, 0.4), gap_m=8.0, front_m=6.0,
            wide=True, ornaments=("plinth", "docks"),
        ),
        Style(
            name="factory", walls=BRICKS, trims=LIGHT + DARK, storeys=(1, 2), storey_m=4.6, ground_m=5.4,
            width_m=(24.0, 40.0), depth_m=(18.0, 26.0), bay_m=4.0, window_m=(2.6, 2.4), sill_m=1.5,
            ground="hall", roof="sawtooth", cornice_m=(0.12, 0.4), gap_m=7.0, front_m=5.0, wide=True,
            pilaster_m=0.5, ornaments=("bands",), roofs=((Material.SHEET_METAL, (200, 200, 205)),),
        ),
        Style(
            name="depot", walls=SHEETS, trims=DARK, storeys=(1, 1), storey_m=6.0, ground_m=6.2,
            width_m=(20.0, 36.0), depth_m=(16.0, 24.0), bay_m=4.5, window_m=(2.4, 0.9), sill_m=4.3,
            ground="hall", roof="gable", cornice_m=(0.0, 0.0), gap_m=7.0, front_m=6.0, wide=True,
            roofs=((Material.SHEET_METAL, (215, 215, 220)), (Material.SHEET_METAL, (150, 110, 95))),
            ornaments=("plinth", "docks"),
        ),
        Style(
            name="farmhouse", walls=(*PLASTERS[:4], (Material.RUBBLE, (255, 250, 240))), trims=LIGHT,
            storeys=(2, 2), storey_m=2.8, ground_m=2.9, width_m=(11.0, 15.0), depth_m=(8.5, 10.0),
            bay_m=2.9, window_m=(1.2, 1.35), sill_m=0.85, roof="gable", cornice_m=(0.0, 0.0), gap_m=18.0,
            front_m=9.0, recess_m=0.16, ornaments=("shutters", "plinth"), roofs=TILES + SLATES[:1],
        ),
        Style(
            name="barn", walls=BOARDS, trims=LIGHT, storeys=(1, 1), storey_m=4.5, ground_m=4.5,
            width_m=(18.0, 28.0), depth_m=(10.0, 14.0), bay_m=6.0, window_m=(0.9, 0.9), sill_m=2.6,
            ground="hall", roof="gable", cornice_m=(0.0, 0.0), gap_m=25.0, front_m=15.0,
            roofs=((Material.SHEET_METAL, (190, 190, 195)), *TILES[:2]),
        ),
    )
}  # fmt: skip
"""All styles by name."""
