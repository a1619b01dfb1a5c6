"""Street furniture; every piece stands with its foot at the origin, z up, its front along +x."""

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.assets.primitives import (
    Look,
    box,
    ellipsoid,
    grid_triangles,
    lathe,
    panel,
    placed,
    rings,
    surface,
    tube,
)
from carlaloc_env.assets.texture_atlas import PosterCell, atlas_uv, cell_corners
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour, Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

_STATIC = Tag.STATIC
_STEEL = Look(Material.METAL_GALVANISED, _STATIC)
_DARK = Look(Material.METAL_PAINTED, _STATIC, (14, 16, 15))
_WOOD = Look(Material.WOOD, _STATIC)
_GLASS = Look(Material.GLASS, _STATIC)


def lamp(height_m: float = 9.0, arm_m: float = 2.0, *, colour: Colour = (150, 152, 150)) -> Mesh:
    """Street lamp; its arm reaches out along +x, the light is at (arm, 0, height)."""
    pole = Look(Material.METAL_GALVANISED, Tag.POLE, colour)
    heights = ((0, -height_m), (0, -1.1), (0.12, -0.5), (0.45, -0.12), (arm_m - 0.3, 0.05))
    cover, head = (Look(Material.METAL_PAINTED, Tag.POLE, tint) for tint in ((70, 72, 72), (60, 62, 64)))
    lens = Look(Material.LAMP_WHITE, Tag.POLE, (120, 110, 90))
    return merge(
        [
            tube(pole, [(x, 0, height_m + z) for x, z in heights], [0.105, 0.075, 0.06, 0.05, 0.04], 10),
            lathe(cover, [(0.2, 0.0), (0.2, 0.7), (0.13, 0.85)], 10),
            ellipsoid(head, (arm_m, 0, height_m + 0.06), (0.42, 0.16, 0.07), 5, 10),
            box(lens, (0.5, 0.2, 0.02), (arm_m, 0, height_m - 0.005)),
        ]
    )


def bench() -> Mesh:
    """Bench of 1.6 m with a back rest."""
    parts = [box(_WOOD, (0.10, 1.6, 0.04), (x, 0, 0.45)) for x in (-0.14, -0.02, 0.10, 0.22)]
    slat = box(_WOOD, (0.035, 1.6, 0.10))
    parts += [placed(slat, (-0.24 - 0.02 * k, 0, 0.60 + 0.14 * k), 0, 0.15) for k in range(3)]
    for y in (-0.65, 0.65):
        parts += [
            box(_DARK, (0.05, 0.05, 0.43), (0.18, y, 0.215)),
            box(_DARK, (0.05, 0.05, 0.43), (-0.16, y, 0.215)),
            box(_DARK, (0.46, 0.05, 0.04), (0.02, y, 0.41)),
            tube(_DARK, [(-0.20, y, 0.40), (-0.31, y, 0.95)], 0.022, 5),
            box(_DARK, (0.40, 0.05, 0.03), (0.0, y, 0.66)), box(_DARK, (0.03, 0.05, 0.22), (0.18, y, 0.55)),
        ]  # fmt: skip
    return merge(parts)


def bin_() -> Mesh:
    """Litter bin, 1 m high."""
    paint = Look(Material.METAL_PAINTED, _STATIC, (14, 40, 20))
    slat = box(paint, (0.02, 0.07, 0.72))
    slats = [
        placed(slat, (0.225 * elementary.cos(a), 0.225 * elementary.sin(a), 0.45), a)
        for a in 2 * np.pi * np.arange(14) / 14
    ]
    body = lathe(_DARK, [(0.20, 0.0), (0.20, 0.84), (0.17, 0.84)], 14)
    lid = lathe(paint, [(0.24, 0.86), (0.24, 0.90), (0.10, 1.0), (0.09, 0.99)], 14)
    return merge([body, *slats, lid])


def hydrant() -> Mesh:
    """Fire hydrant, 0.75 m high."""
    paint = Look(Material.METAL_PAINTED, _STATIC, (150, 12, 8))
    profile = [
        (0.16, 0), (0.16, 0.04), (0.10, 0.05), (0.10, 0.48), (0.14, 0.50), (0.14, 0.54), (0.12, 0.58),
        (0.08, 0.68), (0.03, 0.72), (0.025, 0.75),
    ]  # fmt: skip
    parts = [lathe(paint, profile, 12)]
    for yaw, radius, length in ((0.0, 0.075, 0.19), (0.5 * np.pi, 0.05, 0.17), (-0.5 * np.pi, 0.05, 0.17)):
        end = np.array([elementary.cos(yaw), elementary.sin(yaw), 0.0])
        parts.append(tube(paint, [end * 0.05 + (0, 0, 0.38), end * length + (0, 0, 0.38)], radius, 8))
    return merge(parts)


