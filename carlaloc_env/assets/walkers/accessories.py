"""Skirts, bags and walking sticks of walkers."""

import numpy as np

from carlaloc_env.assets.primitives import Look, circle, rings, tube
from carlaloc_env.assets.walkers.clothing import SkinBuilder, by, up
from carlaloc_env.assets.walkers.skeleton import BONES
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh


def add_skirt(builder: SkinBuilder) -> None:
    """Skirt or the skirts of a coat: the hem swings with both thighs."""
    b, s, j = builder.build, builder.size, builder.rest
    hips = j["pelvis"]
    knee = 0.5 * (j["knee_l"] + j["knee_r"])
    sides = 8 if builder.low else 14
    ring = np.insert(circle(sides, 0.5), 2, 0.0, axis=1)
    look = builder.look(b.upper if b.coat else b.lower)
    top, bottom = hips + up(0.02), hips + (0.80 if b.coat else 0.84) * (knee - hips)
    grid = [
        top + t * (bottom - top) + ring * ((0.130 + 0.050 * t) * s, (0.182 * b.hips + 0.030 * t) * s, 0.0)
        for t in np.linspace(0.0, 1.0, 2 if builder.low else 4)[::-1]
    ]
    mesh = rings(look, np.stack(grid), crease_deg=80.0)
    at = mesh.vertices_m.astype(np.float64)
    t = np.clip((top[2] - at[:, 2]) / (top[2] - bottom[2]), 0.0, 1.0)
    thigh = np.where(at[:, 1] > 0, BONES.index("thigh_l"), BONES.index("thigh_r"))
    bones = np.stack([thigh, np.full(len(at), BONES.index("pelvis"))], axis=1)
    # Below the hips as fast as the thighs themselves, else these show through it in a long step.
    weight = elementary.power(t, 0.25) * np.clip(np.abs(at[:, 1]) / (0.05 * s), 0.5, 1.0)
    builder.parts.append((mesh, bones, weight))


def add_bags_and_stick(builder: SkinBuilder) -> None:
    """Backpack, handbag, shopping bag and walking stick, where the figure has them."""
    b, s, j = builder.build, builder.size, builder.rest
    if b.backpack is not None:
        _backpack(builder, builder.look(b.backpack))
    if b.handbag is not None:
        look = builder.look(b.handbag, Material.PLASTIC)
        at = j["pelvis"] + by(0.02, 0.235 * s, -0.02)
        builder.hung(_block(look, at, (0.28 * s, 0.10 * s, 0.20 * s)), "pelvis")
        if not builder.low:
            side, shoulder = j["chest"] + by(0.02, 0.19 * s, 0.05), j["shoulder_l"] + by(0, -0.04, 0.055 * s)
            builder.hung(_strap(look, [at + up(0.09 * s), side, shoulder]), "chest")
    if b.carrier is not None:
        hand = j["hand_r"] + up(0.03)
        look = builder.look(b.carrier, Material.PLASTIC)
        bag = _block(look, hand - up(0.24 * s), (0.30 * s, 0.12 * s, 0.32 * s))
        # It hangs down rather than out, as the hand swings.
        _held(builder, bag, np.full(len(bag.vertices_m), 0.6))
    if b.stick:
        hand = j["hand_r"] + up(0.05)
        wood = builder.look((50, 26, 12), Material.PLASTIC)
        foot = np.array([hand[0] + 0.05, hand[1], 0.04])
        stick = _strap(wood, [foot, hand, hand + by(-0.06, 0, 0.02)], 0.011)
        # Held by its grip, it swings less than the arm.
        _held(builder, stick, np.where(stick.vertices_m[:, 2] > 0.4, 0.9, 0.25))


def _held(builder: SkinBuilder, mesh: Mesh, weight: Array) -> None:
    """Add a thing in the right hand that follows the forearm by a weight (V,) and else the hips."""
    bones = np.array([[BONES.index("fore_r"), BONES.index("pelvis")]] * len(weight))
    builder.parts.append((mesh, bones, weight))


def _backpack(builder: SkinBuilder, look: Look) -> None:
    s, j = builder.size, builder.rest
    chest, neck = j["chest"], j["neck"]
    centre = 0.60 * chest + 0.40 * neck + by(-0.175 * s, 0, -0.02)
    builder.hung(_block(look, centre, (0.17 * s, 0.29 * s, 0.42 * s)), "chest")
    if builder.low:
        return
    builder.hung(_block(look, centre + by(-0.10 * s, 0, -0.06 * s), (0.07 * s, 0.22 * s, 0.20 * s)), "chest")
    for side in (1.0, -1.0):
        strap = [
            centre + by(0.06 * s, 0.10 * s * side, 0.16 * s), neck + by(-0.01, 0.11 * s * side, -0.02 * s),
            chest + by(0.125 * s, 0.105 * s * side, 0.06), chest + by(0.09 * s, 0.155 * s * side, -0.06),
        ]  # fmt: skip
        builder.hung(_strap(look, strap, 0.016), "chest")


def _block(look: Look, centre: Array, size_m: tuple[float, float, float]) -> Mesh:
    """Soft box: an eight-sided prism with smaller ends."""
    ring = np.insert(circle(8, 0.5), 2, 0.0, axis=1) / np.sqrt(elementary.cos(np.pi / 8))
    half = 0.5 * np.asarray(size_m)
    grid = [
        centre + ring * half * (f, f, 0) + up(t * half[2])
        for t, f in ((-1, 0.85), (-0.8, 1), (0.8, 0.95), (1, 0.75))
    ]
    return rings(look, np.array(grid), crease_deg=50.0)


def _strap(look: Look, points: list[Array], radius_m: float = 0.012) -> Mesh:
    return tube(look, np.array(points), radius_m, 4)
