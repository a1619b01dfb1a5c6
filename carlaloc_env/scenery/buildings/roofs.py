"""Roofs of buildings: flat with parapet and plant, gable, hip, mansard, sawtooth."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scenery.buildings.shell import Shell
from carlaloc_env.scenery.buildings.walls import Wall
from carlaloc_env.scenery.meshing.mesh_builder import box_quads

Part = tuple[float, float, float, float]
"""Part of a building in plan: x, y, width and depth [m]."""
PARAPET_M = 0.9
"""Height of the wall round a flat roof [m]."""


def add_roof(shell: Shell, part: Part, z: float, rng: np.random.Generator, top: bool) -> None:
    """The roof of one part of a building at height z [m]; `top` on its last part."""
    shape = shell.look.style.roof if top else "flat"
    if shape == "gable":
        _gable(shell, part, z, turned=False)
    elif shape == "front_gable":
        _gable(shell, part, z, turned=True)
    elif shape == "hip":
        _hip(shell, part, z)
    elif shape == "mansard":
        _mansard(shell, part, z, rng)
    elif shape == "sawtooth":
        _sawtooth(shell, part, z)
    else:
        _flat(shell, part, z)
        if top:
            _plant(shell, part, z, rng)


def _flat(shell: Shell, part: Part, z: float) -> None:
    """A deck behind a parapet."""
    x, y, width, depth = part
    low, high = np.array([x, y, z]), np.array([x + width, y + depth, z])
    deck = np.array([[low, [high[0], low[1], z], high, [low[0], high[1], z]]])
    shell.faces(deck, Material.ROOF_FLAT, (190, 188, 185))
    t, x1, y1 = 0.25, x + width, y + depth
    starts = [(x, y, z), (x, y1 - t, z), (x, y + t, z), (x1 - t, y + t, z)]
    ends = np.array([(x1, y + t, z), (x1, y1, z), (x + t, y1 - t, z), (x1, y1 - t, z)])
    rims = box_quads(starts, ends + np.array([0.0, 0.0, PARAPET_M]))
    glass = shell.look.material == Material.CURTAIN_WALL
    shell.faces(rims, Material.CONCRETE_PANEL if glass else shell.look.material, shell.look.tint)


def _plant(shell: Shell, part: Part, z: float, rng: np.random.Generator) -> None:
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
    shell.faces(boxes, Material.METAL_GALVANISED, (215, 215, 212))


def _gable(shell: Shell, part: Part, z: float, *, turned: bool) -> None:
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
    material, tint = shell.look.roof
    for faces, stuff, colour in (
        (tiles, material, tint),
        (lowered[:, ::-1], Material.WOOD, shell.look.trim),
        (np.array(edges), Material.WOOD, shell.look.trim),
        (np.array(ends), shell.look.material, shell.look.tint),
        (chimney[: 5 if shell.look.style.ground != "hall" else 0], Material.BRICK_RED, (235, 225, 215)),
    ):
        shell.faces(_quarter(faces) if turned else faces, stuff, colour)
    if turned:
        _loft_window(shell, part, z, rise)


def _quarter(faces: Array) -> Array:
    """Points turned by a quarter about the vertical."""
    return np.stack([-faces[..., 1], faces[..., 0], faces[..., 2]], axis=-1)


def _loft_window(shell: Shell, part: Part, z: float, rise: float) -> None:
    """A window in the gable that looks to the street."""
    x, y, width, _ = part
    wall = Wall(origin_m=np.array([x, y, z]), along=np.array([1.0, 0.0, 0.0]), width_m=width)
    a, high = width / 2, min(0.5 * rise, 1.5)
    pane = wall.front(a - 0.5, a + 0.5, 0.45, 0.45 + high, 0.03)
    shell.pictures(pane, Material.WINDOW, np.array([shell.look.tint[1]]))
    frame = [wall.box(a - 0.6, a + 0.6, low, low + 0.1, 0.07) for low in (0.35, 0.45 + high)]
    shell.trim(np.concatenate(frame))


def _hip(shell: Shell, part: Part, z: float) -> None:
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
    shell.roof(np.array(slopes))
    corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
    foot = np.column_stack([corners, np.full(4, low - 0.16)])
    head = np.column_stack([corners, np.full(4, low)])
    eaves = np.stack([foot, np.roll(foot, -1, 0), np.roll(head, -1, 0), head], axis=1)
    shell.trim(np.concatenate([eaves, foot[None, ::-1]]), Material.SIDING)
    corner = np.array([x + width * 0.62, y + depth * 0.55])
    chimney = box_quads([*corner, z], [*(corner + 0.75), ridge + 0.7])
    shell.faces(chimney, Material.BRICK_BROWN)


def _sawtooth(shell: Shell, part: Part, z: float) -> None:
    """North lights: upright panes and slopes behind them, across the hall."""
    x, y, width, depth = part
    teeth = max(2, round(width / 6.5))
    step = width / teeth
    a = x + step * np.arange(teeth)
    high = z + 0.36 * step
    y0, y1, ones = y, y + depth, np.ones(teeth)

    def quad(points: list[tuple[NDArray[Any], float, float]]) -> Array:
        return np.stack([np.column_stack([p, q * ones, r * ones]) for p, q, r in points], axis=1)

    panes = quad([(a, y1, z + 0.4), (a, y0, z + 0.4), (a, y0, high - 0.15), (a, y1, high - 0.15)])
    shell.faces(panes, Material.CURTAIN_WALL, (225, 235, 240))
    for low, top in ((z, z + 0.4), (high - 0.15, high)):
        shell.roof(quad([(a, y1, low), (a, y0, low), (a, y0, top), (a, y1, top)]))
    shell.roof(quad([(a, y0, high), (a + step, y0, z), (a + step, y1, z), (a, y1, high)]))
    front = quad([(a, y0, z), (a + step, y0, z), (a, y0, high), (a, y0, high)])
    back = quad([(a + step, y1, z), (a, y1, z), (a, y1, high), (a, y1, high)])
    shell.wall(np.concatenate([front, back]))


def _mansard(shell: Shell, part: Part, z: float, rng: np.random.Generator) -> None:
    x, y, width, depth = part
    inset, rise = 1.3, 2.5
    foot = np.array([(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)])
    head = foot + inset * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    low = np.column_stack([foot, np.full(4, z)])
    high = np.column_stack([head, np.full(4, z + rise)])
    sides = np.stack([low, np.roll(low, -1, 0), np.roll(high, -1, 0), high], axis=1)
    shell.roof(sides)
    shell.faces(high[None], Material.ROOF_FLAT, (170, 170, 170))
    bays = max(1, round((width - 2.0) / shell.look.style.bay_m))
    a = x + 1.0 + (width - 2.0) / bays * (np.arange(bays) + 0.5)
    dormer = box_quads(
        np.column_stack([a - 0.75, np.full(bays, y + 0.25), np.full(bays, z)]),
        np.column_stack([a + 0.75, np.full(bays, y + 2.0), np.full(bays, z + 1.9)]),
    )
    shell.faces(dormer, Material.METAL_PAINTED, (95, 98, 102))
    wall = Wall(origin_m=np.array([0.0, y + 0.25, z]), along=np.array([1.0, 0.0, 0.0]), width_m=width)
    pane = wall.front(a - 0.5, a + 0.5, 0.3, 1.6, 0.02)
    shell.pictures(pane, Material.WINDOW, rng.integers(0, 16, bays))
