"""Roofs of buildings: flat with parapet and plant, gable, hip, mansard, sawtooth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.buildings.appearance import Appearance
from carlaloc_env.town.buildings.walls import Wall
from carlaloc_env.town.meshing.atlas_uv import cell_uv
from carlaloc_env.town.meshing.mesh_builder import MeshBuilder, box_quads

PARAPET_M = 0.9
"""Height of the wall round a flat roof [m]."""


def add_roof(
    out: MeshBuilder,
    appearance: Appearance,
    part: tuple[float, float, float, float],
    z: float,
    rng: np.random.Generator,
    top: bool,
) -> None:
    """The roof of one part (x, y, width, depth) [m] of a building at height z; `top` on its last part."""
    shape = appearance.style.roof if top else "flat"
    if shape == "gable":
        _gable(out, appearance, part, z, turned=False)
    elif shape == "front_gable":
        _gable(out, appearance, part, z, turned=True)
    elif shape == "hip":
        _hip(out, appearance, part, z)
    elif shape == "mansard":
        _mansard(out, appearance, part, z, rng)
    elif shape == "sawtooth":
        _sawtooth(out, appearance, part, z)
    else:
        _flat(out, appearance, part, z)
        if top:
            _plant(out, part, z, rng)


def _flat(
    out: MeshBuilder, appearance: Appearance, part: tuple[float, float, float, float], z: float
) -> None:
    """A deck behind a parapet."""
    x, y, width, depth = part
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
    material = (
        Material.CONCRETE_PANEL if appearance.material == Material.CURTAIN_WALL else appearance.material
    )
    out.quads(rims, material=material, tag=Tag.BUILDING, colour=appearance.tint)


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


def _gable(
    out: MeshBuilder,
    appearance: Appearance,
    part: tuple[float, float, float, float],
    z: float,
    *,
    turned: bool,
) -> None:
    """A ridge along the front, or `turned` from front to back, with boarded eaves and a chimney."""
    x, y, width, depth = part
    if turned:
        # Built lying the other way, then turned by a quarter: (x, y) becomes (−y, x).
        x, y, width, depth = y, -(x + width), depth, width
    over = 0.25 if turned else 0.5
    rise = min(depth / 2 * (0.95 if turned else 0.7), 5.5)
    slope = rise / (depth / 2)
    y0, y1, ym, low = y - over, y + depth + over, y + depth / 2, z - over * slope
    x0, x1, ridge = x - over, x + width + over, z + rise
    front = [(x0, y0, low), (x1, y0, low), (x1, ym, ridge), (x0, ym, ridge)]
    back = [(x1, y1, low), (x0, y1, low), (x0, ym, ridge), (x1, ym, ridge)]
    tiles = np.array([front, back])
    lowered = tiles - np.array([0.0, 0.0, 0.15])
    edges = []
    for top, under in zip(tiles, lowered, strict=True):
        for i in (0, 1, 3):
            j = (i + 1) % 4
            edges.append([under[i], under[j], top[j], top[i]])
    ends = [
        [(x, y + depth, z), (x, y, z), (x, ym, ridge), (x, ym, ridge)],
        [(x + width, y, z), (x + width, y + depth, z), (x + width, ym, ridge), (x + width, ym, ridge)],
    ]
    chimney = box_quads([x + width * 0.7, ym + 0.6, z], [x + width * 0.7 + 0.8, ym + 1.3, ridge + 0.8])
    material, tint = appearance.roof
    for faces, stuff, colour in (
        (tiles, material, tint),
        (lowered[:, ::-1], Material.WOOD, appearance.trim),
        (np.array(edges), Material.WOOD, appearance.trim),
        (np.array(ends), appearance.material, appearance.tint),
        (chimney[: 5 if appearance.style.ground != "hall" else 0], Material.BRICK_RED, (235, 225, 215)),
    ):
        out.quads(_quarter(faces) if turned else faces, material=stuff, tag=Tag.BUILDING, colour=colour)
    if turned:
        _loft_window(out, appearance, part, z, rise)


def _quarter(faces: Array) -> Array:
    """Points turned by a quarter about the vertical."""
    return np.stack([-faces[..., 1], faces[..., 0], faces[..., 2]], axis=-1)


def _loft_window(
    out: MeshBuilder, appearance: Appearance, part: tuple[float, float, float, float], z: float, rise: float
) -> None:
    """A window in the gable that looks to the street."""
    x, y, width, _ = part
    wall = Wall(origin_m=np.array([x, y, z]), along=np.array([1.0, 0.0, 0.0]), width_m=width)
    a, high = width / 2, min(0.5 * rise, 1.5)
    pane = wall.front(a - 0.5, a + 0.5, 0.45, 0.45 + high, 0.03)
    uv = cell_uv(Material.WINDOW, np.array([appearance.tint[1]]))
    out.quads(pane, material=Material.WINDOW, tag=Tag.BUILDING, uv_m=uv)
    frame = [wall.box(a - 0.6, a + 0.6, low, low + 0.1, 0.07) for low in (0.35, 0.45 + high)]
    out.quads(np.concatenate(frame), material=Material.CONCRETE, tag=Tag.BUILDING, colour=appearance.trim)


def _hip(out: MeshBuilder, appearance: Appearance, part: tuple[float, float, float, float], z: float) -> None:
    """Four slopes that meet in a ridge along the longer side."""
    x, y, width, depth = part
    over, slope = 0.55, 0.55
    x0, x1, y0, y1 = x - over, x + width + over, y - over, y + depth + over
    half = min(x1 - x0, y1 - y0) / 2
    low, ridge = z - over * slope * 0.5, z + half * slope
    if width >= depth:
        a, b = (x0 + half, (y0 + y1) / 2, ridge), (x1 - half, (y0 + y1) / 2, ridge)
        slopes = [
            [(x0, y0, low), (x1, y0, low), b, a], [(x1, y1, low), (x0, y1, low), a, b],
            [(x1, y0, low), (x1, y1, low), b, b], [(x0, y1, low), (x0, y0, low), a, a],
        ]  # fmt: skip
    else:
        a, b = ((x0 + x1) / 2, y0 + half, ridge), ((x0 + x1) / 2, y1 - half, ridge)
        slopes = [
            [(x0, y0, low), (x1, y0, low), a, a], [(x1, y1, low), (x0, y1, low), b, b],
            [(x1, y0, low), (x1, y1, low), b, a], [(x0, y1, low), (x0, y0, low), a, b],
        ]  # fmt: skip
    faces = np.array(slopes)
    out.quads(faces, material=appearance.roof[0], tag=Tag.BUILDING, colour=appearance.roof[1])
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    foot = np.column_stack([corners, np.full(4, low - 0.16)])
    head = np.column_stack([corners, np.full(4, low)])
    eaves = np.stack([foot, np.roll(foot, -1, 0), np.roll(head, -1, 0), head], axis=1)
    out.quads(np.concatenate([eaves, foot[None, ::-1]]), material=Material.SIDING, tag=Tag.BUILDING,
              colour=appearance.trim)  # fmt: skip
    corner = np.array([x + width * 0.62, y + depth * 0.55])
    chimney = box_quads([*corner, z], [*(corner + 0.75), ridge + 0.7])
    out.quads(chimney, material=Material.BRICK_BROWN, tag=Tag.BUILDING)


def _sawtooth(
    out: MeshBuilder, appearance: Appearance, part: tuple[float, float, float, float], z: float
) -> None:
    """North lights: upright panes and slopes behind them, across the hall."""
    x, y, width, depth = part
    teeth = max(2, round(width / 6.5))
    step = width / teeth
    a = x + step * np.arange(teeth)
    high = z + 0.36 * step
    y0, y1, one = y, y + depth, np.ones(teeth)

    def quad(points: list[tuple[NDArray[Any], float, float]]) -> Array:
        return np.stack([np.column_stack([p, q * one, r * one]) for p, q, r in points], axis=1)

    panes = quad([(a, y1, z + 0.4), (a, y0, z + 0.4), (a, y0, high - 0.15), (a, y1, high - 0.15)])
    out.quads(panes, material=Material.CURTAIN_WALL, tag=Tag.BUILDING, colour=(225, 235, 240))
    for low, top in ((z, z + 0.4), (high - 0.15, high)):
        band = quad([(a, y1, low), (a, y0, low), (a, y0, top), (a, y1, top)])
        out.quads(band, material=appearance.roof[0], tag=Tag.BUILDING, colour=appearance.roof[1])
    slope = quad([(a, y0, high), (a + step, y0, z), (a + step, y1, z), (a, y1, high)])
    out.quads(slope, material=appearance.roof[0], tag=Tag.BUILDING, colour=appearance.roof[1])
    front = quad([(a, y0, z), (a + step, y0, z), (a, y0, high), (a, y0, high)])
    back = quad([(a + step, y1, z), (a, y1, z), (a, y1, high), (a, y1, high)])
    out.quads(
        np.concatenate([front, back]), material=appearance.material, tag=Tag.BUILDING, colour=appearance.tint
    )


def _mansard(
    out: MeshBuilder,
    appearance: Appearance,
    part: tuple[float, float, float, float],
    z: float,
    rng: np.random.Generator,
) -> None:
    x, y, width, depth = part
    inset, rise = 1.3, 2.5
    foot = np.array([(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)])
    head = foot + inset * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    low = np.column_stack([foot, np.full(4, z)])
    high = np.column_stack([head, np.full(4, z + rise)])
    sides = np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1)
    out.quads(sides, material=appearance.roof[0], tag=Tag.BUILDING, colour=appearance.roof[1])
    out.quads(high[None], material=Material.ROOF_FLAT, tag=Tag.BUILDING, colour=(170, 170, 170))
    bays = max(1, round((width - 2.0) / appearance.style.bay_m))
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
