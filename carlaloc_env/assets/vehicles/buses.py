"""City bus of 12 m with a destination board, doors on the right and advertisements."""

import numpy as np

from carlaloc_env.assets.decals import Decals
from carlaloc_env.assets.primitives import Look, box, ellipsoid, mirrored
from carlaloc_env.assets.texture_atlas import PosterCell
from carlaloc_env.assets.vehicles.body import BodyShape, loft_body, plastic
from carlaloc_env.assets.vehicles.car_ends import AMBER_TINT, REVERSE_TINT, band, rectangle
from carlaloc_env.assets.vehicles.trucks import advert
from carlaloc_env.assets.vehicles.vehicle_parts import (
    LampMount,
    PlateMount,
    VehicleParts,
    assemble,
)
from carlaloc_env.assets.vehicles.wheels import (
    arch_liner,
    car_wheels,
    plain_wheel,
    wheel,
)
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

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
    nose_low=0.03, arch_m=0.06, nose_round_m=0.03, tail_round_m=0.0,
)  # fmt: skip
_LINE = {"4": "bcfg", "2": "abdeg"}
"""Digits of the bus line, and the lit bars of their seven segments."""
_DOORS_X = ((5.55, 4.40), (1.25, -0.05), (-3.80, -5.00))
"""Front and rear edge of each door [m]."""


def bus() -> VehicleParts:
    """City bus of 12 m with a destination board, doors on the right and advertisements."""
    tag = Tag.BUS
    shell = loft_body(_COACH, tag)
    decals = Decals(shell)
    _bus_front(decals, tag)
    _bus_rear(decals, tag)
    _bus_flanks(decals, tag)
    dark = plastic(tag)
    parts = [shell, *decals.meshes]
    for x in (3.30, -2.60):
        parts += arch_liner(x, 0.54, 0.48, (0.75, 1.26), tag)
    roof = plastic(tag, (190, 190, 188))
    parts += [
        box(roof, (2.6, 1.5, 0.10), (2.2, 0.0, 3.06)),
        box(roof, (2.0, 1.5, 0.10), (-3.4, 0.0, 3.06)),
        box(plastic(tag, (5, 5, 5)), (11.0, 1.5, 0.5), (0.0, 0.0, 0.62)),
    ]
    for side in (1.0, -1.0):
        mirror = ellipsoid(dark, (5.86, 1.16, 2.25), (0.07, 0.07, 0.22), 5, 8)
        arm = box(dark, (0.10, 0.06, 0.06), (5.86, 1.10, 2.50))
        parts += [mirror, arm] if side > 0 else [mirrored(mirror), mirrored(arm)]
    tyre = wheel(0.96, 0.30, tag, spokes=0, rim=0.60)
    wheels = car_wheels(tyre, (3.30, -2.60), 1.10, 0.48)
    lamps = tuple(LampMount(position_m=(5.95, 0.98 * side, 0.66)) for side in (1.0, -1.0))
    plates = (
        PlateMount(position_m=(-6.03, 0.0, 0.52), facing=-1.0),
        PlateMount(position_m=(6.012, 0.0, 0.48), facing=1.0),
    )
    return assemble(body=merge(parts), low=_low_bus(tag), wheels=wheels, plates=plates, lamps=lamps)


def _bus_front(decals: Decals, tag: Tag) -> None:
    dark, glass = plastic(tag), Look(Material.GLASS, tag)
    lamp, amber = Look(Material.LAMP_WHITE, tag), plastic(tag, AMBER_TINT)
    decals.front(dark, band(1.2, 1.2, 0.30, 0.52))
    decals.front(glass, band(1.14, 1.12, 1.02, 2.56))
    decals.front(dark, band(0.012, 0.012, 1.02, 2.56), 1)
    decals.front(dark, band(1.0, 0.96, 2.56, 2.88))
    for k, bars in enumerate(_LINE.values()):
        _digit(decals, bars, 0.62 - 0.20 * k, 2.62, 0.20, tag)
    for k in range(6):
        y = 0.10 - 0.13 * k
        pale = Look(Material.LAMP_AMBER, tag, (90, 90, 90))
        decals.front(pale, rectangle(y - 0.04, 2.66, y + 0.04, 2.76), 2)
    decals.pair_front(plastic(tag, (20, 21, 23)), [(0.78, 0.56), (1.18, 0.56), (1.18, 0.82), (0.82, 0.80)], 1)
    for y in (0.84, 1.0):
        decals.pair_front(lamp, rectangle(y, 0.59, y + 0.13, 0.72), 2)
    decals.pair_front(amber, [(0.88, 0.745), (1.15, 0.745), (1.15, 0.79), (0.88, 0.785)], 2)


