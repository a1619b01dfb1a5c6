"""Cars, vans and pick-ups: lines of each model, and what is mounted on the shell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from carlaloc_env.assets.atlas import SignCell, atlas_uv, cell_corners
from carlaloc_env.assets.body import DARK, BodyShape, Decals, loft_body
from carlaloc_env.assets.shapes import Look, box, ellipsoid, mirrored, quad
from carlaloc_env.assets.wheels import axle_wheels, wheel
from carlaloc_env.materials import Material
from carlaloc_env.scene import Mesh, merge
from carlaloc_env.semantics import Tag

TAIL_TINT = (70, 70, 70)
"""Tint of tail lamps: dimmer than a brake lamp."""
AMBER_TINT = (180, 70, 4)
"""Tint of indicators that are off; they are made of plastic."""
STOP_TINT = (42, 3, 3)
"""Tint of the high stop lamp that is off; it is made of plastic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CarSpec:
    """A car: its shell and the places of lamps, plates and trim."""

    shape: BodyShape
    tag: Tag = Tag.CAR
    tyre_width_m: float = 0.21
    nose_z: tuple[float, float] = (0.30, 0.62)
    """Lower and upper edge of the grille band [m]."""
    lamp_z: tuple[float, float] = (0.56, 0.70)
    """Lower and upper edge of the headlamps [m]."""
    tail_z: tuple[float, float] = (0.70, 0.88)
    """Lower and upper edge of the tail lamps [m]."""
    tail_share: float = 0.52
    """Where the tail lamps begin, as a share of the half width."""
    plate_z: tuple[float, float] = (0.42, 0.80)
    """Height of front and rear licence plate [m]."""
    doors: tuple[float, ...] = ()
    """Door gaps, distances from the nose [m]."""
    rear_window: tuple[float, float] | None = None
    """Upright rear window, heights from and to [m]."""


def car(spec: CarSpec) -> Mesh:
    """Whole car centred on its box, resting on z = 0, nose at +x."""
    shape = spec.shape
    shell = loft_body(shape, spec.tag)
    decals = Decals(shell)
    _front(decals, spec)
    _rear(decals, spec)
    _flanks(decals, spec)
    tyre = wheel(shape.tyre_m, spec.tyre_width_m, spec.tag, sides=16)
    track = 0.5 * shape.width_m * 0.975 - 0.5 * spec.tyre_width_m - 0.015
    wheels = [m for d in shape.axles_d for m in axle_wheels(0.5 * shape.length_m - d, track, tyre)]
    return merge([shell, *decals.meshes, *wheels, *_mirrors(spec), _belly(spec)])


def _front(decals: Decals, spec: CarSpec) -> None:
    half, tag = 0.5 * spec.shape.width_m, spec.tag
    dark = Look(Material.PLASTIC, tag, DARK)
    low, high = spec.nose_z
    decals.front(dark, _band(0.62 * half, 0.56 * half, low, low + 0.4 * (high - low)), (8, 2))
    decals.front(dark, _band(0.42 * half, 0.46 * half, low + 0.62 * (high - low), high), (8, 1))
    z0, z1 = spec.lamp_z
    lamp = [(0.52 * half, z0 + 0.03), (0.93 * half, z0), (0.95 * half, z1), (0.50 * half, z1 - 0.03)]
    decals.pair_front(Look(Material.GLASS, tag, (255, 255, 255)), lamp, (7, 3))
    inner = [
        (0.60 * half, z0 + 0.045),
        (0.78 * half, z0 + 0.035),
        (0.79 * half, z1 - 0.035),
        (0.60 * half, z1 - 0.045),
    ]
    lifted = decals.raised(0.022)
    lifted.pair_front(Look(Material.LAMP_WHITE, tag), inner, (6, 3))
    amber = [
        (0.84 * half, z0 + 0.03),
        (0.91 * half, z0 + 0.03),
        (0.91 * half, z1 - 0.03),
        (0.84 * half, z1 - 0.03),
    ]
    lifted.pair_front(Look(Material.PLASTIC, tag, AMBER_TINT), amber, (2, 2))
    decals.meshes.extend(lifted.meshes)
    x = float(decals.meshes[0].vertices_m[:, 0].max()) + 0.012
    decals.meshes.append(plate(x, spec.plate_z[0], 1.0, tag))


