"""Posters on the flanks of trucks and buses."""

from __future__ import annotations

from carlaloc_env.assets.modelling.primitives import Look, quad
from carlaloc_env.assets.texture_atlas import PosterCell, atlas_uv, cell_corners
from carlaloc_env.scene.materials import Material, Tag
from carlaloc_env.scene.mesh import Mesh


def advert(
    x_m: float, side: float, cell: PosterCell, tag: Tag, y_m: float, extent_m: tuple[float, float, float]
) -> Mesh:
    """Poster on a flank; extent = half its length, height of its lower and of its upper edge."""
    y, (half, low, high) = side * y_m, extent_m
    x0, x1 = (x_m + half, x_m - half) if side > 0 else (x_m - half, x_m + half)
    corners = [(x0, y, low), (x1, y, low), (x1, y, high), (x0, y, high)]
    return quad(Look(Material.POSTER, tag), corners, cell_corners(atlas_uv(Material.POSTER, cell)))
