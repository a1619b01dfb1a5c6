"""Textures of fields: standing crops and ploughed earth, both in rows along u."""

from __future__ import annotations

import numpy as np

from carlaloc_env.render.textures.ground import lines_that_wrap
from carlaloc_env.render.textures.noise import Field, Layer, coordinates, fbm, layer, per_cell, worley


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
