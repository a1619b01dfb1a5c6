"""All texture layers, built once per version of this code and cached."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.clock import stream
from carlaloc_env.core.files.array_cache import cached
from carlaloc_env.core.files.array_files import Arrays
from carlaloc_env.render.textures.ground import (
    asphalt,
    concrete,
    crop,
    furrows,
    grass,
    gravel,
    kerb,
    pavement,
    road_paint,
    roof_flat,
    soil,
    water,
)
from carlaloc_env.render.textures.noise import Layer, levelled, softened
from carlaloc_env.render.textures.shop_signs import billboards, number_plates, shop_signs
from carlaloc_env.render.textures.signs_and_posters import posters, signs
from carlaloc_env.render.textures.things import (
    bark,
    car_paint,
    cloth,
    galvanised,
    glass,
    lamp,
    leaf,
    painted_metal,
    plain,
    plastic,
    rubber,
    skin,
    wood,
)
from carlaloc_env.render.textures.walls import (
    ashlar,
    brick,
    concrete_panel,
    curtain_wall,
    plaster,
    roof_tile,
    rubble,
    sheet_metal,
    siding,
    slate,
)
from carlaloc_env.render.textures.windows_and_doors import (
    doors,
    more_shop_fronts,
    shop_fronts,
    wide_windows,
    windows,
)
from carlaloc_env.scene.materials import Material

_Recipe = Callable[[np.random.Generator, int], Layer]
"""Makes a texture layer from a source of randomness and an edge [px]."""

RECIPES: dict[Material, _Recipe] = {
    Material.PLAIN: plain,
    Material.ASPHALT: partial(asphalt, colour=(0.120, 0.118, 0.114), mortar=0.05, stones=0.15, roughness=0.9),
    # The bitumen has worn off the stones.
    Material.ASPHALT_OLD: partial(
        asphalt, colour=(0.135, 0.131, 0.124), mortar=0.06, stones=0.18, roughness=0.92
    ),
    # Stone mastic asphalt: small bare stones of one size.
    Material.ASPHALT_MOTORWAY: partial(
        asphalt, colour=(0.122, 0.120, 0.116), mortar=0.04, stones=0.14, roughness=0.9
    ),
    Material.ROAD_PAINT_WHITE: partial(road_paint, colour=(0.58, 0.58, 0.55)),
    Material.ROAD_PAINT_YELLOW: partial(road_paint, colour=(0.48, 0.31, 0.045)),
    Material.CONCRETE: concrete,
    Material.PAVEMENT: pavement,
    Material.KERB: kerb,
    Material.GRASS: grass,
    Material.SOIL: soil,
    Material.BRICK_RED: partial(brick, colour=(0.265, 0.105, 0.068)),
    Material.BRICK_BROWN: partial(brick, colour=(0.19, 0.125, 0.085)),
    Material.PLASTER: plaster,
    Material.ASHLAR: ashlar,
    Material.CONCRETE_PANEL: concrete_panel,
    Material.CURTAIN_WALL: curtain_wall,
    Material.WINDOW: windows,
    Material.SHOP_FRONT: shop_fronts,
    Material.ROOF_TILE: roof_tile,
    Material.ROOF_FLAT: roof_flat,
    Material.BARK: bark,
    Material.LEAF: leaf,
    Material.METAL_GALVANISED: galvanised,
    Material.METAL_PAINTED: painted_metal,
    Material.CAR_PAINT: car_paint,
    Material.GLASS: glass,
    Material.RUBBER: rubber,
    Material.PLASTIC: plastic,
    Material.SIGN: signs,
    Material.CLOTH: cloth,
    Material.SKIN: skin,
    Material.WATER: water,
    Material.LAMP_WHITE: partial(lamp, colour=(0.80, 0.78, 0.70)),
    Material.LAMP_RED: partial(lamp, colour=(0.62, 0.035, 0.025)),
    Material.LAMP_AMBER: partial(lamp, colour=(0.75, 0.34, 0.025)),
    Material.LAMP_GREEN: partial(lamp, colour=(0.05, 0.62, 0.33)),
    Material.WOOD: wood,
    Material.POSTER: posters,
    Material.GRAVEL: gravel,
    Material.DOOR: doors,
    Material.SIDING: siding,
    Material.SHEET_METAL: sheet_metal,
    Material.RUBBLE: rubble,
    Material.ROOF_SLATE: slate,
    Material.CROP: crop,
    Material.FURROWS: furrows,
    Material.SHOP_SIGN: shop_signs,
    Material.BILLBOARD: billboards,
    Material.WINDOW_WIDE: wide_windows,
    Material.SHOP_FRONT_B: more_shop_fronts,
    Material.PLATE: number_plates,
    Material.LAMP_TAIL: partial(lamp, colour=(0.30, 0.012, 0.010)),
}
"""How each material's layer is made."""
WIDE: dict[Material, float] = {
    Material.ASHLAR: 6.0, Material.BRICK_BROWN: 6.0, Material.BRICK_RED: 6.0, Material.RUBBLE: 6.0,
    Material.ASPHALT: 7.0, Material.ASPHALT_OLD: 7.0, Material.ASPHALT_MOTORWAY: 7.0, Material.CONCRETE: 7.0,
    Material.FURROWS: 7.0, Material.GRAVEL: 7.0, Material.PAVEMENT: 7.0, Material.PLASTER: 7.0,
    Material.ROOF_FLAT: 9.0, Material.SOIL: 9.0, Material.CROP: 12.0, Material.GRASS: 12.0,
}  # fmt: skip
"""Materials that cover hundreds of tiles, and the cycles per tile below which they are levelled; the
renderer's wear and the ground's tint, which do not repeat, shade them slowly instead."""
FACADES = (
    Material.ASHLAR, Material.BRICK_BROWN, Material.BRICK_RED, Material.CONCRETE_PANEL,
    Material.CURTAIN_WALL, Material.ROOF_SLATE, Material.ROOF_TILE, Material.RUBBLE, Material.SHOP_FRONT,
    Material.SHOP_FRONT_B, Material.SIDING, Material.WINDOW, Material.WINDOW_WIDE,
)  # fmt: skip
"""Materials of façades and roofs, whose contrast is reduced, as haze and distance do in photographs."""
FACADE_CONTRAST = 0.85
"""Exponent of the façades' albedo about its mean."""


