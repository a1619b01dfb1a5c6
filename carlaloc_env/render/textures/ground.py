"""Textures of roads, pavements, earth, water, crops and furrows."""

from collections.abc import Sequence

import cv2
import numpy as np

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.textures.block_patterns import BLOCK_PATTERNS
from carlaloc_env.render.textures.noise import (
    Field,
    Layer,
    blocks,
    coordinates,
    fbm,
    layer,
    per_cell,
    smoothstep,
    worley,
)
from carlaloc_env.scene.materials import MATERIALS, Material


def asphalt(
    rng: np.random.Generator,
    size: int,
    colour: tuple[float, float, float],
    *,
    mortar: float,
    stones: float,
    roughness: float,
) -> Layer:
    """Asphalt concrete: stones of 15 and of 8 mm in bitumen on a tile of 2.5 m, and gaps between them.

    Rarer things have their place on the road.

    Args:
        rng: Source of randomness.
        size: Edge [px].
        colour: Mean linear albedo.
        mortar: How uneven the bitumen is, a deviation of the logarithm of its brightness.
        stones: The same from stone to stone.
        roughness: Roughness 0–1.
    """
    coarse, fine = worley(rng, size, 165, 165), worley(rng, size, 310, 310)
    log = per_cell(rng, coarse.owner, stones) * smoothstep(0.0, 0.25, coarse.edge)
    log += 0.6 * per_cell(rng, fine.owner, stones) - 0.20 * smoothstep(0.10, 0.0, coarse.edge)
    log += mortar * fbm(rng, size, 0.1, 0.01, 0.85)
    return layer(colour, log, roughness)


def road_paint(rng: np.random.Generator, size: int, colour: tuple[float, float, float]) -> Layer:
    """Worn road paint: chips that show the asphalt, dirt, fine grain."""
    wear = fbm(rng, size, 0.35, 0.01, 0.75) + 0.5 * fbm(rng, size, 0.03, 0.006, 0.9)
    chips = smoothstep(1.6, 2.0, wear)
    dirt = -0.10 * np.abs(fbm(rng, size, 0.5, 0.05)) + 0.06 * fbm(rng, size, 0.02, 0.006)
    tracks = -0.10 * smoothstep(0.4, 1.6, fbm(rng, size, 0.4, 0.03, 0.6, (1.0, 5.0)))
    paint = np.array(colour, np.float32) * np.exp(dirt + tracks)[..., None]
    ground = np.array([0.12, 0.12, 0.115], np.float32) * np.exp(0.25 * fbm(rng, size, 0.02, 0.006))[..., None]
    rgb = paint + chips[..., None] * (ground - paint)
    return layer(colour, np.log(np.maximum(rgb, 0.01)), 0.6 + 0.3 * chips)


def concrete(rng: np.random.Generator, size: int) -> Layer:
    """Cast concrete: cloudy, streaked, with blowholes and fine cracks."""
    log = 0.10 * fbm(rng, size, 0.6, 0.01, 0.7) + 0.05 * fbm(rng, size, 0.012, 0.004, 1.0)
    log += -0.07 * smoothstep(0.3, 1.8, fbm(rng, size, 0.12, 0.01, 0.7, (1.0, 9.0)))
    log += np.log(0.6) * pits(rng, size, 40, 0.05, 0.10)
    return layer((0.315, 0.305, 0.285), log, 0.8)


def pavement(rng: np.random.Generator, size: int) -> Layer:
    """Slabs of 0.6 × 0.4 m in half bond, each of its own grey, with joints and dirt."""
    pattern, tile_m = BLOCK_PATTERNS[Material.PAVEMENT], MATERIALS[Material.PAVEMENT].tile_m
    wobble = 0.02 * fbm(rng, size, 0.4, 0.05)
    index, side, bed = blocks(size, pattern.columns, pattern.rows, pattern.offset, wobble)
    joint_m = tile_m * np.minimum(side / pattern.columns, bed / pattern.rows)
    joint = smoothstep(0.007, 0.003, joint_m)
    bevel = smoothstep(0.03, 0.008, joint_m)
    log = per_cell(rng, index, 0.06) + 0.05 * fbm(rng, size, 0.3, 0.02)
    log += 0.08 * fbm(rng, size, 0.015, 0.004, 1.0)
    log += -0.10 * bevel - 0.75 * joint
    return layer((0.305, 0.292, 0.272), log, 0.8 + 0.1 * joint, 0.5 * per_cell(rng, index, 0.08))