def bollard() -> Mesh:
    """Bollard with a white band, 0.95 m high."""
    h = 0.95
    dark = lathe(_DARK, [(0.075, 0), (0.06, 0.08), (0.06, h - 0.1), (0.07, h - 0.08), (0.05, h)], 10)
    band = lathe(Look(Material.SIGN, _STATIC, (230, 230, 230)), [(0.063, h - 0.3), (0.063, h - 0.2)], 10)
    return merge([dark, band])


def bus_shelter(poster: int = PosterCell.TRAVEL) -> Mesh:
    """Bus shelter 4.0 × 1.5 × 2.5 m, open towards +x, with a poster case at one end and a bench."""
    parts = [box(_DARK, (0.08, 0.08, 2.4), (x, y, 1.2)) for x in (-0.65, 0.6) for y in (-1.9, 1.9)]
    parts += [box(_DARK, (0.05, 0.05, 2.4), (-0.65, y, 1.2)) for y in (-0.65, 0.65)]
    parts += [
        box(Look(Material.METAL_PAINTED, _STATIC, (24, 26, 28)), (1.55, 4.1, 0.10), (0.0, 0, 2.45)),
        box(_DARK, (0.06, 3.9, 0.22), (0.74, 0, 2.28)),
        box(_DARK, (0.05, 3.8, 0.06), (-0.65, 0, 0.35)),
        box(_DARK, (0.05, 3.8, 0.06), (-0.65, 0, 1.25)),
        box(_GLASS, (0.012, 3.76, 0.84), (-0.65, 0, 0.80)),
        box(_GLASS, (0.012, 3.76, 1.05), (-0.65, 0, 1.82)),
        box(_GLASS, (1.15, 0.012, 1.9), (-0.02, 1.9, 1.25)),
        box(_WOOD, (0.36, 2.2, 0.05), (-0.38, 0.4, 0.48)),
        box(_DARK, (0.06, 0.06, 0.46), (-0.38, -0.5, 0.23)),
        box(_DARK, (0.06, 0.06, 0.46), (-0.38, 1.3, 0.23)),
    ]  # fmt: skip
    parts += _poster_case(1.2, 1.75, 0.14, poster, (0.0, -1.9, 0.45), -0.5 * np.pi)
    return merge(parts)


def banner(poster: int = PosterCell.FESTIVAL) -> Mesh:
    """Two banners to hang on a lamp post: arms along ±y, 4.2–6.0 m above the ground."""
    parts = []
    for side, cell in ((1.0, poster), (-1.0, poster + 5)):
        for z in (4.18, 6.02):
            parts.append(tube(_STEEL, [(0, 0, z), (0, side * 0.95, z)], 0.014, 5))
        cloth = Look(Material.PLASTIC, _STATIC, (180, 180, 180))
        for x, yaw in ((0.006, 0.0), (-0.006, np.pi)):
            sheet = _picture(0.75, 1.8, cell, (0, 0, 0), 0.004, cloth)
            parts += [placed(m, (x, side * 0.55, 5.1), yaw) for m in sheet]
    return merge(parts)


