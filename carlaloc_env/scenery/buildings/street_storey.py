"""Ground floors of glass: shops with signs and awnings, and lobbies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scenery.buildings.shell import GARAGE_DOOR, Shell
from carlaloc_env.scenery.buildings.walls import Wall


def street_storey(
    shell: Shell,
    wall: Wall,
    centre: Array,
    pitch: float,
    z0: float,
    z1: float,
    rng: np.random.Generator,
) -> None:
    """Ground floor of glass between piers: shops with sign bands and awnings, or a lobby."""
    shop = shell.look.style.ground == "shop"
    group = max(1, round((4.2 if shop else 3.2) / pitch))
    edges = np.append(np.arange(0, len(centre), group), len(centre)) * pitch + 0.4
    pier = 0.28
    a0, a1 = edges[:-1] + pier, edges[1:] - pier
    riser, head = z0 + (0.4 if shop else 0.15), z1 - (0.95 if shop else 0.6)
    recess = 0.25
    door = int(rng.integers(0, len(a0)))
    low = np.full(len(a0), riser)
    low[door] = z0
    shell.wall(wall.front(0.0, wall.width_m, head, z1))
    ends0, ends1 = np.append(0.0, a1), np.append(a0, wall.width_m)
    shell.wall(wall.front(ends0, ends1, z0, head))
    others = np.arange(len(a0)) != door
    shell.trim(wall.front(a0[others], a1[others], z0, riser))
    shell.wall(wall.front(0.0, wall.width_m, z0, z1, -recess - 0.05))
    shell.trim(wall.reveal(a0, a1, low, head, recess))
    pane = wall.front(a0[others], a1[others], riser, head, -recess)
    pick = rng.integers(0, 1 << 16, int(others.sum()))
    if shop:
        for material, rows in (
            (Material.SHOP_FRONT, pick % 2 == 0),
            (Material.SHOP_FRONT_B, pick % 2 == 1),
        ):
            shell.pictures(pane[rows], material, pick[rows] // 2)
    else:
        shell.faces(pane, Material.CURTAIN_WALL)
    _door_bay(shell, wall, float(a0[door]), float(a1[door]), z0, head, recess, rng)
    if shop:
        _shop_signs(shell, wall, a0, a1, head, rng)


def _door_bay(
    shell: Shell,
    wall: Wall,
    a0: float,
    a1: float,
    z0: float,
    head: float,
    recess: float,
    rng: np.random.Generator,
) -> None:
    middle, half = (a0 + a1) / 2, min(0.55, (a1 - a0) / 2 - 0.05)
    top = min(z0 + 2.25, head)
    door = wall.front(middle - half, middle + half, z0, top, -recess)
    shell.pictures(door, Material.DOOR, rng.integers(0, GARAGE_DOOR, 1))
    sides = wall.front(
        np.array([a0, middle + half, middle - half]),
        np.array([middle - half, a1, middle + half]),
        np.array([z0, z0, top]),
        np.array([head, head, head]),
        -recess,
    )
    shell.pictures(sides, Material.WINDOW, rng.integers(0, 1 << 16, 3))
    shell.trim(wall.box(middle - half - 0.08, middle + half + 0.08, top, top + 0.1, -recess + 0.1, -recess))


def _shop_signs(
    shell: Shell,
    wall: Wall,
    a0: Array,
    a1: Array,
    head: float,
    rng: np.random.Generator,
) -> None:
    band = wall.box(a0, a1, head + 0.08, head + 0.78, 0.12)
    shell.faces(band, Material.METAL_PAINTED, shell.look.sign)
    plate = wall.front(a0 + 0.08, a1 - 0.08, head + 0.14, head + 0.72, 0.13)
    pick = rng.integers(0, 1 << 16, len(a0))
    shell.pictures(plate, Material.SHOP_SIGN, pick)
    _blades(shell, wall, a1[pick % 3 == 0] - 0.1, head, pick[pick % 3 == 0])
    awned = rng.random(len(a0)) < 0.45
    if awned.any():
        left, right = a0[awned], a1[awned]
        low, high, depth = head - 0.45, head + 0.05, 1.15
        slope = np.stack(
            [
                wall.points(left, depth, low),
                wall.points(right, depth, low),
                wall.points(right, 0.02, high),
                wall.points(left, 0.02, high),
            ],
            axis=1,
        )
        valance = wall.front(left, right, low - 0.2, low, depth)
        both = np.concatenate([slope, slope[:, ::-1], valance, valance[:, ::-1]])
        shell.faces(both, Material.CLOTH, tuple(max(1, c - 20) for c in shell.look.sign))


def _blades(shell: Shell, wall: Wall, a: Array, head: float, pick: NDArray[np.int64]) -> None:
    """Small signs that stand out of the wall, readable along the sidewalk from both sides."""
    if not len(a):
        return
    low, high = head + 0.95, head + 1.65
    arm = wall.box(a - 0.02, a + 0.02, high + 0.02, high + 0.06, 0.85)
    shell.faces(arm, Material.METAL_PAINTED, (30, 30, 32))
    left = wall.left_side(a - 0.03, 0.15, 0.85, low, high)
    right = wall.right_side(a + 0.03, 0.15, 0.85, low, high)
    for side in (left, right):
        shell.pictures(side, Material.POSTER, pick, aspect=1.4)
