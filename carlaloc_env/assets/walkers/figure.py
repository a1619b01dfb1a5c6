"""Walkers: a dressed figure with its head and accessories.

Heads: a face, ears, hair, hats and helmets.

Skirts, bags and walking sticks of walkers.
"""

import math
from functools import lru_cache

import numpy as np

from carlaloc_env.assets.primitives import Look, circle, ellipsoid, rings, tube
from carlaloc_env.assets.walkers.clothing import Build, Hang, SkinBuilder, by, up
from carlaloc_env.assets.walkers.gait import BONES, Joints, Skin
from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Mesh
from carlaloc_env.scene.semantic_tags import Tag


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
    weight = 0.9 * elementary.power(t, 0.7) * np.clip(np.abs(at[:, 1]) / (0.05 * s), 0.5, 1.0)
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


def add_head(builder: SkinBuilder) -> None:
    """Neck and head with hair, hat or helmet."""
    b, j = builder.build, builder.rest
    # Heads vary less than bodies: a child's is large for its size.
    k = builder.head_size
    skin, hair = builder.look(b.skin, Material.SKIN), builder.look(b.hair)
    neck, head = j["neck"], j["head"]
    n = 0.055 * math.sqrt(builder.size)
    throat: Hang = ("chest", "head", 0.3)
    builder.loft(
        skin,
        [(neck - up(0.03), n, n, ("chest", "chest", 1.0)), (neck + up(0.03), 0.95 * n, 0.92 * n, throat),
         (head - up(0.06 * k), 0.95 * n, 0.92 * n, ("head", "head", 1.0))],
        sides=8, caps=False,
    )  # fmt: skip
    # Chin to crown: (height, middle ahead, half depth, half width) of the head in units of its size.
    profile = [
        (-0.118, 0.034, 0.030, 0.026), (-0.100, 0.026, 0.062, 0.046), (-0.065, 0.012, 0.084, 0.062),
        (-0.020, 0.002, 0.096, 0.071), (0.030, -0.004, 0.101, 0.076), (0.070, -0.006, 0.094, 0.072),
        (0.100, -0.008, 0.072, 0.056), (0.118, -0.010, 0.030, 0.024),
    ]  # fmt: skip
    if builder.low:
        profile = profile[::2] + profile[-1:]
    level: Hang = ("head", "head", 1.0)
    rows = [(head + by(k * x, 0.0, k * z), k * d, k * w, level) for z, x, d, w in profile]
    builder.loft(skin, rows, sides=12)
    if b.helmet is not None:
        shell = builder.look(b.helmet, Material.PLASTIC)
        _bulge(builder, shell, head + by(-0.012, 0, 0.035), (0.128, 0.108, 0.122), 6, 10)
        return
    if not b.bald:
        _hair(builder, hair, head)
    if b.hat is not None:
        cloth = builder.look(b.hat)
        count, sides = (3, 6) if builder.low else (5, 12)
        crown, brim = (0.112 * k, 0.090 * k, 0.072 * k), (0.115 * k, 0.075 * k, 0.012)
        _bulge(builder, cloth, head + by(-0.010 * k, 0, 0.068 * k), crown, count, sides)
        _bulge(builder, cloth, head + by(0.055 * k, 0, 0.058 * k), brim, 3, sides)


def add_face(builder: SkinBuilder) -> None:
    """Eyes, brows, nose, mouth and ears."""
    b, k, head = builder.build, builder.head_size, builder.rest["head"]
    if b.helmet is not None and b.helmet[0] == b.helmet[1] == 0:
        return
    skin, hair = builder.look(b.skin, Material.SKIN), builder.look(b.hair)
    shade = (int(0.62 * b.skin[0]), int(0.42 * b.skin[1]), int(0.40 * b.skin[2]))
    lips = builder.look(shade, Material.SKIN)
    white, iris = (builder.look(tint, Material.PLASTIC) for tint in ((190, 186, 180), (14, 10, 8)))

    def bulge(look: Look, centre: Array, radii: tuple[float, float, float], count: int, sides: int) -> None:
        x, y, z = radii
        _bulge(builder, look, centre, (x * k, y * k, z * k), count, sides)

    bulge(skin, head + by(0.098 * k, 0, -0.030 * k), (0.020, 0.013, 0.026), 4, 6)
    bulge(lips, head + by(0.087 * k, 0, -0.074 * k), (0.010, 0.024, 0.006), 3, 6)
    for side in (1.0, -1.0):
        eye = head + by(0.088 * k, 0.030 * k * side, 0.006 * k)
        bulge(white, eye, (0.008, 0.014, 0.008), 3, 6)
        bulge(iris, eye + by(0.006 * k, 0, 0), (0.004, 0.006, 0.0065), 3, 5)
        bulge(hair, eye + by(0.002 * k, 0.003 * side, 0.022 * k), (0.010, 0.020, 0.005), 3, 5)
        bulge(skin, head + by(-0.008 * k, 0.076 * k * side, -0.008 * k), (0.018, 0.010, 0.030), 4, 6)
    if b.beard:
        bulge(hair, head + by(0.040 * k, 0, -0.085 * k), (0.060, 0.058, 0.040), 5, 10)


def _hair(builder: SkinBuilder, look: Look, head: Array) -> None:
    """Cap of hair that leaves the face free, and long hair down the neck."""
    k = builder.head_size
    count, sides = (4, 6) if builder.low else (6, 12)
    if not builder.low:
        temples = (0.072 * k, 0.084 * k, 0.090 * k)
        _bulge(builder, look, head + by(-0.040 * k, 0, 0.005 * k), temples, 5, 10)
    cap = (0.108 * k, 0.086 * k, 0.085 * k)
    _bulge(builder, look, head + by(-0.016 * k, 0, 0.041 * k), cap, count, sides)
    if builder.build.long_hair:
        back = (0.052 * k, 0.086 * k, 0.150 * k)
        _bulge(builder, look, head + by(-0.062 * k, 0, -0.075 * k), back, count, sides - 2)


def _bulge(
    builder: SkinBuilder, look: Look, centre: Array, radii: tuple[float, float, float], count: int, sides: int
) -> None:
    """Add an ellipsoid to the head: middle and radii [m], rings and corners of each."""
    builder.hung(ellipsoid(look, centre, radii, count, sides), "head")


def figure(joints: Joints, build: Build, tag: Tag, *, low: bool = False) -> Mesh:
    """Mesh of a person in the posture given by the joints; x is ahead, y left."""
    return skin_of(build, tag, low).posed(joints)


@lru_cache(maxsize=64)
def skin_of(build: Build, tag: Tag, low: bool) -> Skin:
    """Skin of a person: 900 to 1700 triangles, or about 300 for one far away."""
    builder = SkinBuilder(build, tag, low)
    builder.torso()
    add_head(builder)
    for side in ("_l", "_r"):
        builder.leg(side)
        builder.arm(side)
    if build.skirt or build.coat:
        add_skirt(builder)
    if not low:
        add_face(builder)
    add_bags_and_stick(builder)
    return builder.finish()
