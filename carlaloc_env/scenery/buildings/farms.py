"""Farms: barns with gambrel or gable roofs, silos with domes, a yard with a house."""

import numpy as np

from carlaloc_env.assets.plants import bale
from carlaloc_env.assets.primitives import Look, lathe
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.buildings import BuildingPlan, building_mesh, draw_appearance
from carlaloc_env.scenery.buildings.shell import GARAGE_DOOR
from carlaloc_env.scenery.buildings.styles import STYLES
from carlaloc_env.scenery.buildings.walls import Wall, around
from carlaloc_env.scenery.meshing.atlas_cells import cell_uv
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads
from carlaloc_env.scenery.meshing.props import copies, poses

EAVES_M = 4.4
"""Height of a barn's walls [m]."""
_PAINTS: tuple[tuple[Material, Colour], ...] = (
    (Material.SIDING, (150, 34, 26)), (Material.WOOD, (190, 175, 160)), (Material.SIDING, (225, 222, 212)),
    (Material.WOOD, (150, 110, 80)), (Material.SHEET_METAL, (200, 205, 200)),
    (Material.BRICK_RED, (255, 240, 225)),
)  # fmt: skip
_ROOFS: tuple[tuple[Material, Colour], ...] = (
    (Material.SHEET_METAL, (185, 185, 190)), (Material.ROOF_TILE, (235, 190, 165)),
    (Material.SHEET_METAL, (150, 90, 70)), (Material.ROOF_SLATE, (255, 255, 255)),
)  # fmt: skip
_TRIM: Colour = (236, 234, 226)


def barn(width_m: float, depth_m: float, draw: np.random.Generator) -> Mesh:
    """A barn centred on the origin with large doors in the gable that looks along +x.

    Args:
        width_m: Length of the gables, along y [m].
        depth_m: Length of the ridge, along x [m].
        draw: Randomness.
    """
    out = MeshBuilder()
    stuff, tint = _PAINTS[int(draw.integers(len(_PAINTS)))]
    roof, roof_tint = _ROOFS[int(draw.integers(len(_ROOFS)))]
    half, x0, x1 = width_m / 2, -depth_m / 2, depth_m / 2
    gambrel = draw.random() < 0.6
    knee = (0.62 * half, 0.62 * half) if gambrel else (0.5 * half, 0.36 * half)
    top = (0.84 if gambrel else 0.72) * half
    y = np.array([-half, -knee[0], 0.0, knee[0], half])
    z = EAVES_M + np.array([0.0, knee[1], top, knee[1], 0.0])
    walls = [wall.moved((x0, -half, 0.0)) for wall in around(depth_m, width_m)]
    faces = np.concatenate([wall.front(0.0, wall.width_m, -1.0, EAVES_M) for wall in walls])
    out.quads(faces, material=stuff, tag=Tag.BUILDING, colour=tint)
    for x, order in ((x1, 1), (x0, -1)):
        parts = [
            [(x, y[i], EAVES_M), (x, y[i + 1], EAVES_M), (x, y[i + 1], z[i + 1]), (x, y[i], z[i])][::order]
            for i in range(4)
        ]
        gable = np.array(parts)
        uv = np.stack([gable[..., 1], gable[..., 2]], axis=-1)
        out.quads(gable, material=stuff, tag=Tag.BUILDING, colour=tint, uv_m=uv)
    over = 0.45
    drop = over * (z[1] - z[0]) / (y[1] - y[0])
    y[[0, 4]] += [-over, over]
    z[[0, 4]] -= drop
    sheets = np.array(
        [[(x0 - over, y[i], z[i]), (x1 + over, y[i], z[i]), (x1 + over, y[i + 1], z[i + 1]),
          (x0 - over, y[i + 1], z[i + 1])] for i in range(4)]
    )  # fmt: skip
    sheets[..., 2] += 0.08
    out.quads(sheets, material=roof, tag=Tag.BUILDING, colour=roof_tint)
    under = sheets[:, ::-1] - np.array([0.0, 0.0, 0.14])
    out.quads(under, material=Material.WOOD, tag=Tag.BUILDING, colour=_TRIM)
    _barn_openings(out, walls, half, draw)
    return out.build()


