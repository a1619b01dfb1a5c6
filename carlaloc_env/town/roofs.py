"""Roofs of buildings: flat with parapet and plant, gable, mansard."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.materials import Material
from carlaloc_env.semantics import Tag
from carlaloc_env.town.cells import cell_uv
from carlaloc_env.town.looks import Look
from carlaloc_env.town.meshing import MeshBuilder, box_quads
from carlaloc_env.town.walls import Wall

Array = NDArray[np.float64]

PARAPET_M = 0.9
"""Height of the wall round a flat roof [m]."""


def add_roof(
    out: MeshBuilder,
    look: Look,
    part: tuple[float, float, float, float],
    z: float,
    rng: np.random.Generator,
    top: bool,
) -> None:
    """The roof of one part (x, y, width, depth) [m] of a building at height z; `top` on its last part."""
    x, y, width, depth = part
    if look.style.roof == "gable":
        _gable(out, look, part, z)
        return
    if look.style.roof == "mansard" and top:
        _mansard(out, look, part, z, rng)
        return
    low, high = np.array([x, y, z]), np.array([x + width, y + depth, z])
    deck = np.array([[low, [high[0], low[1], z], high, [low[0], high[1], z]]])
    out.quads(deck, material=Material.ROOF_FLAT, tag=Tag.BUILDING, colour=(190, 188, 185))
    t, p = 0.25, PARAPET_M
    rims = box_quads(
        [(x, y, z), (x, y + depth - t, z), (x, y + t, z), (x + width - t, y + t, z)],
        [
            (x + width, y + t, z + p),
            (x + width, y + depth, z + p),
            (x + t, y + depth - t, z + p),
            (x + width, y + depth - t, z + p),
        ],
    )
    material = Material.CONCRETE_PANEL if look.material == Material.CURTAIN_WALL else look.material
    out.quads(rims, material=material, tag=Tag.BUILDING, colour=look.tint)
    if top:
        _plant(out, part, z, rng)


def _plant(
    out: MeshBuilder, part: tuple[float, float, float, float], z: float, rng: np.random.Generator
) -> None:
    """Lift house, cooling units and vents on a flat roof."""
    x, y, width, depth = part
    count = int(rng.integers(2, 6))
    size = rng.uniform([1.2, 1.2, 0.9], [3.6, 3.2, 1.9], (count, 3))
    size[0] = (min(5.0, width * 0.35), min(4.5, depth * 0.35), 2.9)
    room = np.maximum(np.array([width, depth]) - size[:, :2] - 2.0, 0.1)
    low = np.array([x + 1.0, y + 1.0]) + rng.random((count, 2)) * room
    boxes = box_quads(
        np.column_stack([low, np.full(count, z)]), np.column_stack([low + size[:, :2], z + size[:, 2]])
    )
    out.quads(boxes, material=Material.METAL_GALVANISED, tag=Tag.BUILDING, colour=(215, 215, 212))


def _gable(out: MeshBuilder, look: Look, part: tuple[float, float, float, float], z: float) -> None:
    x, y, width, depth = part
    over, rise = 0.5, depth / 2 * 0.7
    slope = rise / (depth / 2)
    y0, y1, ym, low = y - over, y + depth + over, y + depth / 2, z - over * slope
    x0, x1, ridge = x - over, x + width + over, z + rise
    front = [(x0, y0, low), (x1, y0, low), (x1, ym, ridge), (x0, ym, ridge)]
    back = [(x1, y1, low), (x0, y1, low), (x0, ym, ridge), (x1, ym, ridge)]
    tiles = np.array([front, back])
    lowered = tiles - np.array([0.0, 0.0, 0.15])
    tint = ((255, 235, 220), (170, 160, 155), (225, 150, 120))[int(look.tint[0] + look.trim[1]) % 3]
    out.quads(tiles, material=Material.ROOF_TILE, tag=Tag.BUILDING, colour=tint)
    out.quads(lowered[:, ::-1], material=Material.WOOD, tag=Tag.BUILDING, colour=look.trim)
    edges = []
    for top, under in zip(tiles, lowered, strict=True):
        for i in (0, 1, 3):
            j = (i + 1) % 4
            edges.append([under[i], under[j], top[j], top[i]])
    out.quads(np.array(edges), material=Material.WOOD, tag=Tag.BUILDING, colour=look.trim)
    ends = [
        [(x, y + depth, z), (x, y, z), (x, ym, ridge), (x, ym, ridge)],
        [(x + width, y, z), (x + width, y + depth, z), (x + width, ym, ridge), (x + width, ym, ridge)],
    ]
    out.quads(np.array(ends), material=look.material, tag=Tag.BUILDING, colour=look.tint)
    chimney = box_quads([x + width * 0.7, ym + 0.6, z], [x + width * 0.7 + 0.8, ym + 1.3, ridge + 0.8])
    out.quads(chimney, material=Material.BRICK_RED, tag=Tag.BUILDING)


def _mansard(
    out: MeshBuilder, look: Look, part: tuple[float, float, float, float], z: float, rng: np.random.Generator
) -> None:
    x, y, width, depth = part
    inset, rise = 1.3, 2.5
    foot = np.array([(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)])
    head = foot + inset * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    low = np.column_stack([foot, np.full(4, z)])
    high = np.column_stack([head, np.full(4, z + rise)])
    sides = np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1)
    out.quads(sides, material=Material.ROOF_TILE, tag=Tag.BUILDING, colour=(150, 150, 155))
    out.quads(high[None], material=Material.ROOF_FLAT, tag=Tag.BUILDING, colour=(170, 170, 170))
    bays = max(1, round((width - 2.0) / look.style.bay_m))
    a = x + 1.0 + (width - 2.0) / bays * (np.arange(bays) + 0.5)
    dormer = box_quads(
        np.column_stack([a - 0.75, np.full(bays, y + 0.25), np.full(bays, z)]),
        np.column_stack([a + 0.75, np.full(bays, y + 2.0), np.full(bays, z + 1.9)]),
    )
    out.quads(dormer, material=Material.METAL_PAINTED, tag=Tag.BUILDING, colour=(95, 98, 102))
    wall = Wall(origin_m=np.array([0.0, y + 0.25, z]), along=np.array([1.0, 0.0, 0.0]), width_m=width)
    pane = wall.front(a - 0.5, a + 0.5, 0.3, 1.6, 0.02)
    uv = cell_uv(Material.WINDOW, rng.integers(0, 16, bays))
    out.quads(pane, material=Material.WINDOW, tag=Tag.BUILDING, uv_m=uv)
