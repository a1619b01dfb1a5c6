"""A filling station: canopy, pumps, shop and price sign."""

import numpy as np

from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.meshing.atlas_cells import cell_uv
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads

_RED, _WHITE = (170, 18, 14), (235, 235, 230)


def filling_station() -> Mesh:
    """Canopy, four pumps, a shop and a price sign; its front looks along +x."""
    out = MeshBuilder()
    posts = np.array([(x, y) for x in (-1.0, 7.0) for y in (-5.5, 5.5)])
    columns = box_quads(
        np.column_stack([posts - 0.2, np.full(4, -0.5)]), np.column_stack([posts + 0.2, np.full(4, 5.0)])
    )
    out.quads(columns, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_WHITE)
    canopy = box_quads([-3.0, -9.0, 5.0], [9.0, 9.0, 5.9], bottom=True)
    out.quads(canopy, material=Material.METAL_PAINTED, tag=Tag.BUILDING, colour=_WHITE)
    rim = box_quads([-3.04, -9.04, 5.25], [9.04, 9.04, 5.6])
    out.quads(rim, material=Material.METAL_PAINTED, tag=Tag.BUILDING, colour=_RED)
    lights = np.array([(x, y) for x in (0.0, 3.0, 6.0) for y in (-6.0, 0.0, 6.0)])
    z = np.full(len(lights), 4.985)
    ring = ((-0.4, -0.4), (-0.4, 0.4), (0.4, 0.4), (0.4, -0.4))
    lit = np.stack([np.column_stack([lights + corner, z]) for corner in ring], axis=1)
    out.quads(lit, material=Material.LAMP_WHITE, tag=Tag.BUILDING, colour=(120, 120, 115))
    _pumps(out)
    _kiosk(out)
    _price_sign(out)
    return out.build()


def _pumps(out: MeshBuilder) -> None:
    for x in (0.0, 6.0):
        island = box_quads([x - 0.6, -6.5, -0.1], [x + 0.6, 6.5, 0.16])
        out.quads(island, material=Material.KERB, tag=Tag.STATIC)
        for y in (-3.0, 3.0):
            body = box_quads([x - 0.3, y - 0.5, 0.16], [x + 0.3, y + 0.5, 1.9])
            out.quads(body, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_WHITE)
            belt = box_quads([x - 0.32, y - 0.52, 1.45], [x + 0.32, y + 0.52, 1.8])
            out.quads(belt, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_RED)


def _kiosk(out: MeshBuilder) -> None:
    """The shop behind the pumps, front along +x."""
    low, high = np.array([-12.5, -7.0, -0.5]), np.array([-6.0, 7.0, 3.8])
    out.quads(box_quads(low, high), material=Material.PLASTER, tag=Tag.BUILDING, colour=(240, 238, 230))
    y = np.array([-6.3, -3.1, 1.1, 4.3])
    one, ring = np.ones(4), ((0, 0.4), (2.4, 0.4), (2.4, 2.8), (0, 2.8))
    glass = np.stack([np.column_stack([-5.97 * one, y + dy, z * one]) for dy, z in ring], axis=1)
    cells = cell_uv(Material.SHOP_FRONT, np.arange(4))
    out.quads(glass, material=Material.SHOP_FRONT, tag=Tag.BUILDING, uv_m=cells)
    door = np.array([[(-5.97, -0.5, 0.0), (-5.97, 0.8, 0.0), (-5.97, 0.8, 2.3), (-5.97, -0.5, 2.3)]])
    uv = cell_uv(Material.DOOR, np.array([1]))
    out.quads(door, material=Material.DOOR, tag=Tag.BUILDING, uv_m=uv)
    band = box_quads([-12.6, -7.1, 3.1], [-5.85, 7.1, 3.75])
    out.quads(band, material=Material.METAL_PAINTED, tag=Tag.BUILDING, colour=_RED)


def _price_sign(out: MeshBuilder) -> None:
    legs = box_quads([(11.4, 9.5, -0.3), (11.4, 11.3, -0.3)], [(11.6, 9.7, 3.2), (11.6, 11.5, 3.2)])
    out.quads(legs, material=Material.METAL_GALVANISED, tag=Tag.STATIC)
    board = box_quads([11.35, 9.4, 3.2], [11.65, 11.6, 7.0], bottom=True)
    out.quads(board, material=Material.METAL_PAINTED, tag=Tag.STATIC, colour=_RED)
    for x, sign in ((11.66, 1.0), (11.34, -1.0)):
        y0, y1 = (9.5, 11.5) if sign > 0 else (11.5, 9.5)
        z0, z1 = np.array([3.4, 4.6, 5.8]), np.array([4.4, 5.6, 6.8])
        ring = ((y0, z0), (y1, z0), (y1, z1), (y0, z1))
        plates = np.stack([np.column_stack([np.full(3, x), np.full(3, y), z]) for y, z in ring], axis=1)
        uv = cell_uv(Material.POSTER, np.array([2, 8, 15]), aspect=2.0)
        out.quads(plates, material=Material.POSTER, tag=Tag.STATIC, uv_m=uv)
