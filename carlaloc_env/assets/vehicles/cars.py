"""Cars, vans and pick-ups: a shell, and what is mounted on it.

The ego's own body: a dark grey electric saloon in the `base_link` frame.
"""

from dataclasses import replace

import numpy as np

from carlaloc_env.assets.catalog import EGO_TINT
from carlaloc_env.assets.decals import Decals
from carlaloc_env.assets.number_plates import PLATE_SIZE_M
from carlaloc_env.assets.primitives import Look, box, ellipsoid, mirrored, placed, surface, tube
from carlaloc_env.assets.vehicles.body import BodyShape, loft_body, plastic
from carlaloc_env.assets.vehicles.car_ends import add_front, add_rear, rectangle
from carlaloc_env.assets.vehicles.car_models import CarSpec
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
from carlaloc_env.core.ego import EGO_FRONT_M, EGO_REAR_M, EGO_SIZE_M, EGO_WHEELBASE_M
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge


def car(spec: CarSpec) -> VehicleParts:
    """Whole car centred on its box, resting on z = 0, nose at +x."""
    shape = spec.shape
    shell = loft_body(shape, spec.tag)
    decals = Decals(shell)
    add_front(decals, spec)
    add_rear(decals, spec)
    _flanks(decals, spec)
    nose, radius = 0.5 * shape.length_m, 0.5 * shape.tyre_m
    axles = tuple(nose - d for d in shape.axles_d)
    half = 0.5 * shape.width_m
    track = half * 0.975 - 0.5 * spec.tyre_width_m - 0.01
    parts = [shell, *decals.meshes]
    for x in axles:
        parts += arch_liner(x, radius + shape.arch_m, radius, (half - 0.34, 0.985 * half), spec.tag)
    tyre = wheel(shape.tyre_m, spec.tyre_width_m, spec.tag, spokes=spec.spokes)
    return assemble(
        body=merge([*parts, *_mirrors(spec), *_roof(spec, decals), _belly(spec)]),
        low=_low_car(spec),
        wheels=car_wheels(tyre, axles, track, radius),
        plates=_plates(decals, spec),
        lamps=_lamps(decals, spec),
    )


def _plates(decals: Decals, spec: CarSpec) -> tuple[PlateMount, ...]:
    front_z, rear_z = spec.plate_z
    places = []
    for z, facing in ((front_z, 1.0), (rear_z, -1.0)):
        high = 0.5 * PLATE_SIZE_M[1]
        at = [decals.surface_x(0.0, z + h, facing) for h in (-high, high)]
        x = max(facing * a for a in at) * facing + 0.022 * facing
        places.append(PlateMount(position_m=(x, 0.0, z), facing=facing))
    return tuple(places)


def _lamps(decals: Decals, spec: CarSpec) -> tuple[LampMount, ...]:
    middle = np.mean(np.array(spec.head), axis=0) * (0.5 * spec.shape.width_m, 1.0)
    y, z = float(middle[0]), float(middle[1])
    x = decals.surface_x(y, z, 1.0)
    return tuple(LampMount(position_m=(x, side * y, z)) for side in (1.0, -1.0))


