"""Procedural textures: one linear-light layer per material, built by code and cached."""

from carlaloc_env.assets.texture_atlas import (
    DoorCell,
    PosterCell,
    ShopCell,
    SignCell,
    WindowCell,
    atlas_cells,
    atlas_uv,
    cell_corners,
)
from carlaloc_env.render.textures.build import TextureSet, build_textures

__all__ = [
    "DoorCell",
    "PosterCell",
    "ShopCell",
    "SignCell",
    "TextureSet",
    "WindowCell",
    "atlas_cells",
    "atlas_uv",
    "build_textures",
    "cell_corners",
]
