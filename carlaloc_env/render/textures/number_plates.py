"""Atlas of number plates."""

from __future__ import annotations

import cv2
import numpy as np

from carlaloc_env.assets.catalog import PLATE_COLUMNS, PLATE_ROWS, PLATE_SIZE_M, PLATES, plate_text
from carlaloc_env.render.textures.canvas import Canvas, Rgb, strips
from carlaloc_env.render.textures.noise import Layer

_GROUNDS: tuple[Rgb, ...] = ((232, 232, 224), (232, 232, 224), (232, 232, 224), (238, 204, 70))
"""White plates, and every fourth column yellow."""
_INK: Rgb = (18, 18, 22)
"""Colour of the letters, sRGB."""


def number_plates(rng: np.random.Generator, size: int) -> Layer:
    """All number plates, row 0 at the bottom."""
    width, height = size // PLATE_COLUMNS, size // PLATE_ROWS
    plates = [_number_plate(k, width, height, rng) for k in range(PLATES)]
    return strips(plates, columns=PLATE_COLUMNS, rows=PLATE_ROWS, size_px=size)


def _number_plate(index: int, width_px: int, height_px: int, rng: np.random.Generator) -> Layer:
    c = Canvas(width_px, PLATE_SIZE_M[0] / PLATE_SIZE_M[1], _GROUNDS[index % PLATE_COLUMNS])
    c.rectangle(0.0, 0.0, 0.075, 1.0, (18, 58, 150))
    c.text(plate_text(index), 0.535, 0.5, 0.86, 0.62, _INK)
    for y in (0.0, 0.95):
        c.rectangle(0.0, y, 1.0, y + 0.05, _INK)
    for x in (0.0, 0.992):
        c.rectangle(x, 0.0, x + 0.008, 1.0, _INK)
    square = c.cell(rng, 0.02)
    return np.asarray(cv2.resize(square, (width_px, height_px), interpolation=cv2.INTER_AREA), np.float32)
