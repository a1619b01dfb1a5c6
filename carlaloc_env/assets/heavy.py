"""Lorry and bus."""

from __future__ import annotations

from carlaloc_env.assets.atlas import PosterCell, atlas_uv, cell_corners
from carlaloc_env.assets.body import DARK, BodyShape, Decals, loft_body
from carlaloc_env.assets.cars import AMBER_TINT, TAIL_TINT, plate
from carlaloc_env.assets.shapes import Look, box, ellipsoid, placed, quad
from carlaloc_env.assets.wheels import axle_wheels, wheel
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, merge
from carlaloc_env.semantics import Tag

_CAB = BodyShape(
    length_m=2.10, width_m=2.44,
    top=((0.0, 1.28), (0.05, 1.42), (0.40, 2.62), (0.75, 2.86), (1.2, 2.92), (2.10, 2.92)),
    belt=((0.0, 1.45), (2.1, 1.50)),
    cowl_d=0.05, roof_front_d=0.40, roof_rear_d=2.10, deck_d=2.10,
    windows=((0.36, 1.42),),
    axles_d=(1.35,), tyre_m=0.95, clearance_m=0.38, tumblehome=0.06, nose_bow_m=0.12, tail_bow_m=0.0,
    screen_bow_m=0.0, plan=((0.0, 0.93), (0.1, 0.97), (0.4, 1.0)), plan_rear=((0.0, 1.0), (1.0, 1.0)),
    nose_low=0.04, arch_m=0.06,
)  # fmt: skip
_COACH = BodyShape(
    length_m=12.0, width_m=2.55,
    top=((0.0, 0.86), (0.04, 1.00), (0.30, 2.72), (0.55, 2.98), (1.2, 3.08), (6.0, 3.10), (11.6, 3.06),
        (12.0, 2.94)),
    belt=((0.0, 1.02), (0.8, 1.12), (12.0, 1.15)),
    cowl_d=0.04, roof_front_d=0.30, roof_rear_d=12.0, deck_d=12.0,
    windows=((0.42, 1.56), (1.66, 2.9), (3.0, 4.4), (4.5, 5.9), (6.0, 7.4), (7.5, 8.9), (9.0, 10.4),
        (10.5, 11.7)),
    axles_d=(2.70, 8.60), tyre_m=0.96, clearance_m=0.32, tumblehome=0.03, nose_bow_m=0.22, tail_bow_m=0.06,
    screen_bow_m=0.0, plan=((0.0, 0.95), (0.1, 0.985), (0.4, 1.0)), plan_rear=((0.0, 0.97), (0.1, 1.0)),
    nose_low=0.03, arch_m=0.06,
)  # fmt: skip


def lorry() -> Mesh:
    """Rigid lorry of 8 m with a box body."""
    tag = Tag.TRUCK
    paint, dark = Look(Material.CAR_PAINT, tag), Look(Material.PLASTIC, tag, DARK)
    cab = loft_body(_CAB, tag)
    decals = Decals(cab, 0.012)
    decals.front(dark, [(-0.75, 0.78), (0.75, 0.78), (0.68, 1.22), (-0.68, 1.22)], (6, 2))
    decals.pair_front(
        Look(Material.LAMP_WHITE, tag), [(0.82, 0.56), (1.10, 0.56), (1.10, 0.72), (0.82, 0.72)], (3, 1)
    )
    decals.seam(dark, [(0.62, 0.62), (0.62, 1.42)])
    decals.seam(dark, [(-0.40, 1.05), (-0.40, 1.45)])
    decals.sides(dark, [(-0.10, 1.22), (-0.32, 1.22), (-0.32, 1.26), (-0.10, 1.26)], (1, 1))
    parts = [placed(merge([cab, *decals.meshes]), (2.95, 0.0, 0.0))]
    box_look = Look(Material.METAL_PAINTED, tag, (225, 225, 222))
    parts += [
        box(box_look, (5.72, 2.50, 2.36), (-1.14, 0.0, 2.22)),
        box(paint, (5.74, 2.496, 0.26), (-1.13, 0.0, 2.70)),
        box(dark, (6.2, 0.85, 0.28), (-0.9, 0.0, 0.86)),
        box(Look(Material.METAL_GALVANISED, tag), (0.9, 0.5, 0.5), (0.55, 0.85, 0.72)),
        box(dark, (1.1, 0.45, 0.45), (0.5, -0.85, 0.72)),
        box(dark, (0.08, 2.40, 0.12), (-3.94, 0.0, 0.55)),
    ]
    for side in (1, -1):
        parts.append(box(dark, (1.6, 0.04, 0.35), (-0.9, side * 1.2, 0.72)))
        parts.append(
            box(Look(Material.LAMP_RED, tag, TAIL_TINT), (0.05, 0.34, 0.12), (-3.96, side * 0.95, 0.68))
        )
        parts.append(
            box(Look(Material.PLASTIC, tag, AMBER_TINT), (0.05, 0.12, 0.12), (-3.96, side * 0.70, 0.68))
        )
        parts.append(
            box(Look(Material.PLASTIC, tag, AMBER_TINT), (0.10, 0.03, 0.10), (3.75, side * 1.20, 0.80))
        )
        parts.append(box(dark, (0.12, 0.10, 0.40), (3.36, side * 1.19, 1.95)))
        parts.append(_advert(-1.1, side, PosterCell.MARKET, tag, 1.254, (0.68, 1.25, 3.15)))
    rear_frame = Look(Material.METAL_GALVANISED, tag, (170, 170, 170))
    for y in (-1.19, -0.03, 0.03, 1.19):
        parts.append(box(rear_frame, (0.03, 0.05, 2.2), (-3.985, y, 2.2)))
    parts.append(plate(-3.99, 0.86, -1.0, tag))
    single, twin = (
        wheel(0.95, 0.28, tag, sides=16, spokes=6, rim=0.58),
        wheel(0.95, 0.50, tag, sides=16, spokes=6, rim=0.58),
    )
    parts += axle_wheels(2.65, 1.05, single) + axle_wheels(-1.85, 0.96, twin)
    return merge(parts)


