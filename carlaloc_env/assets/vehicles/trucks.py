"""Rigid truck of 8 m with a box body, and the posters on flanks of heavy vehicles."""

from carlaloc_env.assets.decals import Decals
from carlaloc_env.assets.primitives import Look, box, placed, quad
from carlaloc_env.assets.texture_atlas import PosterCell, atlas_uv, cell_corners
from carlaloc_env.assets.vehicles.body import BodyShape, loft_body, plastic
from carlaloc_env.assets.vehicles.car_ends import AMBER_TINT, REVERSE_TINT, band, rectangle
from carlaloc_env.assets.vehicles.vehicle_parts import (
    LampMount,
    PlateMount,
    VehicleParts,
    assemble,
)
from carlaloc_env.assets.vehicles.wheels import (
    arch_liner,
    axle,
    car_wheels,
    plain_wheel,
    wheel,
)
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

_CAB = BodyShape(
    length_m=2.10, width_m=2.44,
    top=((0.0, 1.28), (0.05, 1.42), (0.40, 2.62), (0.75, 2.86), (1.2, 2.92), (2.10, 2.92)),
    belt=((0.0, 1.45), (2.1, 1.50)),
    cowl_d=0.05, roof_front_d=0.40, roof_rear_d=2.10, deck_d=2.10,
    windows=((0.36, 1.42),),
    axles_d=(1.35,), tyre_m=0.95, clearance_m=0.38, tumblehome=0.06, nose_bow_m=0.12, tail_bow_m=0.0,
    screen_bow_m=0.0, plan=((0.0, 0.93), (0.1, 0.97), (0.4, 1.0)), plan_rear=((0.0, 1.0), (1.0, 1.0)),
    nose_low=0.04, arch_m=0.06, nose_round_m=0.03, tail_round_m=0.0,
)  # fmt: skip
_CAB_X_M = 2.95
"""Middle of the truck's cab [m]."""


def advert(
    x_m: float, side: float, cell: PosterCell, tag: Tag, y_m: float, extent_m: tuple[float, float, float]
) -> Mesh:
    """Poster on a flank; extent = half its length, height of its lower and of its upper edge."""
    y, (half, low, high) = side * y_m, extent_m
    x0, x1 = (x_m + half, x_m - half) if side > 0 else (x_m - half, x_m + half)
    corners = [(x0, y, low), (x1, y, low), (x1, y, high), (x0, y, high)]
    return quad(Look(Material.POSTER, tag), corners, cell_corners(atlas_uv(Material.POSTER, cell)))


def truck() -> VehicleParts:
    """Rigid truck of 8 m with a box body."""
    tag = Tag.TRUCK
    cab = loft_body(_CAB, tag)
    decals = Decals(cab)
    _cab_face(decals, tag)
    liner = arch_liner(1.05 - 1.35, 0.535, 0.475, (0.8, 1.2), tag)
    parts = [placed(merge([cab, *decals.meshes, *liner]), (_CAB_X_M, 0.0, 0.0))]
    parts += [*_box_body(tag), *_chassis(tag)]
    single, twin = (wheel(0.95, width, tag, spokes=0, rim=0.60) for width in (0.28, 0.50))
    wheels = axle(single, 2.65, 1.05, 0.475, steered=True) + axle(twin, -1.85, 0.96, 0.475, steered=False)
    lamps = tuple(LampMount(position_m=(4.0, 0.96 * side, 0.64)) for side in (1.0, -1.0))
    plates = (
        PlateMount(position_m=(-3.998, 0.0, 0.80), facing=-1.0),
        PlateMount(position_m=(4.012, 0.0, 0.62), facing=1.0),
    )
    return assemble(body=merge(parts), low=_low_lorry(tag), wheels=wheels, plates=plates, lamps=lamps)


def _cab_face(decals: Decals, tag: Tag) -> None:
    dark, recess = plastic(tag), plastic(tag, (3, 3, 3))
    gap, lamp = plastic(tag, (4, 4, 4)), Look(Material.LAMP_WHITE, tag)
    decals.front(dark, band(1.25, 1.25, 0.36, 0.80))
    decals.front(dark, band(0.80, 0.72, 0.86, 1.30), 1)
    for z in (0.92, 1.01, 1.10, 1.19):
        decals.front(recess, band(0.74, 0.70, z, z + 0.055), 2)
    decals.pair_front(recess, [(0.74, 0.54), (1.17, 0.54), (1.17, 0.76), (0.74, 0.74)], 1)
    decals.pair_front(lamp, [(0.80, 0.57), (0.96, 0.57), (0.96, 0.72), (0.80, 0.71)], 2)
    decals.pair_front(lamp, rectangle(0.99, 0.57, 1.08, 0.72), 2)
    amber = plastic(tag, AMBER_TINT)
    decals.pair_front(amber, [(1.10, 0.57), (1.155, 0.57), (1.155, 0.73), (1.10, 0.72)], 2)
    decals.front(recess, band(0.28, 0.28, 0.54, 0.72), 1)
    decals.seam(gap, [(0.62, 0.85), (0.62, 1.46)], 0.02)
    decals.seam(gap, [(-0.42, 1.10), (-0.42, 1.50)], 0.02)
    decals.sides(dark, rectangle(-0.10, 1.22, -0.34, 1.27))
    for z in (0.48, 0.74):
        decals.sides(recess, rectangle(0.92, z, 0.66, z + 0.09))


