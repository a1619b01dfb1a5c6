"""Buildings of their own kind: farms, filling stations, monuments.

Farms: barns with gambrel or gable roofs, silos with domes, a yard with a house.

A filling station: canopy, pumps, shop and price sign.

Things that stand on squares: an obelisk and a fountain.
"""

from itertools import pairwise

import numpy as np

from carlaloc_env.assets.plants import bale
from carlaloc_env.assets.primitives import Look, lathe
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.buildings import BuildingPlan, building_mesh, draw_appearance
from carlaloc_env.scenery.buildings.styles import STYLES
from carlaloc_env.scenery.buildings.walls import GARAGE_DOOR, Wall, around
from carlaloc_env.scenery.meshing.batches import copies, poses
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder, box_quads, cell_uv

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


_STONE = (235, 228, 210)


def monument() -> Mesh:
    """An obelisk on steps, 13 m high."""
    out = MeshBuilder()
    steps = [(4.0, 0.35), (3.2, 0.7), (2.4, 1.05)]
    low = [(-half, -half, height - 0.35 if height > 0.4 else -0.5) for half, height in steps]
    high = [(half, half, height) for half, height in steps]
    out.quads(box_quads(low, high), material=Material.ASHLAR, tag=Tag.OTHER, colour=_STONE)
    plinth = box_quads(
        [(-1.3, -1.3, 1.05), (-1.5, -1.5, 3.1)], [(1.3, 1.3, 3.1), (1.5, 1.5, 3.45)], bottom=True
    )
    out.quads(plinth, material=Material.ASHLAR, tag=Tag.OTHER, colour=(215, 208, 190))
    ring = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=np.float64)
    levels = [(0.95, 3.45), (0.62, 11.8), (0.02, 13.0)]
    for (a, z0), (b, z1) in pairwise(levels):
        base = np.column_stack([ring * a, np.full(4, z0)])
        head = np.column_stack([ring * b, np.full(4, z1)])
        faces = np.stack([base, np.roll(base, -1, 0), np.roll(head, -1, 0), head], axis=1)
        out.quads(faces, material=Material.ASHLAR, tag=Tag.OTHER, colour=_STONE)
    for wall in around(2.6, 2.6):
        plate = wall.front(0.5, 2.1, 1.5, 2.6, 0.02) - np.array([1.3, 1.3, 0.0])
        out.quads(plate, material=Material.METAL_PAINTED, tag=Tag.OTHER, colour=(70, 55, 25))
    return out.build()


def fountain() -> Mesh:
    """Two bowls over a round basin, 4.2 m high."""
    stone = Look(Material.CONCRETE, Tag.STATIC, (250, 244, 228))
    water = Look(Material.WATER, Tag.WATER)
    basin = [(4.2, -0.4), (4.2, 0.55), (4.05, 0.62), (3.85, 0.62), (3.75, 0.5), (3.75, 0.15), (0.1, 0.15)]
    stem = [(0.9, 0.1), (0.5, 0.5), (0.32, 1.4), (0.4, 1.8)]
    lower = [(1.75, 2.15), (1.8, 2.3), (1.65, 2.25), (0.25, 2.0)]
    upper = [(0.3, 2.0), (0.18, 2.6), (0.22, 3.2), (0.95, 3.45), (1.0, 3.55), (0.9, 3.5), (0.12, 3.35)]
    tip = [(0.14, 3.3), (0.1, 3.8), (0.2, 3.95), (0.16, 4.1), (0.02, 4.2)]
    pools = [
        lathe(water, [(r, z - 0.02), (r - 0.02, z), (0.05, z)], 28) for r, z in ((3.8, 0.42), (1.6, 2.2))
    ]
    return merge([*(lathe(stone, line, 28) for line in (basin, stem + lower, upper, tip)), *pools])