def bus() -> Mesh:
    """City bus of 12 m with a destination board and advertisements."""
    tag = Tag.BUS
    dark, glass = Look(Material.PLASTIC, tag, DARK), Look(Material.GLASS, tag)
    shell = loft_body(_COACH, tag)
    decals = Decals(shell, 0.012)
    decals.pair_front(
        Look(Material.LAMP_WHITE, tag), [(0.86, 0.58), (1.14, 0.58), (1.14, 0.74), (0.86, 0.74)], (3, 1)
    )
    decals.front(dark, [(-1.16, 0.40), (1.16, 0.40), (1.16, 0.52), (-1.16, 0.52)], (8, 1))
    decals.front(dark, [(-0.85, 2.60), (0.85, 2.60), (0.85, 2.82), (-0.85, 2.82)], (8, 4))
    board = decals.raised(0.022)
    for low, high in (
        (-0.72, -0.50),
        (-0.38, -0.20),
        (-0.16, 0.02),
        (0.06, 0.30),
        (0.34, 0.44),
        (0.48, 0.70),
    ):
        board.front(
            Look(Material.LAMP_AMBER, tag, (90, 90, 90)),
            [(low, 2.66), (high, 2.66), (high, 2.76), (low, 2.76)],
            (2, 2),
        )
    decals.meshes.extend(board.meshes)
    decals.rear(glass, [(1.0, 1.75), (-1.0, 1.75), (-1.0, 2.62), (1.0, 2.62)], (6, 2))
    decals.rear(dark, [(1.0, 0.62), (-1.0, 0.62), (-1.0, 1.30), (1.0, 1.30)], (6, 2))
    decals.pair_rear(
        Look(Material.LAMP_RED, tag, TAIL_TINT),
        [(1.20, 0.70), (1.05, 0.70), (1.05, 1.30), (1.20, 1.30)],
        (1, 3),
    )
    amber = Look(Material.PLASTIC, tag, AMBER_TINT)
    decals.pair_rear(amber, [(1.20, 1.36), (1.05, 1.36), (1.05, 1.56), (1.20, 1.56)], (1, 2))
    decals.pair_front(amber, [(0.86, 0.78), (1.14, 0.78), (1.14, 0.84), (0.86, 0.84)], (3, 1))
    for x in (-9.0, -3.6, -0.9):
        decals.seam(dark, [(x + 6.0, 0.44), (x + 6.0, 1.10)])
    # Boarding is on the right: two double doors of glass, seen as dark panels below the windows.
    doors = Decals(shell, 0.015)
    for x0, x1 in ((5.42, 4.42), (1.10, -0.15)):
        doors.sides(glass, [(x0, 0.42), (x1, 0.42), (x1, 1.16), (x0, 1.16)], (2, 2))
    decals.meshes += doors.meshes[1::2]
    parts = [shell, *decals.meshes]
    for side, cells in (
        (1.0, (PosterCell.TRAVEL, PosterCell.CINEMA)),
        (-1.0, (PosterCell.RADIO, PosterCell.BANK)),
    ):
        for x, cell in zip((1.3, -4.1), cells, strict=True):
            parts.append(_advert(x if side > 0 else x - 0.2, side, cell, tag, 1.283, (0.38, 0.50, 1.06)))
    parts.append(box(Look(Material.PLASTIC, tag, (60, 60, 62)), (9.4, 1.7, 0.02), (-0.6, 0.0, 3.075)))
    for side in (1, -1):
        parts.append(ellipsoid(dark, (5.72, side * 1.19, 2.25), (0.06, 0.06, 0.20), 5, 8))
    parts.append(box(Look(Material.PLASTIC, tag, (5, 5, 5)), (11.0, 1.7, 0.5), (0.0, 0.0, 0.62)))
    parts.append(plate(-6.02, 0.50, -1.0, tag))
    tyre = wheel(0.96, 0.30, tag, sides=16, spokes=6, rim=0.58)
    return merge(parts + axle_wheels(3.30, 1.10, tyre) + axle_wheels(-2.60, 1.10, tyre))


def _advert(
    x_m: float, side: float, cell: PosterCell, tag: Tag, y_m: float, extent_m: tuple[float, float, float]
) -> Mesh:
    """Poster on a flank; extent = half its length, height of its lower and of its upper edge."""
    y, (half, low, high) = side * y_m, extent_m
    x0, x1 = (x_m + half, x_m - half) if side > 0 else (x_m - half, x_m + half)
    corners = [(x0, y, low), (x1, y, low), (x1, y, high), (x0, y, high)]
    return quad(Look(Material.POSTER, tag), corners, cell_corners(atlas_uv(Material.POSTER, cell)))
