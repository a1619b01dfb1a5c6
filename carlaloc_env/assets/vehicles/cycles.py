"""Motorcycle and bicycle, each with its rider."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.assets.primitives import Look, box, circle, ellipsoid, mirrored, rings, tube
from carlaloc_env.assets.vehicles.body import DARK
from carlaloc_env.assets.vehicles.car_ends import AMBER_TINT
from carlaloc_env.assets.vehicles.vehicle_parts import (
    LampMount,
    PlateMount,
    VehicleParts,
    assemble,
)
from carlaloc_env.assets.vehicles.wheels import WheelMount, plain_wheel, wheel
from carlaloc_env.assets.walkers.clothing import Build, by
from carlaloc_env.assets.walkers.figure import figure
from carlaloc_env.assets.walkers.pedalling import cranks, push_pedals
from carlaloc_env.assets.walkers.skeleton import Joints
from carlaloc_env.core import elementary
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh, merge
from carlaloc_env.scene.semantic_tags import Tag

PEDAL_PHASES = 24
"""Postures in which a turn of the cranks is stored."""
CRANK_TRAVEL_M = 5.0
"""Distance of a town bicycle per turn of its cranks [m]: 44 teeth on 19, wheels of 2.14 m."""


def motorcycle() -> VehicleParts:
    """Motorcycle with a rider in a helmet, 2.15 m long."""
    tag = Tag.MOTORCYCLE
    paint, dark = Look(Material.CAR_PAINT, tag), Look(Material.PLASTIC, tag, DARK)
    metal = Look(Material.METAL_GALVANISED, tag, (200, 200, 200))
    front_x, rear_x = 0.75, -0.70
    tyre = _two_sided(wheel(0.63, 0.15, tag, spokes=5, rim=0.72, back=False))
    parts = [
        ellipsoid(paint, (0.16, 0, 0.86), (0.30, 0.15, 0.13), 6, 10),
        ellipsoid(dark, (-0.36, 0, 0.80), (0.34, 0.14, 0.07), 5, 10),
        ellipsoid(paint, (-0.72, 0, 0.83), (0.24, 0.10, 0.07), 5, 8),
        box(Look(Material.METAL_GALVANISED, tag, (90, 90, 92)), (0.42, 0.30, 0.34), (0.05, 0, 0.50)),
        tube(dark, [(0.40, 0, 0.86), (0.10, 0, 0.42), (-0.45, 0, 0.40)], 0.035, 6),
        ellipsoid(paint, (0.76, 0, 0.60), (0.30, 0.085, 0.08), 5, 8),
        ellipsoid(dark, (0.56, 0, 0.92), (0.10, 0.13, 0.14), 5, 8),
        ellipsoid(Look(Material.LAMP_WHITE, tag), (0.62, 0, 0.92), (0.06, 0.09, 0.09), 4, 8),
        box(Look(Material.LAMP_TAIL, tag), (0.03, 0.14, 0.06), (-0.96, 0, 0.82)),
        box(dark, (0.01, 0.22, 0.12), (-1.062, 0, 0.64)),
        tube(dark, [(-0.85, 0, 0.80), (-1.07, 0, 0.62)], 0.025, 5),
        tube(dark, _bar((0.42, 0.36, 1.02), (0.50, 0.18, 1.00)), 0.018, 5),
    ]  # fmt: skip
    for side in (1.0, -1.0):
        amber = Look(Material.PLASTIC, tag, AMBER_TINT)
        parts += [
            ellipsoid(amber, (-0.93, 0.16 * side, 0.78), (0.03, 0.03, 0.025), 4, 6),
            ellipsoid(amber, (0.56, 0.19 * side, 0.90), (0.03, 0.03, 0.025), 4, 6),
            tube(metal, [(0.48, 0.10 * side, 0.98), (0.75, 0.10 * side, 0.315)], 0.024, 6),
            tube(metal, [(-0.20, 0.11 * side, 0.36), (-0.70, 0.11 * side, 0.315)], 0.022, 5),
            tube(metal, [(0.10, 0.16 * side, 0.34), (-0.30, 0.18 * side, 0.30), (-0.95, 0.18 * side, 0.42)],
                 [0.03, 0.04, 0.05], 7),
            tube(dark, [(0.40, 0.30 * side, 1.02), (0.38, 0.36 * side, 1.14)], 0.008, 4),
            ellipsoid(dark, (0.38, 0.345 * side, 1.16), (0.02, 0.055, 0.035), 4, 6),
        ]  # fmt: skip
    rider = _rider(
        pelvis=(-0.34, 0, 0.90), neck=(-0.06, 0, 1.34), head=(0.0, 0, 1.494), hands=(0.43, 0.33, 1.02),
        knees=(0.16, 0.20, 0.80), ankles=(-0.18, 0.20, 0.40), spread=0.16,
    )  # fmt: skip
    build = Build(
        stature_m=1.70, upper=(20, 20, 24), lower=(14, 16, 24), helmet=(150, 16, 14), skin=(40, 26, 20)
    )
    forks = [tube(metal, [(0.48, y, 0.98), (0.75, y, 0.315)], 0.024, 3, caps=False) for y in (0.10, -0.10)]
    forks.append(tube(dark, [(-0.85, 0, 0.80), (-1.07, 0, 0.62)], 0.03, 3, caps=False))
    discs = _wheels(_two_sided(plain_wheel(0.63, 0.10, tag)), front_x, rear_x, 0.315)
    few = [*parts[:4], *parts[6:10], *forks, figure(rider, build, Tag.RIDER, low=True)]
    return assemble(
        body=merge([*parts, figure(rider, build, Tag.RIDER)]),
        low=merge([*few, *(w.mounted() for w in discs)]),
        wheels=_wheels(tyre, front_x, rear_x, 0.315),
        plates=(PlateMount(position_m=(-1.07, 0.0, 0.64), facing=-1.0, width_m=0.21),),
        lamps=(LampMount(position_m=(0.68, 0.0, 0.92)),),
    )


def bicycle() -> VehicleParts:
    """Town bicycle with a rider, 1.75 m long."""
    tag = Tag.BICYCLE
    paint, dark = Look(Material.CAR_PAINT, tag), Look(Material.PLASTIC, tag, DARK)
    metal = Look(Material.METAL_GALVANISED, tag, (210, 210, 210))
    rear, front, crank = (-0.535, 0, 0.34), (0.535, 0, 0.34), (-0.10, 0, 0.30)
    head, seat = (0.36, 0, 0.80), (-0.24, 0, 0.82)
    tyre, parts = _bicycle_wheel(tag), list[Mesh]()
    bars = ((crank, head), (crank, seat), (seat, head), (crank, rear), (seat, rear), (head, front))
    parts += [tube(paint, [a, b], 0.019, 6) for a, b in bars]
    few = [tube(paint, [a, b], 0.019, 3, caps=False) for a, b in bars]
    parts += [
        tube(metal, [head, (0.31, 0, 1.0)], 0.014, 5),
        tube(metal, _bar((0.20, 0.294, 1.01), (0.31, 0.10, 1.01)), 0.013, 5),
        tube(metal, [seat, (-0.26, 0, 0.94)], 0.014, 5),
        ellipsoid(dark, (-0.29, 0, 0.96), (0.14, 0.075, 0.03), 4, 8),
        box(Look(Material.METAL_PAINTED, tag, (30, 30, 30)), (0.40, 0.14, 0.02), (-0.56, 0, 0.73)),
        box(Look(Material.LAMP_TAIL, tag), (0.03, 0.05, 0.04), (-0.77, 0, 0.73)),
        box(Look(Material.LAMP_WHITE, tag), (0.05, 0.06, 0.06), (0.40, 0, 0.88)),
        tube(metal, [(-0.10, -0.05, 0.30), (-0.10, -0.04, 0.30)], 0.09, 12),
    ]  # fmt: skip
    rider = _rider(
        pelvis=(-0.28, 0, 1.02), neck=(-0.06, 0, 1.47), head=(-0.01, 0, 1.594), hands=(0.20, 0.255, 1.03),
        knees=(0.08, 0.12, 0.80), ankles=(-0.14, 0.13, 0.24), spread=0.08,
    )  # fmt: skip
    build = Build(stature_m=1.72, girth=0.95, lower=(30, 34, 40), helmet=(200, 200, 196))
    thin = [w.mounted() for w in _wheels(_tyre(tag, 12, 3), front[0], rear[0], 0.34)]
    postures = []
    for phase in range(PEDAL_PHASES):
        turn = phase / PEDAL_PHASES
        push_pedals(rider, crank, build.stature_m, turn)
        near = merge([*parts, *cranks(metal, dark, crank, turn), figure(rider, build, Tag.RIDER)])
        postures.append((near, merge([*few, figure(rider, build, Tag.RIDER, low=True), *thin])))
    return VehicleParts(
        body=postures[0][0],
        low=postures[0][1],
        wheels=_wheels(tyre, front[0], rear[0], 0.34),
        plates=(),
        lamps=(LampMount(position_m=(0.43, 0.0, 0.88)),),
        pedalled=tuple(postures[1:]),
        crank_travel_m=CRANK_TRAVEL_M,
    )


def _rider(
    *,
    pelvis: ArrayLike,
    neck: ArrayLike,
    head: ArrayLike,
    hands: tuple[float, float, float],
    knees: tuple[float, float, float],
    ankles: tuple[float, float, float],
    spread: float,
) -> Joints:
    """Joints of a sitting rider; hands, knees and ankles of the left side are mirrored."""
    low, high = np.asarray(pelvis, dtype=np.float64), np.asarray(neck, dtype=np.float64)
    joints: Joints = {"pelvis": low, "neck": high, "chest": 0.42 * low + 0.58 * high + (-0.03, 0, 0)}
    joints["head"] = np.asarray(head, dtype=np.float64)
    for side, sign in (("_l", 1.0), ("_r", -1.0)):
        flip = np.array([1.0, sign, 1.0])
        joints["hip" + side] = low + by(0.02, 0.09 * sign, -0.03)
        joints["knee" + side] = np.array(knees) * flip
        joints["ankle" + side] = np.array(ankles) * flip
        joints["toe" + side] = joints["ankle" + side] + (0.18, 0.01 * sign, -0.07)
        joints["shoulder" + side] = high + by(0.0, 0.20 * sign, -0.05)
        joints["hand" + side] = np.array(hands) * flip
        middle = 0.5 * (joints["shoulder" + side] + joints["hand" + side])
        joints["elbow" + side] = middle + by(-0.04, (spread - 0.06) * sign, -0.07)
    return joints


def _bar(grip: tuple[float, float, float], stem: tuple[float, float, float]) -> NDArray[np.float64]:
    """Handlebar from grip to grip over the stem, given by the left halves, shape (4, 3)."""
    left = np.array([stem, grip])
    return np.concatenate([left[::-1] * (1.0, -1.0, 1.0), left])


def _two_sided(mesh: Mesh) -> Mesh:
    """A wheel seen alike from both sides."""
    return merge([mesh, mirrored(mesh)])


def _wheels(mesh: Mesh, front_x_m: float, rear_x_m: float, radius_m: float) -> tuple[WheelMount, ...]:
    return tuple(
        WheelMount(mesh=mesh, centre_m=(x, 0.0, radius_m), radius_m=radius_m, steered=x > 0, right=False)
        for x in (front_x_m, rear_x_m)
    )


def _bicycle_wheel(tag: Tag) -> Mesh:
    """Thin tyre of 0.68 m and ten spokes about its axle."""
    spoke = Look(Material.METAL_GALVANISED, tag, (210, 210, 210))
    up, ahead = circle(10, 0.5).T
    rim = 0.31 * np.stack([ahead, np.zeros(10), up], axis=-1)
    spokes = [tube(spoke, [(0, 0, 0), end], 0.003, 3, caps=False) for end in rim]
    hub = tube(spoke, [(0, -0.06, 0), (0, 0.06, 0)], 0.02, 6)
    return merge([_tyre(tag, 20, 5), hub, *spokes])


def _tyre(tag: Tag, sides: int, around: int) -> Mesh:
    angle = 2 * np.pi * np.arange(sides + 1) / sides
    small = 2 * np.pi * np.arange(around) / around + np.pi
    r = (0.34 - 0.018) - 0.018 * elementary.cos(small)[None, :]
    x, z = r * elementary.sin(angle)[:, None], -r * elementary.cos(angle)[:, None]
    grid = np.stack([x, np.broadcast_to(0.018 * elementary.sin(small), x.shape), z], axis=-1)
    return rings(Look(Material.RUBBER, tag, (190, 190, 190)), grid[::-1], caps=False, crease_deg=80.0)