def _flanks(decals: Decals, spec: CarSpec) -> None:
    shape, tag = spec.shape, spec.tag
    gap, dark = plastic(tag, (4, 4, 4)), plastic(tag)
    chrome = Look(Material.METAL_GALVANISED, tag, (235, 235, 235))
    handle = chrome if spec.chrome else Look(Material.CAR_PAINT, tag)
    nose, belt = 0.5 * shape.length_m, shape.belt_z
    sill = shape.clearance_m + 0.15
    for d in spec.doors:
        decals.seam(gap, [(nose - d, sill), (nose - d, belt(d) - 0.01)], 0.013)
    if spec.doors:
        first, last = spec.doors[0], spec.doors[-1]
        decals.seam(gap, [(nose - first, sill), (nose - last, sill)], 0.013)
        for back in spec.doors[1:]:
            x, z = nose - back + 0.05, belt(back) - 0.13
            decals.sides(gap, rectangle(x + 0.20, z - 0.005, x, z + 0.035))
            decals.sides(handle, rectangle(x + 0.19, z + 0.008, x + 0.01, z + 0.03), 1)
    if spec.chrome and shape.windows:
        a, b = shape.windows[0][0], shape.windows[-1][1]
        decals.seam(chrome, [(nose - a, belt(a) - 0.012), (nose - b, belt(b) - 0.012)], 0.02)
    if spec.slide:
        d0, d1 = spec.doors[-1], shape.length_m - 0.25
        decals.seam(dark, [(nose - d0, belt(d0) - 0.12), (nose - d1, belt(d1) - 0.12)], 0.035)
    if not shape.cladding:
        lower = shape.clearance_m + 0.09
        front_d, rear_d = (shape.axles_d[k] for k in (0, -1))
        reach = 0.5 * shape.tyre_m + shape.arch_m
        x0, x1 = nose - front_d - reach, nose - rear_d + reach
        decals.sides(dark, rectangle(x0, 0.0, x1, lower))


def _mirrors(spec: CarSpec) -> list[Mesh]:
    shape = spec.shape
    d = shape.windows[0][0] + 0.20
    belt = shape.belt_z(d)
    tall = max(z for _, z in shape.top) > 2.2
    high, wide = (0.20, 0.10) if tall else (0.075, 0.10)
    centre = (0.5 * shape.length_m - d, 0.5 * shape.width_m - wide, belt + 0.045 + high)
    look = plastic(spec.tag) if shape.cladding and tall else Look(Material.CAR_PAINT, spec.tag)
    shell = ellipsoid(look, centre, (0.085, wide, high), 5, 10)
    x, y, z = centre[0] - 0.088, centre[1], centre[2]
    w, h = 0.75 * wide, 0.7 * high
    pane = [(x, y + w, z - h), (x, y - w, z - h), (x, y - w, z + h), (x, y + w, z + h)]
    glass = surface(Look(Material.GLASS, spec.tag), pane, [(0, 1, 2), (0, 2, 3)])
    arm = box(plastic(spec.tag), (0.06, 0.16, 0.03), (centre[0], centre[1] - 0.09, belt + 0.03))
    return [m for part in (shell, glass, arm) for m in (part, mirrored(part))]


def _roof(spec: CarSpec, decals: Decals) -> list[Mesh]:
    """Rails along the roof and the fin of the aerial."""
    shape, parts = spec.shape, list[Mesh]()
    nose, highest = 0.5 * shape.length_m, float(decals.body.bounds_m[1, 2]) + 0.015
    if shape.bed is None and not spec.barn_doors:
        x = nose - shape.roof_rear_d + 0.16
        low = decals.surface_z(x - 0.09, 0.0) - 0.004
        high = min(low + 0.065, highest)
        fin = [(x + 0.1, 0.0, decals.surface_z(x + 0.1, 0.0)), (x - 0.09, 0.03, low), (x - 0.09, -0.03, low)]
        paint, sides = Look(Material.CAR_PAINT, spec.tag), [(0, 1, 3), (1, 2, 3), (2, 0, 3)]
        parts.append(surface(paint, [*fin, (x - 0.08, 0.0, high)], sides, crease_deg=10.0))
    if spec.rails:
        a, b = nose - shape.roof_front_d - 0.15, nose - shape.roof_rear_d + 0.12
        y, along = 0.5 * shape.width_m * 0.58, np.linspace(a, b, 6)
        z = np.minimum([decals.surface_z(float(x), y) + 0.03 for x in along], highest - 0.012)
        z[[0, -1]] -= 0.03
        metal = Look(Material.METAL_GALVANISED, spec.tag, (150, 150, 152))
        rail = tube(metal, np.stack([along, np.full(6, y), z], axis=-1), 0.014, 4)
        parts += [rail, mirrored(rail)]
    return parts