def advertising_column(first_poster: int = 0) -> Mesh:
    """Round column with posters, Ø 1.3 m, 3.4 m high."""
    base = lathe(Look(Material.CONCRETE, _STATIC), [(0.70, 0), (0.70, 0.35), (0.64, 0.40)], 16)
    green = Look(Material.METAL_PAINTED, _STATIC, (12, 34, 24))
    roof = lathe(green, [(0.64, 3.0), (0.78, 3.02), (0.78, 3.12), (0.5, 3.28), (0.1, 3.42)], 16)
    sides, parts = 16, [base, roof]
    for k in range(4):
        angle = 2 * np.pi * (k * sides // 4 + np.arange(sides // 4 + 1)) / sides
        for row, (low, high) in enumerate(((0.40, 1.70), (1.70, 3.0))):
            ring = np.stack([0.64 * elementary.cos(angle), 0.64 * elementary.sin(angle)], axis=-1)
            u0, v0, u1, v1 = atlas_uv(Material.POSTER, first_poster + 2 * k + 5 * row)
            u = u0 + (u1 - u0) * np.linspace(0, 1, len(angle))
            parts.append(_strip(Look(Material.POSTER, _STATIC), ring, low, high, u, (v0, v1)))
    return merge(parts)


def newspaper_box() -> Mesh:
    """Newspaper vending box, 1.15 m high."""
    paint = Look(Material.METAL_PAINTED, _STATIC, (150, 14, 10))
    parts = [
        box(paint, (0.42, 0.50, 0.65), (0, 0, 0.82)), box(_DARK, (0.30, 0.06, 0.5), (0, 0, 0.25)),
        box(_DARK, (0.40, 0.46, 0.04), (0, 0, 0.02)),
        box(_GLASS, (0.02, 0.40, 0.34), (0.21, 0, 0.92)), box(_STEEL, (0.05, 0.12, 0.10), (0.22, 0.12, 0.66)),
    ]  # fmt: skip
    parts += _picture(0.36, 0.18, PosterCell.RADIO, (0.225, 0, 1.20), 0.01, paint)
    return merge(parts)


def post_box() -> Mesh:
    """Letter box on legs, 1.25 m high, rounded above."""
    blue = Look(Material.METAL_PAINTED, _STATIC, (10, 30, 100))
    angle = np.linspace(0, np.pi, 9)
    arc = np.stack([0.225 * elementary.cos(angle), 1.02 + 0.22 * elementary.sin(angle)], -1)
    profile = np.concatenate([[(-0.225, 0.18), (0.225, 0.18)], arc])
    body = rings(blue, np.stack([np.insert(profile, 1, y, axis=1) for y in (0.25, -0.25)]), crease_deg=30.0)
    legs = [box(blue, (0.05, 0.05, 0.2), (x, y, 0.1)) for x in (-0.18, 0.18) for y in (-0.2, 0.2)]
    return merge([body, *legs, box(_STEEL, (0.02, 0.34, 0.05), (0.225, 0, 0.98))])


def cabinet() -> Mesh:
    """Switch cabinet 1.2 × 0.4 × 1.3 m, long side towards +x."""
    grey = Look(Material.METAL_PAINTED, _STATIC, (110, 116, 106))
    base = box(Look(Material.CONCRETE, _STATIC), (0.46, 1.26, 0.12), (0, 0, 0.06))
    body, lid = box(grey, (0.40, 1.20, 1.16), (0, 0, 0.70)), box(grey, (0.46, 1.28, 0.05), (0, 0, 1.29))
    seams = [box(_DARK, (0.01, 0.012, 1.0), (0.2, y, 0.72)) for y in (-0.3, 0.0, 0.3)]
    return merge([base, body, lid, *seams])


def planter() -> Mesh:
    """Concrete planter with a shrub's worth of soil, 1.2 m square."""
    stone = Look(Material.CONCRETE, _STATIC)
    walls = [box(stone, (1.2, 0.08, 0.5), (0, y, 0.25)) for y in (0.56, -0.56)]
    walls += [box(stone, (0.08, 1.04, 0.5), (x, 0, 0.25)) for x in (0.56, -0.56)]
    return merge([*walls, box(Look(Material.SOIL, _STATIC), (1.04, 1.04, 0.40), (0, 0, 0.20))])


def _picture(
    width_m: float,
    height_m: float,
    poster: int,
    centre_m: tuple[float, float, float],
    thickness_m: float,
    back: Look,
) -> list[Mesh]:
    """Board with a poster, facing +x, centred on a point."""
    x, y, z = centre_m
    w, h = 0.5 * width_m, 0.5 * height_m
    corners = [(x, y - w, z - h), (x, y + w, z - h), (x, y + w, z + h), (x, y - w, z + h)]
    uv = cell_corners(atlas_uv(Material.POSTER, poster))
    return panel(Look(Material.POSTER, _STATIC), corners, uv, thickness_m, back)


def _poster_case(
    width_m: float,
    height_m: float,
    depth_m: float,
    poster: int,
    foot_m: tuple[float, float, float],
    yaw_rad: float,
) -> list[Mesh]:
    """Lit case with a poster on both faces."""
    x, y, z = foot_m
    middle = (x, y, z + 0.5 * height_m)
    parts = [placed(box(_DARK, (depth_m, width_m + 0.16, height_m + 0.16)), middle, yaw_rad)]
    for turn, cell in ((0.0, poster), (np.pi, poster + 3)):
        face = _picture(width_m, height_m, cell, (0.5 * depth_m + 0.006, 0, 0), 0.004, _DARK)
        parts += [placed(m, middle, yaw_rad + turn) for m in face]
    return parts


def _strip(
    look: Look,
    ring: NDArray[np.float64],
    low_m: float,
    high_m: float,
    u: NDArray[np.float64],
    v: tuple[float, float],
) -> Mesh:
    """Upright band over a row of points in the ground plane, seen from the right of their order."""
    count = len(ring)
    points = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (low_m, high_m)])
    uv = np.concatenate([np.stack([u, np.full(count, value)], axis=-1) for value in v])
    return surface(look, points, grid_triangles(2, count), uv, 50.0)