def kerb(rng: np.random.Generator, size: int) -> Layer:
    """Granite kerb stones of 1 m, joined every metre along both axes."""
    index, side, _ = blocks(size, 2, 2, 0.0)
    speckle = per_cell(rng, worley(rng, size, 120, 120).owner, 0.16)
    log = per_cell(rng, index, 0.09) + speckle + 0.08 * fbm(rng, size, 0.3, 0.02)
    log += -0.9 * smoothstep(0.006, 0.003, side)
    log += -0.12 * smoothstep(0.2, 1.8, fbm(rng, size, 0.2, 0.02, 0.7))
    return layer((0.345, 0.34, 0.33), log, 0.75)


def grass(rng: np.random.Generator, size: int) -> Layer:
    """Meadow: blades at every angle over clumps, dry patches and dark gaps between tufts."""
    blades = _strokes(rng, size, 9000, (0.008, 0.018))
    clumps, dry = fbm(rng, size, 0.25, 0.02, 0.8), fbm(rng, size, 0.7, 0.08, 0.6)
    tufts = smoothstep(0.6, 1.4, fbm(rng, size, 0.035, 0.012, 0.8))
    log = 0.42 * blades + 0.26 * clumps + 0.12 * dry - 0.55 * tufts
    straw = smoothstep(0.9, 2.2, dry + 0.4 * clumps)
    tint = np.stack([log + 0.55 * straw, log + 0.12 * straw, log + 0.25 * straw], axis=-1)
    return layer((0.060, 0.112, 0.030), tint, 0.9)


def soil(rng: np.random.Generator, size: int) -> Layer:
    """Bare earth with clods, furrows and straw."""
    clods, crumbs = worley(rng, size, 34, 34), worley(rng, size, 95, 95)
    log = 0.30 * (0.45 - clods.nearest) + per_cell(rng, clods.owner, 0.12) + 0.25 * (0.45 - crumbs.nearest)
    log += 0.14 * fbm(rng, size, 0.5, 0.03, 0.7)
    log += 0.55 * np.maximum(_strokes(rng, size, 260, (0.010, 0.03)), 0)
    return layer((0.150, 0.108, 0.072), log, 0.95, 0.06 * fbm(rng, size, 0.3, 0.03))


def gravel(rng: np.random.Generator, size: int) -> Layer:
    """Round pebbles of two sizes in grey and brown."""
    big, small = worley(rng, size, 44, 44), worley(rng, size, 90, 90)
    top = smoothstep(0.20, 0.45, big.edge + 0.15 * per_cell(rng, big.owner, 1.0))
    fine = 0.35 * (0.5 - small.nearest) + per_cell(rng, small.owner, 0.20) - 0.35
    coarse = 0.45 * (0.5 - big.nearest) + per_cell(rng, big.owner, 0.26)
    log = fine + top * (coarse - fine) + 0.05 * fbm(rng, size, 0.5, 0.05)
    return layer((0.27, 0.25, 0.22), log, 0.92, per_cell(rng, big.owner, 0.12))


def water(rng: np.random.Generator, size: int) -> Layer:
    """Still, dark water; the waves are the renderer's."""
    log = 0.10 * fbm(rng, size, 0.5, 0.03, 0.7) + 0.08 * fbm(rng, size, 0.2, 0.02, 0.7, (3.0, 1.0))
    return layer((0.026, 0.05, 0.045), log, 0.05)


def roof_flat(rng: np.random.Generator, size: int) -> Layer:
    """Bitumen sheets in strips with seams and fine grit."""
    index, side, _ = blocks(size, 4, 1, 0.0, 0.02 * fbm(rng, size, 0.3, 0.03))
    log = per_cell(rng, index, 0.12) - 0.5 * smoothstep(0.02, 0.008, side)
    log += 0.14 * fbm(rng, size, 0.02, 0.004, 1.0) + 0.12 * fbm(rng, size, 0.6, 0.05)
    log += 0.30 * smoothstep(1.2, 2.4, fbm(rng, size, 0.5, 0.04, 0.6))
    return layer((0.20, 0.195, 0.185), log, 0.9)


def cracks(rng: np.random.Generator, size: int, cells: int, share: float, width: float) -> Field:
    """Cracks along the borders of large cells, broken off by noise; 1 inside a crack.

    Args:
        rng: Source of randomness.
        size: Edge [px].
        cells: Cells along one side.
        share: Part of the borders that is cracked.
        width: Width in units of a cell.
    """
    net = _warped_edges(rng, size, cells)
    open_ = smoothstep(0.0, 0.25, fbm(rng, size, 0.5, 0.06, 0.6) + 2.2 * (share - 0.5))
    thin = width * (1.0 + 0.5 * fbm(rng, size, 0.1, 0.02))
    return np.asarray(np.clip(1.4 - net / np.maximum(thin, 0.3 * width), 0, 1) * open_, dtype=np.float32)