def _belly(spec: CarSpec) -> Mesh:
    """Dark block between the wheels, so that no light falls through the arches."""
    shape = spec.shape
    width = shape.width_m - 2 * spec.tyre_width_m - 0.2
    length = shape.axles_d[-1] - shape.axles_d[0] + shape.tyre_m + 0.2
    middle = 0.5 * shape.length_m - 0.5 * (shape.axles_d[-1] + shape.axles_d[0])
    low, high = shape.clearance_m + 0.02, 0.5 * shape.tyre_m + 0.25
    return box(plastic(spec.tag, (5, 5, 5)), (length, width, high - low), (middle, 0.0, 0.5 * (low + high)))


def _low_car(spec: CarSpec) -> Mesh:
    """The car seen from afar: few triangles, wheels as discs, lamps and plates."""
    shape, tag = spec.shape, spec.tag
    shell = loft_body(shape, tag, low=True)
    decals = Decals(shell, 0.012)
    add_front(decals, spec, low=True)
    add_rear(decals, spec, low=True)
    nose, half = 0.5 * shape.length_m, 0.5 * shape.width_m
    disc = plain_wheel(shape.tyre_m, 0.02, tag)
    axles = tuple(nose - d for d in shape.axles_d)
    wheels = [w.mounted() for w in car_wheels(disc, axles, 0.985 * half, 0.5 * shape.tyre_m)]
    return merge([shell, *decals.meshes, *wheels])


EGO_SPEC = CarSpec(
    shape=BodyShape(
        length_m=EGO_SIZE_M[0], width_m=EGO_SIZE_M[1],
        top=((0.0, 0.64), (0.08, 0.70), (0.45, 0.80), (0.95, 0.90), (1.28, 0.955), (2.20, 1.38), (2.65, 1.45),
             (3.10, 1.43), (3.42, 1.37), (4.28, 1.04), (4.62, 1.01), (4.70, 0.96)),
        belt=((0.0, 0.60), (0.5, 0.69), (1.0, 0.78), (1.3, 0.85), (2.0, 0.90), (4.0, 0.96), (4.7, 0.96)),
        cowl_d=1.28, roof_front_d=2.20, roof_rear_d=3.42, deck_d=4.28,
        windows=((1.44, 2.46), (2.54, 3.40), (3.45, 3.84)),
        axles_d=(EGO_FRONT_M - EGO_WHEELBASE_M, EGO_FRONT_M), tyre_m=0.67, clearance_m=0.14, nose_bow_m=0.30,
        tail_bow_m=0.14,
    ),
    tyre_width_m=0.235, spokes=10, bars=0,
    head=((0.56, 0.60), (0.80, 0.58), (0.965, 0.64), (0.965, 0.74), (0.58, 0.67)),
    grille=(0.30, 0.32, 0.56, 0.60), intake=(0.66, 0.62, 0.22, 0.38),
    tail=((0.50, 0.78), (0.96, 0.76), (0.97, 0.92), (0.52, 0.88)), plate_z=(0.46, 0.66),
    doors=(1.40, 2.50, 3.42),
)  # fmt: skip
"""The ego's car, a saloon."""


def ego_body() -> Mesh:
    """Body of the ego: origin on the ground below the rear axle, x ahead, −0.95 m … 3.75 m."""
    body = placed(car(EGO_SPEC).whole, (EGO_REAR_M + 0.5 * EGO_SIZE_M[0], 0.0, 0.0))
    painted = body.material == Material.CAR_PAINT
    # Its lenses would glow at the lower edge of its own cameras' pictures.
    lens = body.material == Material.LAMP_WHITE
    return replace(
        body,
        # Matt, so that the bonnet stays dark under a bright sky.
        material=np.where(
            painted, Material.METAL_PAINTED, np.where(lens, Material.PLASTIC, body.material)
        ).astype(np.uint8),
        colour=np.where(painted[:, None], np.array(EGO_TINT), body.colour).astype(np.uint8),
    )
