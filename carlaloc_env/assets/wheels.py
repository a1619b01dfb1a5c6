"""Wheels: a tyre, a rim with spokes, placed on the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.shapes import Look, mirrored, placed, rings, surface
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, merge
from carlaloc_env.semantics import Tag

TYRE = (190, 190, 190)
RIM = (150, 152, 155)
HUB_DARK = (10, 10, 11)


def wheel(
    diameter_m: float, width_m: float, tag: Tag, *, sides: int = 16, spokes: int = 5, rim: float = 0.66
) -> Mesh:
    """Wheel whose axis lies along y, outer face at +y, resting on z = 0 at the origin.

    Args:
        diameter_m: Outer diameter of the tyre [m].
        width_m: Width of the tyre [m].
        tag: Semantic tag of the vehicle.
        sides: Corners of the tyre; a multiple of four keeps a corner on the ground.
        spokes: Spokes of the rim.
        rim: Diameter of the rim as a share of the tyre's.
    """
    r, h = 0.5 * diameter_m, 0.5 * width_m
    profile = [(0.80 * r, -h), (r, -0.75 * h), (r, 0.72 * h), (0.93 * r, h), (rim * r, 0.97 * h)]
    tyre = rings(Look(Material.RUBBER, tag, TYRE), _circles(profile, sides), caps=False, crease_deg=42.0)
    dark = Look(Material.METAL_PAINTED, tag, HUB_DARK)
    dish = _plate(dark, rim * r, 0.97 * h, sides)
    inside = mirrored(_plate(dark, 0.80 * r, h, sides))
    metal = Look(Material.METAL_PAINTED, tag, RIM)
    lip = _ring_plate(metal, 0.88 * rim * r, rim * r, 1.01 * h, sides)
    hub = _plate(metal, 0.17 * r, 1.05 * h, 8)
    blades = [_spoke(metal, 0.14 * r, 0.9 * rim * r, 0.075 * r, 1.03 * h, k / spokes) for k in range(spokes)]
    return placed(merge([tyre, dish, inside, lip, hub, *blades]), (0.0, 0.0, r))


def axle_wheels(x_m: float, track_half_m: float, mesh: Mesh) -> list[Mesh]:
    """The wheel on the left at (x, +track) and mirrored on the right."""
    left = placed(mesh, (x_m, track_half_m, 0.0))
    return [left, mirrored(left)]


def _circles(profile: list[tuple[float, float]], sides: int) -> NDArray[np.float64]:
    # Anticlockwise seen against +y, beginning at the lowest point.
    angle = 2 * np.pi * np.arange(sides) / sides
    r, y = np.array(profile).T
    return np.stack(
        [
            -r[:, None] * np.sin(angle),
            np.broadcast_to(y[:, None], (len(r), sides)),
            -r[:, None] * np.cos(angle),
        ],
        axis=-1,
    )


def _ring_plate(look: Look, inner_m: float, outer_m: float, y_m: float, sides: int) -> Mesh:
    grid = _circles([(outer_m, y_m), (max(inner_m, 1e-4), y_m)], sides)
    return rings(look, grid, caps=False)


def _plate(look: Look, radius_m: float, y_m: float, sides: int) -> Mesh:
    ring = _circles([(radius_m, y_m)], sides)[0]
    k = np.arange(sides)
    fan = np.stack([k, (k + 1) % sides, np.full(sides, sides)], axis=-1)
    return surface(look, np.concatenate([ring, [[0.0, y_m, 0.0]]]), fan)


def _spoke(look: Look, inner_m: float, outer_m: float, half_m: float, y_m: float, turn: float) -> Mesh:
    c, s = np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)
    flat = [(inner_m, -half_m), (outer_m, -0.8 * half_m), (outer_m, 0.8 * half_m), (inner_m, half_m)]
    corners = [(r * s + w * c, y_m, r * c - w * s) for r, w in flat]
    return surface(look, corners, [(0, 1, 2), (0, 2, 3)], crease_deg=5.0)