def _warped_edges(rng: np.random.Generator, size: int, cells: int) -> Field:
    edge = worley(rng, size, cells, cells).edge
    bend = 0.02 * size * fbm(rng, size, 0.15, 0.01, 0.75)
    other = 0.02 * size * fbm(rng, size, 0.15, 0.01, 0.75)
    k = np.arange(size)
    rows = np.round(k[:, None] + bend).astype(np.int64) % size
    columns = np.round(k[None, :] + other).astype(np.int64) % size
    return edge[rows, columns]


def pits(rng: np.random.Generator, size: int, cells: int, share: float, radius: float) -> Field:
    """Small round holes in some cells of a grid."""
    net = worley(rng, size, cells, cells, 0.6)
    chosen = rng.random(cells * cells)[net.owner] < share
    return np.asarray(chosen * smoothstep(radius * 1.5, radius, net.nearest), dtype=np.float32)


def _strokes(rng: np.random.Generator, size: int, count: int, length: tuple[float, float]) -> Field:
    """Short strokes of random brightness at every angle, mean about 0, deviation 1."""
    centre = rng.random((count, 2)) * size
    angle, reach = rng.random(count) * np.pi, rng.uniform(*length, count) * size
    value = rng.normal(0.0, 1.2, count)
    step = 0.5 * reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    copies = [(du, dv) for dv in (-size, 0, size) for du in (-size, 0, size)]
    return lines_that_wrap(size, centre, step, value, copies)


def lines_that_wrap(
    size: int, centre_px: Array, step_px: Array, value: Array, copies_px: Sequence[tuple[int, int]]
) -> Field:
    """Lines that wrap over the border; later ones cover earlier ones.

    Args:
        size: Edge [px].
        centre_px: Middles, shape (N, 2).
        step_px: From the middles to the ends, shape (N, 2).
        value: Value of each, shape (N,).
        copies_px: Shifts of the copies of all lines, in the order of drawing.
    """
    margin = int(np.ceil(np.abs(step_px).max())) + 2
    canvas = np.zeros((size + 2 * margin, size + 2 * margin), np.float32)
    start, end = centre_px - step_px, centre_px + step_px
    for copy in copies_px:
        shift = np.array(copy) + margin
        inside = np.all((centre_px + shift > 0) & (centre_px + shift < canvas.shape[0]), axis=-1)
        for k in np.flatnonzero(inside):
            a, b = np.round(start[k] + shift).astype(int), np.round(end[k] + shift).astype(int)
            cv2.line(canvas, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), float(value[k]), 1)
    return canvas[margin : margin + size, margin : margin + size]


def crop(rng: np.random.Generator, size: int) -> Layer:
    """A pale stand of plants seen from above, in rows along u; fields tint it."""
    log = 0.22 * _stalks(rng, size, 7000) + 0.16 * fbm(rng, size, 0.12, 0.006, 0.85, (6.0, 1.0))
    log += 0.10 * fbm(rng, size, 0.6, 0.05, 0.7)
    _, v = coordinates(size)
    rows = 0.16 * np.cos(2 * np.pi * 20 * v) + np.zeros((size, size), np.float32)
    hue = 0.10 * fbm(rng, size, 0.3, 0.02)
    return layer((0.43, 0.40, 0.28), log + rows, 0.9, hue)


def furrows(rng: np.random.Generator, size: int) -> Layer:
    """Ploughed earth: furrows of a third of a metre along u, clods and straw."""
    _, v = coordinates(size)
    bend = 0.012 * fbm(rng, size, 0.7, 0.1, 0.5)
    ridge = 0.30 * np.sin(2 * np.pi * (12 * v + 2.0 * bend))
    clods, crumbs = worley(rng, size, 30, 40), worley(rng, size, 90, 110)
    log = ridge + 0.30 * (0.45 - clods.nearest) + per_cell(rng, clods.owner, 0.12)
    log += 0.22 * (0.45 - crumbs.nearest) + 0.10 * fbm(rng, size, 0.5, 0.04)
    log += 0.30 * np.maximum(_stalks(rng, size, 260), 0.0)
    return layer((0.150, 0.108, 0.072), log, 0.95, 0.05 * fbm(rng, size, 0.3, 0.03))


def _stalks(rng: np.random.Generator, size: int, count: int) -> Field:
    """Short strokes, most of them along u, that wrap over the border."""
    centre = rng.random((count, 2)) * size
    angle = rng.normal(0.0, 0.5, count)
    half = rng.uniform(0.006, 0.016, count) * size
    value = rng.normal(0.0, 1.1, count)
    step = half[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    copies = [(du, dv) for du in (-size, 0, size) for dv in (-size, 0, size)]
    return lines_that_wrap(size, centre, step, value, copies)
