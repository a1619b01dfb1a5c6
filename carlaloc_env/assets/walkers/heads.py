"""Heads: a face, ears, hair, hats and helmets."""

from __future__ import annotations

import math

from carlaloc_env.assets.modelling.primitives import Look, ellipsoid
from carlaloc_env.assets.walkers.clothing import Hang, SkinBuilder, by, up
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material


def head(builder: SkinBuilder) -> None:
    """Neck, head, and what is on it."""
    b, j = builder.build, builder.rest
    # Heads vary less than bodies: a child's is large for its size.
    k = builder.k
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
        builder.hung(ellipsoid(shell, head + by(-0.012, 0, 0.035), (0.128, 0.108, 0.122), 6, 10), "head")
        return
    if not b.bald:
        _hair(builder, hair, head)
    if b.hat is not None:
        cloth = builder.look(b.hat)
        n_rings, sides = (3, 6) if builder.low else (5, 12)
        crown = ellipsoid(
            cloth, head + by(-0.010 * k, 0, 0.068 * k), (0.112 * k, 0.090 * k, 0.072 * k), n_rings, sides
        )
        brim = ellipsoid(cloth, head + by(0.055 * k, 0, 0.058 * k), (0.115 * k, 0.075 * k, 0.012), 3, sides)
        builder.hung(crown, "head")
        builder.hung(brim, "head")


def face(builder: SkinBuilder) -> None:
    """Eyes, brows, nose, mouth and ears."""
    b, k, head = builder.build, builder.k, builder.rest["head"]
    if b.helmet is not None and b.helmet[0] == b.helmet[1] == 0:
        return
    skin = builder.look(b.skin, Material.SKIN)
    shade = (int(0.62 * b.skin[0]), int(0.42 * b.skin[1]), int(0.40 * b.skin[2]))
    nose = ellipsoid(skin, head + by(0.098 * k, 0, -0.030 * k), (0.020 * k, 0.013 * k, 0.026 * k), 4, 6)
    builder.hung(nose, "head")
    mouth = ellipsoid(
        builder.look(shade, Material.SKIN),
        head + by(0.087 * k, 0, -0.074 * k),
        (0.010 * k, 0.024 * k, 0.006 * k),
        3,
        6,
    )
    builder.hung(mouth, "head")
    for side in (1.0, -1.0):
        eye = head + by(0.088 * k, 0.030 * k * side, 0.006 * k)
        white = builder.look((190, 186, 180), Material.PLASTIC)
        builder.hung(ellipsoid(white, eye, (0.008 * k, 0.014 * k, 0.008 * k), 3, 6), "head")
        iris = builder.look((14, 10, 8), Material.PLASTIC)
        builder.hung(
            ellipsoid(iris, eye + by(0.006 * k, 0, 0), (0.004 * k, 0.006 * k, 0.0065 * k), 3, 5), "head"
        )
        brow = ellipsoid(
            builder.look(b.hair),
            eye + by(0.002 * k, 0.003 * side, 0.022 * k),
            (0.010 * k, 0.020 * k, 0.005 * k),
            3,
            5,
        )
        builder.hung(brow, "head")
        ear = ellipsoid(
            skin, head + by(-0.008 * k, 0.076 * k * side, -0.008 * k), (0.018 * k, 0.010 * k, 0.030 * k), 4, 6
        )
        builder.hung(ear, "head")
    if b.beard:
        beard = ellipsoid(
            builder.look(b.hair),
            head + by(0.040 * k, 0, -0.085 * k),
            (0.060 * k, 0.058 * k, 0.040 * k),
            5,
            10,
        )
        builder.hung(beard, "head")


def _hair(builder: SkinBuilder, look: Look, head: Array) -> None:
    """Cap of hair that leaves the face free, and long hair down the neck."""
    k = builder.k
    count, sides = (4, 6) if builder.low else (6, 12)
    cap = ellipsoid(
        look, head + by(-0.016 * k, 0, 0.041 * k), (0.108 * k, 0.086 * k, 0.085 * k), count, sides
    )
    if not builder.low:
        # Temples and neck.
        builder.hung(
            ellipsoid(look, head + by(-0.040 * k, 0, 0.005 * k), (0.072 * k, 0.084 * k, 0.090 * k), 5, 10),
            "head",
        )
    builder.hung(cap, "head")
    if builder.build.long_hair:
        back = ellipsoid(
            look, head + by(-0.062 * k, 0, -0.075 * k), (0.052 * k, 0.086 * k, 0.150 * k), count, sides - 2
        )
        builder.hung(back, "head")