KEPT_FILES = 2
"""Cached files kept of each size."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TextureSet:
    """One square layer per `Material`; row 0 is v = 0, column 0 is u = 0, v grows upwards on a wall."""

    albedo: NDArray[np.float16]
    """Linear albedo in RGB (0.02–0.85), roughness in A, shape (len(Material), S, S, 4)."""

    @property
    def size_px(self) -> int:
        """Edge of a layer [px]."""
        return int(self.albedo.shape[1])


def build_textures(size_px: int = 512, *, cache_dir: Path | None = None) -> TextureSet:
    """Texture layers of all materials, from the cache when it holds them.

    Args:
        size_px: Edge of a layer [px], a multiple of 8.
        cache_dir: Folder of the cache; $CARLALOC_CACHE or ~/.cache/carlaloc when left out.
    """

    def from_arrays(arrays: Arrays) -> NDArray[np.float16]:
        albedo = arrays["albedo"]
        if albedo.shape != (len(Material), size_px, size_px, 4) or albedo.dtype != np.float16:
            raise ValueError(f"albedo is {albedo.dtype} of shape {albedo.shape}")
        return albedo

    albedo = cached(
        f"textures-{size_px}",
        "textures",
        module=__name__,
        make=lambda: make_albedo(size_px),
        to_arrays=lambda made: {"albedo": made},
        from_arrays=from_arrays,
        kept_files=KEPT_FILES,
        folder=cache_dir,
    )
    return TextureSet(albedo=albedo)


def make_albedo(size_px: int) -> NDArray[np.float16]:
    """Compute all layers anew, shape (len(Material), S, S, 4)."""
    out = np.empty((len(Material), size_px, size_px, 4), dtype=np.float16)
    for material in Material:
        layer = RECIPES[material](stream(0, f"texture/{material.name}"), size_px)
        if material in WIDE:
            layer = levelled(layer, WIDE[material])
        out[material] = softened(layer, FACADE_CONTRAST) if material in FACADES else layer
    return out