def _digit(decals: Decals, lit: str, y: float, z: float, high_m: float, tag: Tag) -> None:
    """Seven-segment digit of amber lights on the destination board; `y` is its left edge seen from ahead."""
    w, h, s = 0.55 * high_m, high_m, 0.12 * high_m
    # Seen from ahead, +y lies on the right; the board reads from −y to +y.
    bars = {
        "a": (0, h - s, w, h), "d": (0, 0, w, s), "g": (0, 0.5 * (h - s), w, 0.5 * (h + s)),
        "f": (0, 0.5 * h, s, h), "e": (0, 0, s, 0.5 * h), "b": (w - s, 0.5 * h, w, h),
        "c": (w - s, 0, w, 0.5 * h),
    }  # fmt: skip
    look = Look(Material.LAMP_AMBER, tag, (120, 120, 120))
    for name in lit:
        y0, z0, y1, z1 = bars[name]
        decals.front(look, rectangle(-y + y0, z + z0, -y + y1, z + z1), 2)


def _bus_rear(decals: Decals, tag: Tag) -> None:
    dark, glass = plastic(tag), Look(Material.GLASS, tag)
    decals.rear(glass, band(1.0, 0.96, 1.75, 2.62))
    decals.rear(dark, band(0.9, 0.9, 0.66, 1.40))
    for z in np.arange(0.74, 1.34, 0.10):
        decals.rear(plastic(tag, (3, 3, 3)), band(0.82, 0.82, float(z), float(z) + 0.045), 1)
    decals.rear(dark, band(1.2, 1.2, 0.30, 0.42))
    decals.pair_rear(Look(Material.LAMP_TAIL, tag), rectangle(1.20, 0.70, 1.02, 1.10), 1)
    decals.pair_rear(plastic(tag, AMBER_TINT), rectangle(1.20, 1.13, 1.02, 1.32), 1)
    decals.pair_rear(plastic(tag, REVERSE_TINT), rectangle(1.20, 0.56, 1.02, 0.67), 1)


def _bus_flanks(decals: Decals, tag: Tag) -> None:
    gap, dark = plastic(tag, (4, 4, 4)), plastic(tag)
    glass = Look(Material.GLASS, tag)
    decals.sides(dark, rectangle(2.72, 0.3, -2.03, 0.44))
    for x in (5.2, 1.9, 0.2, -1.6, -4.4):
        decals.seam(gap, [(x, 0.46), (x, 1.10)], 0.012)
    # Boarding is on the right: three double doors of glass in dark frames.
    for x0, x1 in _DOORS_X:
        decals.side(dark, rectangle(x0, 0.36, x1, 2.66), -1.0, 1)
        middle = 0.5 * (x0 + x1)
        for a, b in ((x0 - 0.06, middle + 0.02), (middle - 0.02, x1 + 0.06)):
            decals.side(glass, rectangle(a, 0.50, b, 2.58), -1.0, 2)
    for side, cells in (
        (1.0, ((PosterCell.TRAVEL, 1.3), (PosterCell.CINEMA, -4.1))),
        (-1.0, ((PosterCell.RADIO, 2.1), (PosterCell.BANK, -1.4))),
    ):
        for cell, x in cells:
            decals.meshes.append(advert(x, side, cell, tag, 1.283, (0.30, 0.50, 1.06)))


def _low_bus(tag: Tag) -> Mesh:
    shell = loft_body(_COACH, tag, low=True)
    decals = Decals(shell, 0.012)
    dark, glass = plastic(tag), Look(Material.GLASS, tag)
    decals.front(glass, band(1.14, 1.12, 1.02, 2.56))
    decals.front(dark, band(1.0, 0.96, 2.56, 2.88))
    decals.rear(glass, band(1.0, 0.96, 1.75, 2.62))
    decals.rear(dark, band(0.9, 0.9, 0.66, 1.40))
    decals.pair_rear(Look(Material.LAMP_TAIL, tag), rectangle(1.20, 0.70, 1.02, 1.10), 1)
    lamp = Look(Material.LAMP_WHITE, tag, (110, 112, 115))
    decals.pair_front(lamp, rectangle(0.84, 0.59, 1.13, 0.72), 2)
    for x0, x1 in _DOORS_X:
        decals.side(glass, rectangle(x0, 0.40, x1, 2.66), -1.0, 1)
    disc = plain_wheel(0.96, 0.02, tag)
    wheels = [w.mounted() for w in car_wheels(disc, (3.30, -2.60), 1.265, 0.48)]
    return merge([shell, *decals.meshes, *wheels])
