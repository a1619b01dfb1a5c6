"""All texture layers, built once per version of this code and cached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.files.array_cache import Arrays, cached
from carlaloc_env.core.rng import stream
from carlaloc_env.render.textures import (
    cladding,
    crops,
    ground,
    noise,
    number_plates,
    shop_signs,
    signs_and_posters,
    small_materials,
    walls,
    windows_and_doors,
)
from carlaloc_env.render.textures.noise import Layer
from carlaloc_env.scene.materials import Material

_Recipe = Callable[[np.random.Generator, int], Layer]
"""Makes a texture layer from a source of randomness and an edge [px]."""

RECIPES: dict[Material, _Recipe] = {
    Material.PLAIN: small_materials.plain,
    Material.ASPHALT: ground.asphalt,
    Material.ASPHALT_OLD: ground.asphalt_old,
    Material.ASPHALT_MOTORWAY: ground.asphalt_motorway,
    Material.ROAD_PAINT_WHITE: partial(ground.road_paint, colour=(0.58, 0.58, 0.55)),
    Material.ROAD_PAINT_YELLOW: partial(ground.road_paint, colour=(0.48, 0.31, 0.045)),
    Material.CONCRETE: ground.concrete,
    Material.PAVEMENT: ground.pavement,
    Material.KERB: ground.kerb,
    Material.GRASS: ground.grass,
    Material.SOIL: ground.soil,
    Material.BRICK_RED: partial(walls.brick, colour=(0.265, 0.105, 0.068)),
    Material.BRICK_BROWN: partial(walls.brick, colour=(0.19, 0.125, 0.085)),
    Material.PLASTER: walls.plaster,
    Material.ASHLAR: walls.ashlar,
    Material.CONCRETE_PANEL: walls.concrete_panel,
    Material.CURTAIN_WALL: walls.curtain_wall,
    Material.WINDOW: windows_and_doors.windows,
    Material.SHOP_FRONT: windows_and_doors.shop_fronts,
    Material.ROOF_TILE: walls.roof_tile,
    Material.ROOF_FLAT: ground.roof_flat,
    Material.BARK: small_materials.bark,
    Material.LEAF: small_materials.leaf,
    Material.METAL_GALVANISED: small_materials.galvanised,
    Material.METAL_PAINTED: small_materials.painted_metal,
    Material.CAR_PAINT: small_materials.car_paint,
    Material.GLASS: small_materials.glass,
    Material.RUBBER: small_materials.rubber,
    Material.PLASTIC: small_materials.plastic,
    Material.SIGN: signs_and_posters.signs,
    Material.CLOTH: small_materials.cloth,
    Material.SKIN: small_materials.skin,
    Material.WATER: ground.water,
    Material.LAMP_WHITE: partial(small_materials.lamp, colour=(0.80, 0.78, 0.70)),
    Material.LAMP_RED: partial(small_materials.lamp, colour=(0.62, 0.035, 0.025)),
    Material.LAMP_AMBER: partial(small_materials.lamp, colour=(0.75, 0.34, 0.025)),
    Material.LAMP_GREEN: partial(small_materials.lamp, colour=(0.05, 0.62, 0.33)),
    Material.WOOD: small_materials.wood,
    Material.POSTER: signs_and_posters.posters,
    Material.GRAVEL: ground.gravel,
    Material.DOOR: windows_and_doors.doors,
    Material.SIDING: cladding.siding,
    Material.SHEET_METAL: cladding.sheet_metal,
    Material.RUBBLE: cladding.rubble,
    Material.ROOF_SLATE: cladding.slate,
    Material.CROP: crops.crop,
    Material.FURROWS: crops.furrows,
    Material.SHOP_SIGN: shop_signs.shop_signs,
    Material.BILLBOARD: shop_signs.billboards,
    Material.WINDOW_WIDE: windows_and_doors.wide_windows,
    Material.SHOP_FRONT_B: windows_and_doors.more_shop_fronts,
    Material.PLATE: number_plates.number_plates,
    Material.LAMP_TAIL: partial(small_materials.lamp, colour=(0.30, 0.012, 0.010)),
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
"""What stands behind the roadway; photographs show it paler than it is, and its joints less."""
FACADE_CONTRAST = 0.66
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
    """All layers computed anew, shape (len(Material), S, S, 4)."""
    out = np.empty((len(Material), size_px, size_px, 4), dtype=np.float16)
    for material in Material:
        layer = RECIPES[material](stream(0, f"texture/{material.name}"), size_px)
        if material in WIDE:
            layer = noise.levelled(layer, WIDE[material])
        out[material] = noise.softened(layer, FACADE_CONTRAST) if material in FACADES else layer
    return out
