"""Parts that stand out of facades: shutters, oriels, timber, quoins, fire stairs, porches and more."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import Look, lathe
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.shell import Shell
from carlaloc_env.scenery.buildings.walls import Wall


class Openings(NamedTuple):
    """Window openings of a wall, parallel arrays in wall coordinates [m], shape (N,)."""

    a0: Array
    a1: Array
    z0: Array
    z1: Array


def crossed(a0: Array, a1: Array, z0: Array, z1: Array) -> tuple[Array, Array, Array, Array]:
    """Limits of rectangles in all columns (C,) of all rows (R,), row by row, (R · C,) each."""
    columns, rows = len(a0), len(z0)
    return np.tile(a0, rows), np.tile(a1, rows), np.repeat(z0, columns), np.repeat(z1, columns)


def window_ornaments(shell: Shell, wall: Wall, w: Openings, pick: NDArray[np.int64]) -> None:
    """Ornaments of single windows: shutters, coolers, spandrel panels.

    Args:
        shell: Takes the faces.
        wall: The wall.
        w: Its windows.
        pick: A random whole number of each window, shape (N,).
    """
    names = shell.look.style.ornaments
    if "shutters" in names and shell.look.accent[0] % 4 != 0:
        half = np.minimum(0.5 * (w.a1 - w.a0), 0.55)
        for inner, outer in ((w.a0 - 0.03, w.a0 - half), (w.a1 + half, w.a1 + 0.03)):
            leaf = wall.box(outer, inner, w.z0, w.z1, 0.05)
            shell.accent(leaf, Material.SIDING)
    if "spandrels" in names:
        panel = wall.front(w.a0, w.a1, w.z0 - shell.look.style.sill_m + 0.12, w.z0 - 0.08, 0.015)
        shell.accent(panel, Material.METAL_PAINTED)
    if "coolers" in names:
        chosen = (pick % 7 == 0) & (w.z0 > 2.5)
        middle = 0.5 * (w.a0 + w.a1)[chosen]
        low = w.z0[chosen]
        body = wall.box(middle - 0.38, middle + 0.38, low - 0.55, low - 0.1, 0.42, 0.0)
        shell.faces(body, Material.METAL_PAINTED, (205, 205, 200))
        grille = wall.front(middle - 0.3, middle + 0.06, low - 0.5, low - 0.15, 0.425)
        shell.faces(grille, Material.METAL_GALVANISED, (70, 72, 74))


def wall_ornaments(
    shell: Shell,
    wall: Wall,
    levels: Array,
    centre: Array,
    width: float,
    front: bool,
) -> None:
    """Ornaments of a whole wall.

    Args:
        shell: Takes the faces.
        wall: The wall.
        levels: Heights of the storeys' lower edges and of the top [m], (S + 1,).
        centre: Middles of the bays [m].
        width: Width of the windows [m].
        front: Whether it is the street side.
    """
    names, top = shell.look.style.ornaments, float(levels[-1])
    if "plinth" in names:
        stone = Material.RUBBLE if shell.look.accent[1] % 2 else Material.CONCRETE
        shell.trim(wall.box(0.0, wall.width_m, 0.0, 0.55, 0.05), stone)
    if "quoins" in names:
        z = np.arange(0.1, top - 0.6, 0.7)
        for a0, a1 in ((0.0, 0.45), (wall.width_m - 0.45, wall.width_m)):
            shell.trim(wall.box(a0, a1, z, z + 0.42, 0.05))
    if "bands" in names and len(levels) > 1:
        for low in (top - 1.3, top - 0.75):
            if low > levels[0] + 2.0:
                shell.trim(wall.box(0.0, wall.width_m, low, low + 0.14, 0.06))
    if "timber" in names:
        _timber(shell, wall, levels, centre, width)
    if not front:
        return
    if "oriels" in names:
        _oriels(shell, wall, levels, centre[::2], width)
    if "fire_stairs" in names and len(levels) > 3 and shell.look.tint[0] % 2 == 0:
        _fire_stairs(shell, wall, levels, float(centre[len(centre) // 2]), width)
    if "columns" in names and wall.width_m > 12.0:
        _columns(shell, wall, float(levels[1]))
    if "porch" in names:
        _porch(shell, wall, float(centre[len(centre) // 2]), float(min(levels[1], 2.6)))
    if "docks" in names:
        _docks(shell, wall, top)


def _timber(shell: Shell, wall: Wall, levels: Array, centre: Array, width: float) -> None:
    """Beams along the floors, posts beside the windows, and braces in the outer bays."""
    first = 1 if len(levels) > 2 else 0
    faces = [wall.box(0.0, wall.width_m, levels[first:] - 0.14, levels[first:] + 0.10, 0.05)]
    a = np.unique(np.round(np.concatenate([[0.0], centre - width / 2 - 0.16, centre + width / 2 + 0.02,
                                           [wall.width_m - 0.16]]), 3))  # fmt: skip
    faces.append(wall.box(a, a + 0.14, float(levels[first]), float(levels[-1]), 0.04))
    shell.accent(np.concatenate(faces), Material.WOOD)
    low, high = levels[first:-1] + 0.10, levels[first + 1 :] - 0.14
    braces = []
    for a0, a1 in (
        (0.14, centre[0] - width / 2 - 0.16),
        (wall.width_m - 0.14, centre[-1] + width / 2 + 0.16),
    ):
        if abs(a1 - a0) < 0.3:
            continue
        shift = 0.16 * np.sign(a1 - a0)
        corners = [(a0, low), (a0 + shift, low), (a1, high), (a1 - shift, high)]
        quad = np.stack([wall.points(np.full(len(low), x), 0.03, z) for x, z in corners], axis=1)
        braces.append(quad if shift > 0 else quad[:, ::-1])
    if braces:
        shell.accent(np.concatenate(braces), Material.WOOD)


def _oriels(shell: Shell, wall: Wall, levels: Array, centre: Array, width: float) -> None:
    """Bay windows through all storeys, with a small roof."""
    half, reach, top = width / 2 + 0.45, 0.8, float(levels[-1]) - 0.25
    a0, a1 = centre - half, centre + half
    shell.wall(wall.box(a0, a1, 0.0, top, reach))
    base, head = levels[:-1] + 0.75, np.minimum(levels[1:] - 0.45, levels[:-1] + 2.4)
    left, right, base, high = crossed(a0, a1, base, head)
    middle = 0.5 * (left + right)
    panes = [
        wall.front(left + 0.14, middle - 0.06, base, high, reach + 0.02),
        wall.front(middle + 0.06, right - 0.14, base, high, reach + 0.02),
        wall.left_side(left - 0.02, 0.12, reach - 0.1, base, high),
        wall.right_side(right + 0.02, 0.12, reach - 0.1, base, high),
    ]
    glass = np.concatenate(panes)
    shell.pictures(glass, Material.WINDOW, (np.arange(len(glass)) * 7 + shell.look.tint[1]) % 16)
    shell.trim(wall.box(left - 0.05, right + 0.05, base - 0.12, base, reach + 0.08))
    shell.trim(wall.box(left - 0.05, right + 0.05, high, high + 0.16, reach + 0.06))
    shell.roof(wall.box(a0 - 0.1, a1 + 0.1, top, top + 0.12, reach + 0.1))


def _fire_stairs(shell: Shell, wall: Wall, levels: Array, centre: float, width: float) -> None:
    """Landings with rails at every upper storey, and ladders from one to the next."""
    steel = (30, 32, 34)
    left, right, reach = centre - width / 2 - 0.5, centre + width / 2 + 1.7, 1.05
    floor = levels[1:-1] + 0.3
    faces = [wall.box(left, right, floor - 0.06, floor, reach, 0.05)]
    for z in (0.5, 0.95):
        faces.append(wall.box(left, right, floor + z, floor + z + 0.04, reach, reach - 0.04))
    for a in np.linspace(left, right - 0.05, 5):
        faces.append(wall.box(a, a + 0.05, floor, floor + 0.95, reach, reach - 0.05))
    shell.faces(np.concatenate(faces), Material.METAL_PAINTED, steel)
    ladders = []
    for low, high in pairwise(floor):
        for b in (0.35, 0.85):
            corners = [(right - 1.5, low), (right - 1.36, low), (right - 0.16, high), (right - 0.3, high)]
            quad = np.stack([wall.points(a, b, z) for a, z in corners])
            ladders += [quad, quad[::-1]]
    shell.faces(np.array(ladders).reshape(-1, 4, 3), Material.METAL_PAINTED, steel)


def _columns(shell: Shell, wall: Wall, high: float) -> None:
    """A portico before the middle third: round columns, architrave and pediment."""
    span = max(9.0, wall.width_m / 3)
    a0, a1, reach = (wall.width_m - span) / 2, (wall.width_m + span) / 2, 1.7
    stone = Look(Material.ASHLAR, Tag.BUILDING, shell.look.tint)
    foot, head = [(0.52, 0.0), (0.52, 0.2), (0.42, 0.35)], [(0.36, -0.7), (0.5, -0.45), (0.5, -0.4)]
    profile = foot + [(radius, high + drop) for radius, drop in head]
    for a in np.linspace(a0 + 0.6, a1 - 0.6, 5 if span < 12.0 else 6):
        x, y, z = wall.points(float(a), reach - 0.55, 0.0)
        shell.out.add(lathe(stone, profile, 12, (float(x), float(y), float(z))))
    shell.trim(wall.box(a0, a1, high - 0.4, high + 0.5, reach))
    middle, peak = (a0 + a1) / 2, high + 0.5 + span * 0.16
    corners = [(a0 - 0.2, high + 0.5), (a1 + 0.2, high + 0.5), (middle, peak), (middle, peak)]
    front = np.stack([wall.points(a, reach, z) for a, z in corners])
    shell.wall(front[None])
    for (p, z0), (q, z1) in ((corners[1], corners[2]), (corners[2], corners[0])):
        slope = [wall.points(p, reach + 0.15, z0), wall.points(p, 0.0, z0), wall.points(q, 0.0, z1),
                 wall.points(q, reach + 0.15, z1)]  # fmt: skip
        shell.faces(np.array([slope]), Material.ROOF_SLATE)
    shell.trim(wall.box(a0 - 0.4, a1 + 0.4, -0.4, 0.16, reach + 0.2))


def _porch(shell: Shell, wall: Wall, centre: float, high: float) -> None:
    """A roofed porch on posts before the door."""
    a0, a1, reach = max(centre - 1.7, 0.1), min(centre + 1.7, wall.width_m - 0.1), 1.8
    shell.trim(wall.box(a0, a1, -0.4, 0.14, reach))
    for a in (a0 + 0.05, a1 - 0.17):
        post = wall.box(a, a + 0.12, 0.14, high, reach - 0.05, reach - 0.17)
        shell.faces(post, Material.SIDING, (250, 250, 245))
    rail = [
        wall.box(a0 + 0.1, centre - 0.6, 0.85, 0.93, reach - 0.08, reach - 0.14),
        wall.box(centre + 0.6, a1 - 0.1, 0.85, 0.93, reach - 0.08, reach - 0.14),
    ]
    shell.faces(np.concatenate(rail), Material.SIDING, (250, 250, 245))
    corners = [(a0 - 0.2, reach + 0.2, high), (a1 + 0.2, reach + 0.2, high), (a1 + 0.2, 0.0, high + 0.6),
               (a0 - 0.2, 0.0, high + 0.6)]  # fmt: skip
    roof = np.stack([wall.points(a, b, z) for a, b, z in corners])
    shell.roof(roof[None])
    shell.faces(roof[None, ::-1] - np.array([0, 0, 0.1]), Material.WOOD)
    edge = wall.front(a0 - 0.2, a1 + 0.2, high - 0.1, high, reach + 0.2)
    shell.faces(edge, Material.SIDING, (250, 250, 245))


def _docks(shell: Shell, wall: Wall, top: float) -> None:
    """The firm's name over the gates, bumpers, and pipes down the wall."""
    middle = wall.width_m / 2
    length = min(9.0, 0.45 * wall.width_m)
    z = top - 1.75
    board = wall.box(middle - length / 2 - 0.1, middle + length / 2 + 0.1, z - 0.1, z + length / 8 + 0.1, 0.1)
    shell.faces(board, Material.METAL_PAINTED, shell.look.sign)
    face = wall.front(middle - length / 2, middle + length / 2, z, z + length / 8, 0.12)
    shell.pictures(face, Material.SHOP_SIGN, np.array([shell.look.tint[0] + 3 * shell.look.sign[1]]))
    pipes = np.arange(1.0, wall.width_m, 9.0)
    down = wall.box(pipes, pipes + 0.12, 0.0, top, 0.14, 0.02)
    shell.faces(down, Material.METAL_GALVANISED, (190, 190, 190))
