"""Textures of walls and roofs: masonry, plaster, panels, boards, metal sheets, field stones, slates."""

import numpy as np

from carlaloc_env.render.textures.block_patterns import BLOCK_PATTERNS
from carlaloc_env.render.textures.ground import cracks, pits
from carlaloc_env.render.textures.noise import (
    Layer,
    blocks,
    coordinates,
    fbm,
    layer,
    per_cell,
    smoothstep,
    with_roughness,
    worley,
)
from carlaloc_env.scene.materials import MATERIALS, Material


def brick(rng: np.random.Generator, size: int, colour: tuple[float, float, float]) -> Layer:
    """Running bond, each brick of its own shade, pale joints, efflorescence; the shader burns some."""
    pattern, tile_m = BLOCK_PATTERNS[Material.BRICK_RED], MATERIALS[Material.BRICK_RED].tile_m
    wobble = 0.03 * fbm(rng, size, 0.06, 0.01)
    index, side, bed = blocks(size, pattern.columns, pattern.rows, pattern.offset, wobble)
    joint_m = tile_m * np.minimum(side / pattern.columns, bed / pattern.rows)
    joint = smoothstep(0.0085, 0.0035, joint_m + 0.0012 * fbm(rng, size, 0.02, 0.005))
    log = per_cell(rng, index, 0.17) + 0.09 * fbm(rng, size, 0.03, 0.004, 0.95)
    hue = per_cell(rng, index, 0.16)
    tone = log[..., None] + hue[..., None] * np.array([0.4, -0.1, -0.4], np.float32)
    face = np.array(colour, np.float32) * np.exp(tone)
    mortar = np.array([0.31, 0.29, 0.255], np.float32) * np.exp(0.12 * fbm(rng, size, 0.03, 0.005))[..., None]
    rgb = face + joint[..., None] * (mortar - face)
    bloom = 0.30 * smoothstep(0.9, 2.6, fbm(rng, size, 0.45, 0.02, 0.7))
    soot = -0.16 * smoothstep(0.3, 2.0, fbm(rng, size, 0.35, 0.02, 0.7, (1.0, 3.0)))
    rgb = (rgb + bloom[..., None] * (0.42 - rgb)) * np.exp(soot + 0.05 * fbm(rng, size, 0.6, 0.05))[..., None]
    red, green, blue = (0.86 * c + 0.05 for c in colour)
    return layer((red, green, blue), np.log(np.maximum(rgb, 0.01)), 0.85)


def plaster(rng: np.random.Generator, size: int) -> Layer:
    """Float-finished render with runs of dirt, hairline cracks and mended spots."""
    log = 0.06 * fbm(rng, size, 0.5, 0.02, 0.75) + 0.07 * fbm(rng, size, 0.02, 0.004, 1.0)
    runs = smoothstep(0.4, 2.2, fbm(rng, size, 0.10, 0.008, 0.7, (1.0, 10.0)))
    log += -0.16 * runs
    log += np.log(0.62) * cracks(rng, size, 3, 0.22, 0.010)
    mended = smoothstep(1.6, 1.75, fbm(rng, size, 0.35, 0.06, 0.5))
    log += mended * (0.10 + 0.05 * fbm(rng, size, 0.02, 0.005))
    log += np.log(0.6) * pits(rng, size, 60, 0.04, 0.12)
    return layer((0.55, 0.53, 0.485), log, 0.9)


def ashlar(rng: np.random.Generator, size: int) -> Layer:
    """Dressed stone of 0.6 × 0.3 m in half bond, weathered."""
    pattern, tile_m = BLOCK_PATTERNS[Material.ASHLAR], MATERIALS[Material.ASHLAR].tile_m
    wobble = 0.015 * fbm(rng, size, 0.2, 0.03)
    index, side, bed = blocks(size, pattern.columns, pattern.rows, pattern.offset, wobble)
    joint_m = tile_m * np.minimum(side / pattern.columns, bed / pattern.rows)
    pores = worley(rng, size, 150, 150)
    log = per_cell(rng, index, 0.13) + 0.09 * fbm(rng, size, 0.12, 0.01, 0.8)
    log += 0.05 * fbm(rng, size, 0.01, 0.004, 1.0)
    log += -0.55 * smoothstep(0.008, 0.003, joint_m) - 0.12 * smoothstep(0.03, 0.008, joint_m)
    log += -0.35 * (rng.random(150 * 150)[pores.owner] < 0.05) * smoothstep(0.4, 0.2, pores.nearest)
    log += -0.18 * smoothstep(0.3, 2.2, fbm(rng, size, 0.2, 0.012, 0.7, (1.0, 6.0)))
    return layer((0.40, 0.375, 0.32), log, 0.8, per_cell(rng, index, 0.07))


