"""Textures of things: wood, metal, cloth, leaves, rubber, and near-white bases that a tint colours."""

import cv2
import numpy as np

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


def plain(rng: np.random.Generator, size: int) -> Layer:
    """Matt white base."""
    return layer((0.75, 0.75, 0.75), 0.05 * fbm(rng, size, 0.4, 0.01, 0.8), 0.8)


def painted_metal(rng: np.random.Generator, size: int) -> Layer:
    """White paint with runs, scratches and dust; the tint colours it."""
    log = 0.05 * fbm(rng, size, 0.5, 0.02, 0.7)
    log -= 0.06 * smoothstep(0.8, 2.4, fbm(rng, size, 0.10, 0.01, 0.7, (1.0, 8.0)))
    log += -0.18 * smoothstep(2.4, 2.9, fbm(rng, size, 0.05, 0.005, 0.8, (6.0, 1.0)))
    return layer((0.76, 0.76, 0.76), log, 0.4 + 0.04 * fbm(rng, size, 0.2, 0.02))


def car_paint(rng: np.random.Generator, size: int) -> Layer:
    """Near-white base of car paint with flakes and a film of dust; the tint colours it."""
    log = 0.035 * fbm(rng, size, 0.012, 0.004, 1.0) + 0.04 * fbm(rng, size, 0.6, 0.05, 0.6)
    return layer((0.80, 0.80, 0.80), log, 0.10 + 0.015 * np.abs(fbm(rng, size, 0.4, 0.02)))


def galvanised(rng: np.random.Generator, size: int) -> Layer:
    """Zinc spangle with runs of white rust."""
    spangle = worley(rng, size, 60, 60)
    log = per_cell(rng, spangle.owner, 0.10) - 0.06 * smoothstep(0.08, 0.0, spangle.edge)
    dust = 0.06 * fbm(rng, size, 0.5, 0.02, 0.7)
    log += dust - 0.12 * smoothstep(0.7, 2.2, fbm(rng, size, 0.1, 0.01, 0.7, (1.0, 7.0)))
    return layer((0.40, 0.405, 0.41), log, 0.45 + 0.05 * per_cell(rng, spangle.owner, 1.0))


def glass(rng: np.random.Generator, size: int) -> Layer:
    """Dark glass with a little dirt."""
    return layer((0.035, 0.04, 0.042), 0.10 * fbm(rng, size, 0.6, 0.02, 0.7), 0.05)


def rubber(rng: np.random.Generator, size: int) -> Layer:
    """Tyre tread: blocks and grooves with road dust."""
    index, side, bed = blocks(size, 6, 10, 0.5)
    groove = np.maximum(smoothstep(0.10, 0.05, side), smoothstep(0.14, 0.08, bed))
    log = per_cell(rng, index, 0.06) - 0.7 * groove + 0.15 * fbm(rng, size, 0.1, 0.005, 0.9)
    return layer((0.042, 0.041, 0.040), log, 0.9)


def plastic(rng: np.random.Generator, size: int) -> Layer:
    """White plastic with a fine grain; the tint colours it."""
    log = 0.05 * fbm(rng, size, 0.02, 0.004, 1.0) + 0.04 * fbm(rng, size, 0.5, 0.05)
    return layer((0.76, 0.76, 0.76), log, 0.5)


def cloth(rng: np.random.Generator, size: int) -> Layer:
    """Woven cloth with folds; the tint colours it."""
    u, v = coordinates(size)
    weave = 0.06 * np.sin(2 * np.pi * 64 * u) * np.sin(2 * np.pi * 64 * v)
    folds = fbm(rng, size, 0.6, 0.06, 0.6, (1.0, 3.0))
    log = weave + 0.12 * folds + 0.05 * fbm(rng, size, 0.02, 0.004, 1.0) - 0.15 * smoothstep(0.9, 2.0, -folds)
    return layer((0.70, 0.70, 0.70), log, 0.95)


