"""Atlases of shop names, billboards and number plates."""

import cv2
import numpy as np

from carlaloc_env.assets.number_plates import (
    PLATE_COLUMNS,
    PLATE_ROWS,
    PLATE_SIZE_M,
    PLATES,
    plate_text,
)
from carlaloc_env.assets.texture_atlas import BILLBOARDS, SHOP_NAMES
from carlaloc_env.render.textures.canvas import Canvas, Rgb, scaled, strips
from carlaloc_env.render.textures.noise import Layer

_PAIRS: tuple[tuple[Rgb, Rgb], ...] = (
    ((150, 20, 18), (252, 244, 220)), ((18, 44, 100), (250, 250, 246)), ((16, 84, 48), (244, 226, 150)),
    ((240, 236, 224), (120, 26, 24)), ((26, 26, 28), (236, 200, 90)), ((214, 150, 24), (40, 24, 16)),
    ((92, 24, 70), (246, 232, 240)), ((30, 104, 120), (252, 252, 244)), ((232, 228, 214), (24, 60, 110)),
    ((60, 38, 26), (238, 214, 170)), ((224, 90, 24), (255, 250, 240)),
)  # fmt: skip
"""Colours of a sign's board and letters, sRGB."""
_FONTS = ("bold", "condensed", "black", "medium", "italic")
"""Faces of signs."""


def shop_signs(rng: np.random.Generator, size: int) -> Layer:
    """All names of `SHOP_NAMES`, two beside each other, from the bottom up."""
    cells = [_shop_sign(k, name, line, rng, size) for k, (name, line) in enumerate(SHOP_NAMES)]
    return strips(cells, columns=2, rows=len(SHOP_NAMES) // 2, size_px=size)


def billboards(rng: np.random.Generator, size: int) -> Layer:
    """All pictures of `BILLBOARDS`, two beside each other, from the bottom up."""
    cells = [_billboard(k, words, rng, size) for k, words in enumerate(BILLBOARDS)]
    return strips(cells, columns=2, rows=len(BILLBOARDS) // 2, size_px=size)


def _shop_sign(number: int, name: str, line: str, rng: np.random.Generator, size: int) -> Layer:
    ground, ink = _PAIRS[number % len(_PAIRS)]
    font = _FONTS[(number // 2) % len(_FONTS)]
    c = Canvas(size // 2, 7.0, ground)
    layout = number % 4
    if layout == 0:
        c.text(name, 0.5, 0.5, 0.90, 0.56, ink, font)
    elif layout == 1:
        _mark(c, number, 0.075, ink, ground)
        c.text(name, 0.56, 0.5, 0.80, 0.54, ink, font)
    elif layout == 2:
        c.text(name, 0.36, 0.52, 0.62, 0.50, ink, font)
        c.rectangle(0.705, 0.15, 0.715, 0.85, ink)
        c.text(line, 0.855, 0.5, 0.25, 0.30, ink)
    else:
        c.text(name, 0.5, 0.64, 0.88, 0.40, ink, font)
        c.text(line, 0.5, 0.20, 0.80, 0.17, ink)
    if number % 3 == 0:
        for y in (0.03, 0.91):
            c.rectangle(0.0, y, 1.0, y + 0.06, ink)
    return c.patch(rng, size // 2, size // (len(SHOP_NAMES) // 2), 0.03)


def _mark(c: Canvas, number: int, x: float, ink: Rgb, ground: Rgb) -> None:
    """A simple emblem at the left end of a sign."""
    if number % 3 == 0:
        c.disc(x, 0.5, 0.36, ink)
        c.disc(x, 0.5, 0.22, ground)
    elif number % 3 == 1:
        c.polygon([(x - 0.05, 0.5), (x, 0.88), (x + 0.05, 0.5), (x, 0.12)], ink)
    else:
        c.rectangle(x - 0.05, 0.40, x + 0.05, 0.60, ink)
        c.rectangle(x - 0.014, 0.12, x + 0.014, 0.88, ink)


def _billboard(
    number: int, words: tuple[str, str, Rgb, Rgb, str], rng: np.random.Generator, size: int
) -> Layer:
    head, line, ground, ink, motif = words
    c = Canvas(size // 2, 2.0, ground)
    _scene(c, motif, ground, ink, rng)
    left = number % 2 == 0
    x = 0.30 if left else 0.70
    c.text(head, x, 0.66, 0.50, 0.20, ink, _FONTS[number % 3])
    c.text(line, x, 0.40, 0.46, 0.095, ink)
    c.rectangle(x - 0.22, 0.12, x + 0.22, 0.27, ink)
    c.text("CALL 555 0" + str(100 + 37 * number), x, 0.195, 0.40, 0.085, ground)
    return c.patch(rng, size // 2, size // (len(BILLBOARDS) // 2), 0.03)


def _scene(c: Canvas, motif: str, ground: Rgb, ink: Rgb, rng: np.random.Generator) -> None:
    """Picture in the half that the words leave free, or behind them."""
    mid: Rgb = ((ground[0] + ink[0]) // 2, (ground[1] + ink[1]) // 2, (ground[2] + ink[2]) // 2)
    if motif == "car":
        c.polygon([(0.58, 0.22), (0.60, 0.42), (0.68, 0.60), (0.84, 0.60), (0.93, 0.42), (0.96, 0.22)], mid)
        c.polygon([(0.64, 0.42), (0.70, 0.56), (0.76, 0.56), (0.76, 0.42)], ink)
        for wheel in (0.67, 0.88):
            c.disc(wheel, 0.22, 0.11, (20, 20, 22))
            c.disc(wheel, 0.22, 0.05, ink)
    elif motif == "hills":
        for k in range(5):
            t = np.linspace(0.0, 1.0, 24)
            ridge = 0.62 - 0.12 * k + 0.07 * np.sin(7 * t + 2 * k) * (1 + 0.2 * k)
            outline = np.concatenate([np.stack([t, ridge], -1), [(1.0, 0.0), (0.0, 0.0)]])
            c.polygon(outline, scaled(mid, 0.9 - 0.13 * k))
    elif motif == "burger":
        c.disc(0.22, 0.58, 0.30, (206, 140, 60), 0.75)
        c.rectangle(0.07, 0.42, 0.37, 0.56, (60, 120, 40))
        c.rectangle(0.07, 0.32, 0.37, 0.43, (90, 50, 26))
        c.rectangle(0.08, 0.16, 0.36, 0.30, (206, 140, 60))
    elif motif == "tower":
        for k in range(6):
            left, high = 0.54 + 0.075 * k, 0.35 + 0.5 * float(rng.random())
            c.rectangle(left, 0.08, left + 0.06, high, mid if k % 2 else ink)
            for y in np.arange(0.14, high - 0.06, 0.09):
                c.rectangle(left + 0.012, float(y), left + 0.048, float(y) + 0.04, ground)
    else:
        for _ in range(16):
            at, up, r = rng.uniform(0.02, 0.45), rng.uniform(0.08, 0.92), rng.uniform(0.03, 0.10)
            c.disc(float(at), float(up), float(r), mid if rng.random() < 0.5 else ink)


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