def _box_body(tag: Tag) -> list[Mesh]:
    """Cargo box with rear doors, edges of metal and a poster on each side."""
    paint, white = Look(Material.CAR_PAINT, tag), Look(Material.METAL_PAINTED, tag, (225, 225, 222))
    rim = Look(Material.METAL_GALVANISED, tag, (170, 170, 170))
    parts = [
        box(white, (5.72, 2.48, 2.36), (-1.14, 0.0, 2.20)),
        box(paint, (5.73, 2.49, 0.26), (-1.14, 0.0, 2.72)),
    ]
    for y in (-1.235, 1.235):
        for z in (1.04, 3.36):
            parts.append(box(rim, (5.74, 0.03, 0.07), (-1.14, y, z)))
        for x in (-3.98, 1.70):
            parts.append(box(rim, (0.05, 0.03, 2.34), (x, y, 2.20)))
    for y in (-1.19, -0.03, 0.03, 1.19):
        parts.append(box(rim, (0.02, 0.05, 2.2), (-3.995, y, 2.2)))
    for y in (-0.75, -0.35, 0.35, 0.75):
        parts.append(box(rim, (0.03, 0.03, 2.26), (-4.0, y, 2.2)))
        parts.append(box(rim, (0.03, 0.26 if abs(y) < 0.5 else 0.03, 0.03), (-4.0, 0.8 * y, 1.5)))
    for side in (1.0, -1.0):
        parts.append(advert(-1.1, side, PosterCell.MARKET, tag, 1.246, (0.68, 1.25, 3.15)))
    return parts


def _chassis(tag: Tag) -> list[Mesh]:
    """Frame, tanks, guards, lamps of the tail, mirrors."""
    dark = plastic(tag)
    parts = [
        box(dark, (6.2, 0.85, 0.28), (-0.9, 0.0, 0.86)),
        box(Look(Material.METAL_GALVANISED, tag), (0.9, 0.5, 0.5), (0.75, 0.92, 0.72)),
        box(dark, (1.1, 0.45, 0.45), (0.65, -0.95, 0.72)),
        box(dark, (0.08, 2.40, 0.16), (-3.93, 0.0, 0.66)),
        box(dark, (0.06, 2.30, 0.10), (-3.90, 0.0, 0.42)),
        box(dark, (0.02, 0.60, 0.20), (-3.98, 0.0, 0.80)),
    ]
    for y in (-0.8, 0.8):
        parts.append(box(dark, (0.05, 0.06, 0.34), (-3.88, y, 0.56)))
        parts.append(box(Look(Material.RUBBER, tag), (0.02, 0.56, 0.5), (-2.52, 1.2 * y, 0.45)))
    amber, white = (plastic(tag, tint) for tint in (AMBER_TINT, REVERSE_TINT))
    for side in (1.0, -1.0):
        parts.append(box(dark, (1.4, 0.03, 0.12), (-0.45, side * 1.2, 0.80)))
        parts.append(box(dark, (1.4, 0.03, 0.12), (-0.45, side * 1.2, 0.56)))
        parts.append(box(Look(Material.LAMP_TAIL, tag), (0.03, 0.30, 0.13), (-3.965, side * 0.98, 0.66)))
        parts.append(box(amber, (0.03, 0.12, 0.13), (-3.965, side * 0.75, 0.66)))
        parts.append(box(white, (0.03, 0.10, 0.10), (-3.965, side * 0.60, 0.66)))
        for x in (-3.0, -1.0, 1.2):
            parts.append(box(amber, (0.08, 0.02, 0.05), (x, side * 1.235, 1.02)))
        parts.append(box(dark, (0.14, 0.16, 0.44), (3.62, side * 1.15, 2.05)))
        parts.append(box(dark, (0.04, 0.14, 0.03), (3.60, side * 1.13, 2.32)))
        glass = Look(Material.GLASS, tag, (255, 255, 255))
        parts.append(box(glass, (0.01, 0.12, 0.38), (3.548, side * 1.15, 2.05)))
    return parts


def _low_lorry(tag: Tag) -> Mesh:
    cab = loft_body(_CAB, tag, low=True)
    decals = Decals(cab, 0.012)
    dark = plastic(tag)
    decals.front(dark, band(1.1, 1.1, 0.36, 1.25))
    lamp = Look(Material.LAMP_WHITE, tag, (110, 112, 115))
    decals.pair_front(lamp, [(0.80, 0.57), (1.08, 0.57), (1.08, 0.72), (0.80, 0.71)], 2)
    parts = [placed(merge([cab, *decals.meshes]), (_CAB_X_M, 0.0, 0.0))]
    white = Look(Material.METAL_PAINTED, tag, (225, 225, 222))
    parts += [
        box(white, (5.72, 2.50, 2.36), (-1.14, 0.0, 2.20)),
        box(Look(Material.CAR_PAINT, tag), (5.74, 2.51, 0.26), (-1.14, 0.0, 2.72)),
        box(dark, (6.6, 0.9, 0.5), (-0.7, 0.0, 0.76)),
    ]
    for side in (1.0, -1.0):
        parts.append(advert(-1.1, side, PosterCell.MARKET, tag, 1.262, (0.68, 1.25, 3.15)))
        parts.append(box(Look(Material.LAMP_TAIL, tag), (0.05, 0.30, 0.13), (-3.965, side * 0.98, 0.66)))
    wheels = car_wheels(plain_wheel(0.95, 0.2, tag), (2.65, -1.85), 1.1, 0.475)
    return merge([*parts, *(w.mounted() for w in wheels)])
