"""Textures of walls and roofs that are clad: boards, metal sheets, field stones, slates."""

from __future__ import annotations

import numpy as np

from carlaloc_env.render.textures.block_patterns import BLOCK_PATTERNS
from carlaloc_env.render.textures.noise import (
    Layer,
    blocks,
    coordinates,
    fbm,
    layer,
    per_cell,
    smoothstep,
    worley,
)
from carlaloc_env.scene.materials import Material


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