def _rear(decals: Decals, spec: CarSpec) -> None:
    half, tag = 0.5 * spec.shape.width_m, spec.tag
    z0, z1 = spec.tail_z
    inner = spec.tail_share * half
    lamps = decals.raised(0.012)
    split = inner + 0.24 * (0.93 * half - inner)
    red = [(0.93 * half, z0), (split, z0 + 0.015), (split, z1 - 0.01), (0.93 * half, z1)]
    lamps.pair_rear(Look(Material.LAMP_RED, tag, TAIL_TINT), red, (5, 3))
    amber = [(split, z0 + 0.015), (inner, z0 + 0.02), (inner, z1 - 0.01), (split, z1 - 0.01)]
    lamps.pair_rear(Look(Material.PLASTIC, tag, AMBER_TINT), amber, (2, 3))
    high = float(np.interp(spec.shape.roof_rear_d, *np.array(spec.shape.top).T)) - 0.08
    lamps.rear(
        Look(Material.PLASTIC, tag, STOP_TINT),
        [(0.2, high - 0.04), (-0.2, high - 0.04), (-0.2, high), (0.2, high)],
        (4, 2),
    )
    decals.meshes.extend(lamps.meshes)
    dark = Look(Material.PLASTIC, tag, DARK)
    low = spec.shape.clearance_m + 0.11
    decals.rear(dark, _band(0.78 * half, 0.72 * half, low, low + 0.14) * np.array([-1, 1]), (8, 1))
    if spec.rear_window is not None:
        a, b = spec.rear_window
        decals.rear(
            Look(Material.GLASS, tag), _band(0.76 * half, 0.70 * half, a, b) * np.array([-1, 1]), (6, 3)
        )
    x = float(decals.body.bounds_m[0, 0]) - 0.012
    decals.meshes.append(plate(x, spec.plate_z[1], -1.0, tag))


def _flanks(decals: Decals, spec: CarSpec) -> None:
    shape, tag = spec.shape, spec.tag
    dark = Look(Material.PLASTIC, tag, DARK)
    nose = 0.5 * shape.length_m
    belt = float(np.interp(0.5 * shape.length_m, *np.array(shape.belt).T))
    sill = shape.clearance_m + 0.16
    for d in spec.doors:
        decals.seam(dark, [(nose - d, sill), (nose - d, belt - 0.02)], 0.014)
    if spec.doors:
        decals.seam(dark, [(nose - spec.doors[0], sill), (nose - spec.doors[-1], sill)], 0.014)
        for back in spec.doors[1:]:
            x = nose - back + 0.06
            decals.sides(
                dark,
                [(x + 0.19, belt - 0.15), (x, belt - 0.15), (x, belt - 0.115), (x + 0.19, belt - 0.115)],
                (1, 1),
            )


def _mirrors(spec: CarSpec) -> list[Mesh]:
    shape = spec.shape
    d = shape.windows[0][0] + 0.22
    belt = float(np.interp(d, *np.array(shape.belt).T))
    size = 0.085 if max(z for _, z in shape.top) < 2.2 else 0.14
    centre = (0.5 * shape.length_m - d, 0.5 * shape.width_m - 0.09, belt + 0.09 + 0.5 * (size - 0.085))
    shell = ellipsoid(Look(Material.CAR_PAINT, spec.tag), centre, (0.07, 0.09, size), 5, 8)
    arm = box(
        Look(Material.PLASTIC, spec.tag, DARK), (0.06, 0.16, 0.03), (centre[0], centre[1] - 0.09, belt + 0.02)
    )
    return [m for part in (shell, arm) for m in (part, mirrored(part))]


def _belly(spec: CarSpec) -> Mesh:
    """Dark block between the wheels, so that no light falls through the arches."""
    shape = spec.shape
    width = shape.width_m - 2 * spec.tyre_width_m - 0.2
    length = shape.axles_d[-1] - shape.axles_d[0] + shape.tyre_m + 0.2
    middle = 0.5 * shape.length_m - 0.5 * (shape.axles_d[-1] + shape.axles_d[0])
    low = shape.clearance_m + 0.02
    high = 0.5 * shape.tyre_m + 0.25
    return box(
        Look(Material.PLASTIC, spec.tag, (5, 5, 5)),
        (length, width, high - low),
        (middle, 0.0, 0.5 * (low + high)),
    )


def plate(
    x_m: float, z_m: float, facing: float, tag: Tag, size_m: tuple[float, float] = (0.52, 0.11)
) -> Mesh:
    """Licence plate in the middle of nose (facing +1) or tail (−1)."""
    y, h = 0.5 * size_m[0] * facing, 0.5 * size_m[1]
    corners = [(x_m, -y, z_m - h), (x_m, y, z_m - h), (x_m, y, z_m + h), (x_m, -y, z_m + h)]
    return quad(Look(Material.SIGN, tag), corners, cell_corners(atlas_uv(Material.SIGN, SignCell.PLATE)))


def _band(low_half: float, high_half: float, z0: float, z1: float) -> np.ndarray:
    return np.array([(-low_half, z0), (low_half, z0), (high_half, z1), (-high_half, z1)])