def skin(rng: np.random.Generator, size: int) -> Layer:
    """Pale base; the tint colours it."""
    return layer((0.72, 0.70, 0.68), 0.05 * fbm(rng, size, 0.4, 0.02, 0.7), 0.6)


def bark(rng: np.random.Generator, size: int) -> Layer:
    """Ridges that run up the trunk, with lichen."""
    ridge = 1.0 - np.abs(fbm(rng, size, 0.22, 0.015, 0.7, (1.0, 5.0)))
    log = 0.28 * ridge - 0.45 * smoothstep(0.15, 0.0, np.abs(fbm(rng, size, 0.16, 0.02, 0.7, (1.0, 6.0))))
    log += 0.10 * fbm(rng, size, 0.02, 0.005, 0.9)
    lichen = smoothstep(1.2, 2.0, fbm(rng, size, 0.25, 0.02, 0.75))
    tint = np.stack([log + 0.25 * lichen, log + 0.45 * lichen, log + 0.2 * lichen], axis=-1)
    return layer((0.150, 0.118, 0.088), tint, 0.9)


def leaf(rng: np.random.Generator, size: int) -> Layer:
    """Foliage: leaves of 8–16 cm over one another in sprays, dark between them, some yellowish."""
    count = 2600
    centre = rng.random((count, 2)) * size
    length = rng.uniform(0.020, 0.042, count) * size
    turn = rng.uniform(0.0, 180.0, count)
    # Lower leaves are drawn first and lie in the shade of the others.
    light = np.linspace(-0.24, 0.16, count) + rng.normal(0.0, 0.09, count)
    hue = rng.normal(0.0, 0.16, count)
    canvas = np.full((size, size, 2), (-0.36, 0.0), np.float32)
    for k in range(count):
        axes = (max(round(length[k]), 1), max(round(0.45 * length[k]), 1))
        value = (float(light[k]), float(hue[k]))
        reach = axes[0] + 1
        for du in (-size, 0, size):
            for dv in (-size, 0, size):
                x, y = centre[k, 0] + du, centre[k, 1] + dv
                if -reach < x < size + reach and -reach < y < size + reach:
                    cv2.ellipse(canvas, (round(x), round(y)), axes, float(turn[k]), 0, 360, value, -1)
    sprays = fbm(rng, size, 0.16, 0.05, 0.8)
    log = 1.3 * canvas[..., 0] + 0.34 * sprays - 0.5 * smoothstep(0.4, 1.2, -sprays)
    warm = canvas[..., 1]
    tint = np.stack([log + warm, log, log - 0.5 * warm], axis=-1)
    return layer((0.135, 0.162, 0.058), tint, 1.0)


def wood(rng: np.random.Generator, size: int) -> Layer:
    """Boards of 0.15 m along u with grain and knots."""
    index, _, bed = blocks(size, 1, 10, 0.0)
    grain = fbm(rng, size, 0.10, 0.004, 0.85, (14.0, 1.0))
    u, v = coordinates(size)
    rings = np.sin(2 * np.pi * (40 * v + 1.2 * fbm(rng, size, 0.6, 0.08, 0.5, (3.0, 1.0))) + 0 * u)
    log = per_cell(rng, index, 0.13) + 0.14 * grain + 0.06 * rings - 0.9 * smoothstep(0.06, 0.02, bed)
    return layer((0.285, 0.190, 0.110), log, 0.8, per_cell(rng, index, 0.08))


def lamp(rng: np.random.Generator, size: int, colour: tuple[float, float, float]) -> Layer:
    """Lens with a fine grid of prisms."""
    u, v = coordinates(size)
    grid = 0.10 * np.sin(2 * np.pi * 16 * u) * np.sin(2 * np.pi * 16 * v) + 0.02 * fbm(rng, size, 0.3, 0.02)
    return layer(colour, grid, 0.3)
