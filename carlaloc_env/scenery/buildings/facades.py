"""Facades: one wall of a building split into storeys, bays, windows, doors and shop fronts."""

import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scenery.buildings.facade_ornaments import (
    Openings,
    crossed,
    wall_ornaments,
    window_ornaments,
)
from carlaloc_env.scenery.buildings.shell import GARAGE_DOOR, Shell
from carlaloc_env.scenery.buildings.street_storey import street_storey
from carlaloc_env.scenery.buildings.walls import Wall


def facade(
    shell: Shell,
    wall: Wall,
    levels_m: Array,
    rng: np.random.Generator,
    *,
    front: bool,
) -> None:
    """Add one wall.

    Args:
        shell: Takes the faces.
        wall: The wall.
        levels_m: Heights of the storeys' lower edges above the wall's foot [m], and of the top, (S + 1,).
        rng: Randomness of this wall.
        front: Whether it is the street side, with doors, shop fronts and full relief.
    """
    style = shell.look.style
    bays = max(1, round((wall.width_m - 0.8) / style.bay_m))
    pitch = (wall.width_m - 0.8) / bays
    centre: Array = 0.4 + pitch * (np.arange(bays, dtype=np.float64) + 0.5)
    width = min(style.window_m[0], pitch - 0.3)
    first = 1 if front and style.ground != "hall" else 0
    if front and style.ground in ("shop", "lobby"):
        street_storey(shell, wall, centre, pitch, float(levels_m[0]), float(levels_m[1]), rng)
    elif front and style.ground == "dwelling":
        _entrance_storey(shell, wall, centre, width, float(levels_m[0]), float(levels_m[1]), rng)
    if first < len(levels_m) - 1:
        _window_storeys(shell, wall, centre, width, levels_m[first:], rng, front=front)
    _mouldings(shell, wall, levels_m, pitch, front=front)
    wall_ornaments(shell, wall, levels_m, centre, width, front)


def _window_storeys(
    shell: Shell,
    wall: Wall,
    centre: Array,
    width: float,
    levels: Array,
    rng: np.random.Generator,
    *,
    front: bool,
) -> None:
    style = shell.look.style
    floor = levels[:-1]
    sill = floor + style.sill_m
    head = np.minimum(sill + style.window_m[1], levels[1:] - 0.15)
    a0, a1 = centre - width / 2, centre + width / 2
    shell.wall(wall.front(0.0, wall.width_m, np.append(levels[0], head), np.append(sill, levels[-1])))
    piers = (np.append(0.0, a1), np.append(a0, wall.width_m))
    shell.wall(wall.front(*crossed(*piers, sill, head)))
    shell.wall(wall.front(0.0, wall.width_m, levels[0], levels[-1], -style.recess_m - 0.05))
    _windows(shell, wall, Openings(*crossed(a0, a1, sill, head)), rng, front=front)


def _windows(
    shell: Shell,
    wall: Wall,
    w: Openings,
    rng: np.random.Generator,
    *,
    front: bool,
) -> None:
    style = shell.look.style
    pick = rng.integers(0, 1 << 16, len(w.a0))
    glass = Material.WINDOW_WIDE if style.wide else Material.WINDOW
    shell.pictures(wall.front(*w, -style.recess_m), glass, pick)
    if front:
        window_ornaments(shell, wall, w, pick)
    near = w.z0 < style.detail_m
    a0, a1, z0, z1 = (limit[near] for limit in w)
    shell.wall(wall.reveal(a0, a1, z0, z1, style.recess_m))
    if not front:
        return
    shell.trim(wall.box(a0 - 0.06, a1 + 0.06, z0 - 0.08, z0, 0.09))
    masonry = (Material.BRICK_RED, Material.BRICK_BROWN, Material.RUBBLE)
    if style.courses or shell.look.material in masonry:
        shell.trim(wall.box(a0 - 0.1, a1 + 0.1, z1, z1 + 0.2, 0.05))
    if style.balconies > 0.0:
        column = np.floor(a0 / style.bay_m).astype(np.int64)
        chosen = rng.random(64)[column % 64] < style.balconies
        _balconies(shell, wall, a0[chosen], a1[chosen], z0[chosen] - style.sill_m)


