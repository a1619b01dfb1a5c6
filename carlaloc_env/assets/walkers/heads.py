"""Heads of walkers: a face, ears, hair, hats and helmets."""

import math

from carlaloc_env.assets.primitives import Look, ellipsoid
from carlaloc_env.assets.walkers.clothing import Hang, SkinBuilder, by, up
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material


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