def concrete_panel(rng: np.random.Generator, size: int) -> Layer:
    """Precast panels of 3.0 × 1.5 m with open joints, tie holes and streaks.

    The shader lays them in any order, each in its tone.
    """
    pattern = BLOCK_PATTERNS[Material.CONCRETE_PANEL]
    _, side, bed = blocks(size, pattern.columns, pattern.rows, 0.0)
    joint_m = np.minimum(side * 3.0, bed * 1.5)
    u, v = coordinates(size)
    holes = np.zeros((size, size), np.float32)
    for x, y in ((0.15, 0.2), (0.85, 0.2), (0.15, 0.8), (0.85, 0.8)):
        du, dv = (np.mod(u * pattern.columns, 1) - x) * 3.0, (np.mod(v * pattern.rows, 1) - y) * 1.5
        holes = np.maximum(holes, smoothstep(0.030, 0.022, np.sqrt(du * du + dv * dv)))
    log = 0.08 * fbm(rng, size, 0.3, 0.01, 0.75) + 0.06 * fbm(rng, size, 0.01, 0.004, 1.0)
    log += -0.9 * smoothstep(0.022, 0.014, joint_m) - 0.6 * holes
    streak = smoothstep(0.2, 2.0, fbm(rng, size, 0.08, 0.006, 0.75, (1.0, 8.0)))
    log += -0.20 * streak * smoothstep(0.0, 0.6, np.mod(v * pattern.rows, 1) + 0 * u)
    log += np.log(0.7) * pits(rng, size, 130, 0.06, 0.14)
    return layer((0.345, 0.335, 0.31), log, 0.8)


def curtain_wall(rng: np.random.Generator, size: int) -> Layer:
    """Glazing of 0.75 × 1.5 m panes in metal mullions, with blinds and rooms behind."""
    columns, rows = 4, 2
    index, side, bed = blocks(size, columns, rows, 0.0)
    side_m, bed_m = side * 3.0 / columns, bed * 3.0 / rows
    _, v = coordinates(size)
    height = np.mod(v * rows, 1) + np.zeros((size, size), np.float32)
    count = columns * rows
    blind = rng.choice([0.0, 0.0, 0.25, 0.45, 0.8], count)[index]
    tone = np.exp(0.35 * rng.standard_normal(count))[index]
    slat = 0.75 + 0.25 * np.sin(2 * np.pi * height * 28)
    glass = 0.115 * tone * (0.6 + 0.9 * height)
    ceiling = 0.10 * smoothstep(0.05, 0.02, np.abs(height - 0.82)) * (np.mod(index, 3) == 0)
    covered = smoothstep(-0.01, 0.01, height - (1 - blind)) * (blind > 0)
    value = glass + ceiling + covered * (0.26 * slat - glass) * 0.8
    rgb = value[..., None] * np.array([0.86, 1.0, 1.12], np.float32)
    rgb = rgb + 0.006 * np.abs(fbm(rng, size, 0.2, 0.01))[..., None]
    frame = np.maximum(smoothstep(0.034, 0.028, side_m), smoothstep(0.045, 0.038, bed_m))
    metal = np.array([0.25, 0.25, 0.255], np.float32) * np.exp(0.10 * fbm(rng, size, 0.1, 0.01))[..., None]
    spandrel = (height < 0.20).astype(np.float32)
    dark = np.array([0.10, 0.115, 0.13], np.float32) * np.exp(0.15 * fbm(rng, size, 0.1, 0.01))[..., None]
    rgb = rgb + spandrel[..., None] * (dark - rgb)
    rgb = rgb + frame[..., None] * (metal - rgb)
    line = smoothstep(0.005, 0.003, side_m) * 0.5
    rgb = rgb * (1 - line[..., None])
    return with_roughness(rgb, 0.06 + 0.34 * frame + 0.1 * spandrel * (1 - frame))


def roof_tile(rng: np.random.Generator, size: int) -> Layer:
    """Pantiles of 0.20 × 0.33 m: rounded, shaded under each course, mossy in places."""
    columns, rows = 10, 6
    index, _, _ = blocks(size, columns, rows, 0.0, 0.02 * fbm(rng, size, 0.2, 0.03))
    u, v = coordinates(size)
    across = np.mod(u * columns, 1) + np.zeros((size, size), np.float32)
    up = np.mod(v * rows, 1) + np.zeros((size, size), np.float32)
    round_ = 0.30 * np.sin(2 * np.pi * across)
    lap = -1.1 * smoothstep(0.10, 0.0, up) + 0.15 * smoothstep(0.10, 0.25, up) * smoothstep(0.45, 0.25, up)
    log = per_cell(rng, index, 0.18) + round_ + lap + 0.09 * fbm(rng, size, 0.03, 0.006, 0.95)
    log += -0.7 * smoothstep(0.05, 0.02, np.minimum(across, 1 - across))
    moss = smoothstep(1.1, 1.9, fbm(rng, size, 0.25, 0.01, 0.75))
    tint = np.stack([log - 0.9 * moss, log + 0.1 * moss, log - 0.1 * moss], axis=-1)
    return layer((0.27, 0.115, 0.072), tint, 0.8, per_cell(rng, index, 0.12))