def silo(diameter_m: float = 5.0, height_m: float = 15.0) -> Mesh:
    """A round silo with hoops, a domed roof, a ladder and a filling pipe, on the origin."""
    r, h = diameter_m / 2, height_m
    steel = Look(Material.SHEET_METAL, Tag.BUILDING, (225, 228, 230))
    hoop = Look(Material.METAL_GALVANISED, Tag.BUILDING, (170, 172, 174))
    body = lathe(steel, [(r, -0.5), (r, h)], 22)
    angles = np.linspace(0.0, 0.5 * np.pi - 0.05, 6)
    dome = [(r * elementary.cos(a), h + 0.75 * r * elementary.sin(a)) for a in angles]
    parts = [body, lathe(hoop, [(r + 0.12, h - 0.05), *dome], 22)]
    for z in np.arange(0.6, h, 1.4):
        parts.append(lathe(hoop, [(r, z - 0.06), (r + 0.05, z), (r, z + 0.06)], 22))
    out = MeshBuilder()
    rungs = np.arange(0.6, h + 0.4, 0.45)
    low, high = [(r + 0.05, -0.22, z) for z in rungs], [(r + 0.16, 0.22, z + 0.04) for z in rungs]
    out.quads(box_quads(low, high), material=Material.METAL_GALVANISED, tag=Tag.BUILDING)
    for y in (-0.25, 0.21):
        rail = box_quads([r + 0.08, y, 0.3], [r + 0.14, y + 0.04, h + 0.6])
        out.quads(rail, material=Material.METAL_GALVANISED, tag=Tag.BUILDING)
    pipe = box_quads([-r - 0.3, -0.15, 0.0], [-r - 0.02, 0.15, h + 0.8 * r])
    out.quads(pipe, material=Material.METAL_GALVANISED, tag=Tag.BUILDING, colour=(200, 200, 200))
    return merge([*parts, out.build()])


def farm(width_m: float, depth_m: float, draw: np.random.Generator) -> Mesh:
    """A farm round a yard that opens along +x: a house, a barn, a shed, silos and bales.

    Args:
        width_m: Extent along y [m].
        depth_m: Extent along x [m].
        draw: Randomness.
    """
    w, d = width_m / 2, depth_m / 2
    house_style = STYLES["farmhouse"]
    plan = BuildingPlan(appearance=draw_appearance(house_style, draw), width_m=13.0, depth_m=9.0, storeys=2)
    # The house's own front looks along −y; here it looks along +y into the yard from the south side.
    house = copies(building_mesh(plan, draw, 0), poses([(d - 6.0, -w + 10.5, 0.0)], np.pi), 0)
    large = barn(13.0, min(24.0, 1.1 * depth_m), draw)
    parts = [house, copies(large, poses([(-d + 14.0, w - 8.0, 0.0)], 0.0), 0)]
    shed = barn(9.0, 14.0, draw)
    parts.append(copies(shed, poses([(-d + 8.0, -w + 9.0, 0.0)], np.pi / 2), 0))
    for k, (size, high) in enumerate(((4.6, 15.0), (4.0, 12.0), (2.6, 7.0))):
        spot = (-d + 29.0 if k < 2 else -d + 25.0, w - 4.0 - 5.2 * k, 0.0)
        parts.append(copies(silo(size, high), poses([spot], float(draw.uniform(0, 6.28))), 0))
    hay = np.array([(d - 5.0 + 1.6 * (k % 3), w - 7.0 - 1.3 * (k // 3), 0.0) for k in range(6)])
    parts.append(copies(bale(), poses(hay - [2.0, 0.0, 0.0], draw.uniform(-0.1, 0.1, 6)), 0))
    return merge(parts)


def _barn_openings(out: MeshBuilder, walls: list[Wall], half: float, draw: np.random.Generator) -> None:
    """Braced doors and a loft door in front, a roller door behind, small windows along the sides."""
    south, front, north, back = walls
    leaf, middle = min(2.0, 0.45 * half), front.width_m / 2
    for a0, a1 in ((middle - leaf, middle - 0.02), (middle + 0.02, middle + leaf)):
        door = front.box(a0, a1, -0.1, 3.6, 0.06)
        out.quads(door, material=Material.WOOD, tag=Tag.BUILDING, colour=(200, 190, 175))
        low = np.array([(a0, 0.05), (a0, 1.7), (a0, 3.35), (a0, 0.0), (a1 - 0.16, 0.0)])
        high = np.array([(a1, 0.25), (a1, 1.9), (a1, 3.55), (a0 + 0.16, 3.55), (a1, 3.55)])
        bars = front.box(low[:, 0], high[:, 0], low[:, 1], high[:, 1], 0.11)
        out.quads(bars, material=Material.SIDING, tag=Tag.BUILDING, colour=_TRIM)
    loft = front.box(middle - 0.7, middle + 0.7, EAVES_M + 0.1, EAVES_M + 1.5, 0.07)
    out.quads(loft, material=Material.WOOD, tag=Tag.BUILDING, colour=(190, 180, 165))
    gate = back.front(middle - 2.0, middle + 2.0, 0.0, 3.4, 0.04)
    uv = cell_uv(Material.DOOR, np.array([GARAGE_DOOR]))
    out.quads(gate, material=Material.DOOR, tag=Tag.BUILDING, uv_m=uv)
    for wall in (south, north):
        a = np.arange(2.5, wall.width_m - 2.5, 4.2)
        pane = wall.front(a, a + 1.1, 1.5, 2.4, 0.03)
        pick = cell_uv(Material.WINDOW, draw.integers(0, 16, len(a)))
        out.quads(pane, material=Material.WINDOW, tag=Tag.BUILDING, uv_m=pick)
        frame = [wall.box(a - 0.1, a + 1.2, low, high, 0.08) for low, high in ((1.38, 1.5), (2.4, 2.5))]
        out.quads(np.concatenate(frame), material=Material.SIDING, tag=Tag.BUILDING, colour=_TRIM)