def _balconies(shell: Shell, wall: Wall, a0: Array, a1: Array, floor: Array) -> None:
    if not len(a0):
        return
    left, right, depth = a0 - 0.35, a1 + 0.35, 1.0
    if "loggias" in shell.look.style.ornaments:
        _loggias(shell, wall, left, right, floor)
        return
    shell.trim(wall.box(left, right, floor - 0.12, floor + 0.02, depth))
    rail = [wall.box(left, right, floor + 0.95, floor + 1.02, depth, depth - 0.05)]
    for share in np.linspace(0.0, 1.0, 6):
        a = left + share * (right - left - 0.04)
        rail.append(wall.box(a, a + 0.04, floor, floor + 0.95, depth, depth - 0.04))
    for a in (left, right - 0.04):
        rail.append(wall.box(a, a + 0.04, floor + 0.95, floor + 1.02, depth - 0.05))
    shell.accent(np.concatenate(rail), Material.METAL_PAINTED)


def _loggias(shell: Shell, wall: Wall, left: Array, right: Array, floor: Array) -> None:
    """Balconies with solid parapets and side walls."""
    depth = 1.25
    slab = wall.box(left, right, floor - 0.14, floor + 0.02, depth)
    cheeks = [wall.box(a, a + 0.12, floor, floor + 2.3, depth) for a in (left, right - 0.12)]
    shell.trim(np.concatenate([slab, *cheeks]))
    front = wall.box(left, right, floor, floor + 0.98, depth, depth - 0.08)
    shell.accent(front, Material.SIDING)
    rail = wall.box(left, right, floor + 1.05, floor + 1.1, depth, depth - 0.06)
    shell.faces(rail, Material.METAL_GALVANISED)


def _entrance_storey(
    shell: Shell,
    wall: Wall,
    centre: Array,
    width: float,
    z0: float,
    z1: float,
    rng: np.random.Generator,
) -> None:
    """Ground floor of a dwelling: windows, one door with a step and a small roof."""
    style = shell.look.style
    door = len(centre) // 2
    others = np.arange(len(centre)) != door
    low, high = z0 + style.sill_m, min(z0 + style.sill_m + style.window_m[1], z1 - 0.2)
    half, top = 0.5, min(z0 + 2.15, z1 - 0.2)
    a0, a1 = centre - width / 2, centre + width / 2
    d0, d1 = float(centre[door]) - half, float(centre[door]) + half
    a0[door], a1[door] = d0, d1
    ceiling = max(high, top)
    piers0, piers1 = np.append(0.0, a1), np.append(a0, wall.width_m)
    shell.wall(wall.front(piers0, piers1, z0, ceiling))
    shell.wall(wall.front(0.0, wall.width_m, ceiling, z1))
    shell.wall(wall.front(a0[others], a1[others], z0, low))
    if ceiling > high + 1e-6:
        shell.wall(wall.front(a0[others], a1[others], high, ceiling))
    if ceiling > top + 1e-6:
        shell.wall(wall.front(d0, d1, top, ceiling))
    shell.wall(wall.front(0.0, wall.width_m, z0, z1, -style.recess_m - 0.05))
    w = Openings(a0[others], a1[others], np.full(others.sum(), low), np.full(others.sum(), high))
    _windows(shell, wall, w, rng, front=True)
    shell.wall(wall.reveal(d0, d1, z0, top, style.recess_m))
    panel = wall.front(d0, d1, z0, top, -style.recess_m)
    shell.pictures(panel, Material.DOOR, rng.integers(0, GARAGE_DOOR, 1))
    step = wall.box(d0 - 0.25, d1 + 0.25, z0 - 0.3, z0 + 0.12, 0.9)
    canopy = wall.box(d0 - 0.3, d1 + 0.3, top + 0.1, top + 0.22, 0.8)
    for block in (step, canopy):
        shell.trim(block)


def _mouldings(shell: Shell, wall: Wall, levels: Array, pitch: float, *, front: bool) -> None:
    style = shell.look.style
    if style.courses:
        shell.trim(wall.box(0.0, wall.width_m, levels[1:-1] - 0.14, levels[1:-1] + 0.06, 0.07))
    elif len(levels) > 2 and style.ground in ("shop", "lobby"):
        shell.trim(wall.box(0.0, wall.width_m, levels[1] - 0.12, levels[1] + 0.12, 0.1))
    if style.pilaster_m > 0.0 and front and len(levels) > 2:
        bays = round((wall.width_m - 0.8) / pitch)
        a = 0.4 + pitch * np.arange(bays + 1)
        half = min(style.pilaster_m, pitch - style.window_m[0]) / 2
        shell.wall(wall.box(a - half, a + half, levels[1], levels[-1] - 0.01, 0.16))
    reach, height = style.cornice_m
    if reach > 0.0:
        top = float(levels[-1])
        shell.trim(wall.box(-reach, wall.width_m + reach, top - height, top - height / 2, reach / 2))
        shell.trim(wall.box(-reach, wall.width_m + reach, top - height / 2, top, reach))