def siding(rng: np.random.Generator, size: int) -> Layer:
    """Painted weatherboards of 0.15 m along u, each shaded below its lap, with butt joints and peeling.

    The shader lays them in any order, set off, each in its tone.
    """
    pattern = BLOCK_PATTERNS[Material.SIDING]
    _, side, _ = blocks(size, pattern.columns, pattern.rows, 0.0)
    _, v = coordinates(size)
    up = np.mod(v * pattern.rows, 1) + np.zeros((size, size), np.float32)
    log = -0.75 * smoothstep(0.10, 0.02, up) + 0.10 * smoothstep(0.75, 1.0, up)
    log += 0.06 * fbm(rng, size, 0.12, 0.004, 0.85, (9.0, 1.0)) + 0.05 * fbm(rng, size, 0.4, 0.03)
    log += -0.6 * smoothstep(0.004, 0.0015, side)
    log += -0.35 * smoothstep(1.7, 2.2, fbm(rng, size, 0.10, 0.006, 0.8, (4.0, 1.0)))
    return layer((0.56, 0.55, 0.52), log, 0.75)


def sheet_metal(rng: np.random.Generator, size: int) -> Layer:
    """Trapezoidal sheets with ribs of 0.2 m along v, lapped every metre, bolted, with runs of rust."""
    u, v = coordinates(size)
    rib = np.mod(u * 10, 1) + np.zeros((size, size), np.float32)
    log = 0.16 * smoothstep(0.18, 0.26, rib) - 0.30 * smoothstep(0.60, 0.68, rib)
    log += 0.18 * smoothstep(0.88, 0.96, rib)
    lap = np.mod(u * 2, 1) + 0 * v
    log += -0.5 * smoothstep(0.008, 0.003, np.minimum(lap, 1 - lap))
    row = np.mod(v * 2, 1)
    bolt = smoothstep(0.016, 0.009, np.abs(row - 0.5) / 2) * smoothstep(0.10, 0.05, np.abs(rib - 0.42))
    log += -0.8 * bolt + 0.04 * fbm(rng, size, 0.3, 0.01, 0.8)
    rust = smoothstep(1.2, 2.4, fbm(rng, size, 0.14, 0.008, 0.75, (1.0, 9.0)))
    tint = np.stack([log - 0.12 * rust, log - 0.42 * rust, log - 0.75 * rust], axis=-1)
    return layer((0.48, 0.475, 0.46), tint, 0.45 + 0.4 * rust)


def rubble(rng: np.random.Generator, size: int) -> Layer:
    """Field stones of many sizes and greys in pale mortar; the shader soils the rougher ones in places."""
    stones = worley(rng, size, 11, 15, 0.8)
    inside = smoothstep(0.06, 0.16, stones.edge + 0.02 * fbm(rng, size, 0.05, 0.01))
    face = per_cell(rng, stones.owner, 0.06) + 0.12 * fbm(rng, size, 0.06, 0.004, 0.9)
    face += 0.18 * (0.4 - stones.nearest)
    log = -0.05 + inside * (face + 0.05) - 0.35 * smoothstep(0.14, 0.07, stones.edge) * inside
    log += 0.08 * fbm(rng, size, 0.6, 0.05)
    spread = rng.uniform(-0.12, 0.12, int(stones.owner.max()) + 1).astype(np.float32)[stones.owner]
    roughness = 0.85 + inside * spread
    return layer((0.33, 0.31, 0.275), log, roughness, per_cell(rng, stones.owner, 0.12))


def slate(rng: np.random.Generator, size: int) -> Layer:
    """Slates of 0.20 × 0.17 m in half bond, with lichen and slipped ones."""
    index, side, _ = blocks(size, 10, 12, 0.5, 0.05 * fbm(rng, size, 0.1, 0.02))
    _, v = coordinates(size)
    up = np.mod(v * 12, 1) + np.zeros((size, size), np.float32)
    log = per_cell(rng, index, 0.20) - 0.85 * smoothstep(0.12, 0.02, up)
    log += -0.7 * smoothstep(0.05, 0.02, side) + 0.08 * fbm(rng, size, 0.03, 0.005, 0.95)
    lichen = smoothstep(1.5, 2.2, fbm(rng, size, 0.12, 0.01, 0.8))
    tint = np.stack([log + 0.45 * lichen, log + 0.5 * lichen, log + 0.25 * lichen], axis=-1)
    return layer((0.125, 0.130, 0.142), tint, 0.6)
