"""Atlases of traffic signs and of posters."""

import numpy as np

from carlaloc_env.assets.texture_atlas import STREET_NAMES, PosterCell, SignCell
from carlaloc_env.render.textures.canvas import Canvas, Rgb, sheet
from carlaloc_env.render.textures.noise import Layer

_WHITE: Rgb = (236, 236, 230)
"""White of traffic signs, sRGB."""
_BLACK: Rgb = (22, 22, 22)
"""Black of traffic signs, sRGB."""
_RED: Rgb = (196, 22, 28)
"""Red of traffic signs, sRGB."""
_BLUE: Rgb = (20, 70, 160)
"""Blue of traffic signs, sRGB."""
_GREEN: Rgb = (10, 104, 66)
"""Green of traffic signs, sRGB."""
_YELLOW: Rgb = (246, 196, 20)
"""Yellow of traffic signs, sRGB."""

_BILLS: dict[PosterCell, tuple[str, str, Rgb, Rgb, str]] = {
    PosterCell.OPERA: ("OPERA", "TOSCA 8 PM", (120, 16, 30), (244, 220, 170), "arches"),
    PosterCell.CIRCUS: ("CIRCUS", "IN TOWN NOW", (246, 190, 30), (190, 24, 30), "rays"),
    PosterCell.COFFEE: ("COFFEE", "FRESH DAILY", (70, 42, 28), (246, 232, 208), "cup"),
    PosterCell.MUSEUM: ("MUSEUM", "OF MODERN ART", (232, 232, 228), (30, 60, 140), "blocks"),
    PosterCell.JAZZ: ("JAZZ", "ALL NIGHT", (24, 28, 66), (250, 180, 40), "discs"),
    PosterCell.MARATHON: ("RUN 42", "CITY MARATHON", (20, 130, 150), (250, 250, 246), "waves"),
    PosterCell.CINEMA: ("CINEMA", "THE LAST TRAIN", (26, 26, 28), (230, 60, 44), "strips"),
    PosterCell.TRAVEL: ("FLY SOUTH", "FROM 99", (60, 150, 220), (255, 240, 120), "sun"),
    PosterCell.BANK: ("CITY BANK", "SINCE 1874", (16, 60, 44), (236, 226, 190), "arches"),
    PosterCell.GALLERY: ("GALLERY", "MASTERS", (216, 206, 186), (150, 40, 30), "portrait"),
    PosterCell.FESTIVAL: ("FESTIVAL", "JUNE 12-20", (210, 50, 110), (252, 244, 90), "rays"),
    PosterCell.MARKET: ("MARKET", "EVERY SUNDAY", (240, 236, 220), (40, 120, 50), "discs"),
    PosterCell.RADIO: ("RADIO 5", "98.4 FM", (250, 120, 30), (24, 24, 30), "waves"),
    PosterCell.ZOO: ("ZOO", "NEW BABY BEAR", (120, 170, 70), (60, 36, 20), "bear"),
    PosterCell.THEATRE: ("THEATRE", "HAMLET", (40, 40, 44), (230, 226, 214), "strips"),
    PosterCell.SALE: ("SALE", "UP TO 70%", (214, 24, 30), (255, 255, 250), "blocks"),
}
"""Headline, line below, ground, ink, and the picture of each poster."""


def signs(rng: np.random.Generator, size: int) -> Layer:
    """All traffic signs of `SignCell`."""
    return sheet([_sign(cell, size // 4).cell(rng, 0.02) for cell in SignCell], 4)


def posters(rng: np.random.Generator, size: int) -> Layer:
    """All posters of `PosterCell`."""
    return sheet([_bill(cell, rng, size // 4) for cell in PosterCell], 4)


def _sign(cell: SignCell, size: int) -> Canvas:
    if cell.name.startswith("SPEED_"):
        return _speed(size, cell.name.removeprefix("SPEED_"))
    if cell in (SignCell.STREET_A, SignCell.STREET_B):
        return _street_names(size, 0 if cell is SignCell.STREET_A else 4)
    drawn = {
        SignCell.STOP: _stop, SignCell.YIELD: _yield, SignCell.NO_ENTRY: _no_entry,
        SignCell.ONE_WAY: _one_way, SignCell.CROSSING: _crossing, SignCell.PARKING: _parking,
        SignCell.BUS_STOP: _bus_stop, SignCell.PLATE: _plate, SignCell.BACK: _back,
    }  # fmt: skip
    return drawn[cell](size)


def _stop(size: int) -> Canvas:
    c = Canvas(size, 1.0, _WHITE)
    angle = np.pi / 8 + np.pi / 4 * np.arange(8)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1) / np.cos(np.pi / 8)
    c.polygon(0.5 + 0.465 * rim, _RED)
    c.text("STOP", 0.5, 0.5, 0.82, 0.34, _WHITE)
    return c


def _yield(size: int) -> Canvas:
    c = Canvas(size, 1.12, _RED)
    c.polygon([(0.5, 0.20), (0.83, 0.90), (0.17, 0.90)], _WHITE)
    c.text("YIELD", 0.5, 0.78, 0.42, 0.13, _RED)
    return c


def _speed(size: int, limit: str) -> Canvas:
    c = _board(size, 0.8, _WHITE, _BLACK)
    c.text("SPEED", 0.5, 0.85, 0.74, 0.12, _BLACK)
    c.text("LIMIT", 0.5, 0.68, 0.74, 0.12, _BLACK)
    c.text(limit, 0.5, 0.33, 0.78, 0.38, _BLACK)
    return c


def _no_entry(size: int) -> Canvas:
    c = Canvas(size, 1.0, _WHITE)
    c.disc(0.5, 0.5, 0.47, _RED)
    c.rectangle(0.16, 0.41, 0.84, 0.59, _WHITE)
    return c


def _one_way(size: int) -> Canvas:
    c = Canvas(size, 3.0, _BLACK)
    head = [(0.80, 0.26), (0.80, 0.08), (0.97, 0.5), (0.80, 0.92), (0.80, 0.74)]
    c.polygon([(0.04, 0.26), *head, (0.04, 0.74)], _WHITE)
    c.text("ONE WAY", 0.43, 0.5, 0.66, 0.30, _BLACK)
    return c


def _crossing(size: int) -> Canvas:
    c = Canvas(size, 1.0, _BLACK)
    c.polygon([(0.5, 0.03), (0.97, 0.5), (0.5, 0.97), (0.03, 0.5)], _YELLOW)
    c.disc(0.52, 0.73, 0.065, _BLACK)
    c.line([(0.52, 0.66), (0.48, 0.46)], 0.09, _BLACK)
    c.line([(0.48, 0.46), (0.58, 0.34), (0.60, 0.20)], 0.055, _BLACK)
    c.line([(0.48, 0.46), (0.42, 0.34), (0.33, 0.22)], 0.055, _BLACK)
    c.line([(0.38, 0.46), (0.43, 0.60), (0.53, 0.63), (0.64, 0.52)], 0.045, _BLACK)
    return c


def _parking(size: int) -> Canvas:
    c = _board(size, 0.75, _BLUE, _WHITE)
    c.text("P", 0.5, 0.62, 0.7, 0.44, _WHITE)
    c.text("2 HOURS", 0.5, 0.18, 0.74, 0.10, _WHITE)
    return c


def _bus_stop(size: int) -> Canvas:
    c = _board(size, 0.75, _WHITE, _GREEN)
    c.rectangle(0.18, 0.50, 0.82, 0.86, _GREEN)
    for x in (0.24, 0.44, 0.64):
        c.rectangle(x, 0.66, x + 0.14, 0.80, _WHITE)
    for x in (0.32, 0.68):
        c.disc(x, 0.49, 0.055, _BLACK)
    c.text("BUS", 0.5, 0.33, 0.7, 0.14, _GREEN)
    c.text("12  47", 0.5, 0.14, 0.7, 0.10, _BLACK)
    return c


def _plate(size: int) -> Canvas:
    c = _board(size, 4.6, (232, 232, 224), (40, 40, 40))
    c.rectangle(0.01, 0.06, 0.085, 0.94, _BLUE)
    c.text("CL 4729", 0.54, 0.5, 0.82, 0.60, (24, 24, 26))
    return c


def _back(size: int) -> Canvas:
    c = Canvas(size, 1.0, (150, 152, 154))
    for y in (0.33, 0.66):
        c.rectangle(0.0, y - 0.03, 1.0, y + 0.03, (120, 122, 124))
    return c


def _street_names(size: int, first: int) -> Canvas:
    """Four strips, the first name at the bottom."""
    c = Canvas(size, 1.0, _GREEN)
    for k, name in enumerate(STREET_NAMES[first : first + 4]):
        y = k / 4
        c.rectangle(0.0, y, 1.0, y + 0.25, _WHITE)
        c.rectangle(0.012, y + 0.012, 0.988, y + 0.238, _GREEN)
        c.text(name, 0.5, y + 0.125, 0.90, 0.13, _WHITE)
    return c


def _board(size: int, aspect: float, ground: Rgb, rim: Rgb) -> Canvas:
    c = Canvas(size, aspect, ground)
    edge = 0.03
    for x in (edge, 1 - edge):
        c.line([(x, edge), (x, 1 - edge)], 0.016, rim)
    for y in (edge, 1 - edge):
        c.line([(edge, y), (1 - edge, y)], 0.016, rim)
    return c


def _bill(cell: PosterCell, rng: np.random.Generator, size: int) -> Layer:
    headline, line, ground, ink, motif = _BILLS[cell]
    c = Canvas(size, 0.68, ground)
    _motif(c, motif, ground, ink, rng)
    c.rectangle(0.0, 0.74, 1.0, 0.97, ground)
    c.text(headline, 0.5, 0.855, 0.90, 0.16, ink)
    c.rectangle(0.0, 0.05, 1.0, 0.19, ink)
    c.text(line, 0.5, 0.12, 0.90, 0.075, ground)
    c.rectangle(0.0, 0.725, 1.0, 0.74, ink)
    return c.cell(rng, 0.03)


def _motif(c: Canvas, name: str, ground: Rgb, ink: Rgb, rng: np.random.Generator) -> None:
    """Picture in the middle of a poster, between y = 0.19 and 0.74."""
    mid: Rgb = ((ground[0] + ink[0]) // 2, (ground[1] + ink[1]) // 2, (ground[2] + ink[2]) // 2)
    if name == "rays":
        for k in range(18):
            a, b = 2 * np.pi * k / 18, 2 * np.pi * (k + 0.5) / 18
            ends = [(0.5 + np.cos(angle), 0.46 + np.sin(angle)) for angle in (a, b)]
            c.polygon([(0.5, 0.46), *ends], ink)
        c.disc(0.5, 0.46, 0.12, mid)
        c.disc(0.5, 0.46, 0.07, ground)
    elif name == "waves":
        t = np.linspace(0, 1, 40)
        for k in range(7):
            wave = np.stack([t, 0.24 + 0.075 * k + 0.03 * np.sin(9 * t + k)], axis=-1)
            c.line(wave, 0.022, ink if k % 2 else mid)
    elif name == "sun":
        c.rectangle(0.0, 0.19, 1.0, 0.36, (20, 80, 130))
        c.disc(0.66, 0.56, 0.11, ink)
        c.polygon([(0.16, 0.36), (0.40, 0.62), (0.62, 0.36)], (230, 236, 240))
        c.polygon([(0.10, 0.28), (0.54, 0.34), (0.40, 0.25), (0.16, 0.23)], (240, 240, 236))
    elif name == "cup":
        c.polygon([(0.26, 0.58), (0.70, 0.58), (0.62, 0.28), (0.34, 0.28)], ink)
        c.disc(0.72, 0.46, 0.06, ink)
        c.disc(0.72, 0.46, 0.035, ground)
        for x in (0.38, 0.48, 0.58):
            c.line([(x, 0.61), (x + 0.03, 0.65), (x - 0.01, 0.69), (x + 0.02, 0.72)], 0.012, mid)
    elif name in ("portrait", "bear"):
        c.disc(0.5, 0.40, 0.21, mid)
        c.disc(0.5, 0.50, 0.115, ink, 1.25)
        for x in (0.42, 0.58):
            c.disc(x, 0.53, 0.018, ground)
        c.line([(0.43, 0.43), (0.5, 0.41), (0.57, 0.43)], 0.014, ground)
        if name == "bear":
            c.disc(0.30, 0.63, 0.05, ink)
            c.disc(0.70, 0.63, 0.05, ink)
        else:
            hat = [(0.30, 0.62), (0.36, 0.71), (0.64, 0.71), (0.70, 0.62), (0.62, 0.64), (0.38, 0.64)]
            c.polygon(hat, mid)
    elif name == "arches":
        for x in (0.18, 0.5, 0.82):
            c.rectangle(x - 0.12, 0.19, x + 0.12, 0.50, ink)
            c.disc(x, 0.50, 0.082, ink)
            c.rectangle(x - 0.06, 0.19, x + 0.06, 0.48, ground)
            c.disc(x, 0.48, 0.041, ground)
    else:
        for _ in range(14 if name == "discs" else 18):
            x, y, s = rng.uniform(0.08, 0.92), rng.uniform(0.26, 0.68), rng.uniform(0.03, 0.09)
            tone = (ink, mid, (255 - ink[0], 255 - ink[1], ink[2]))[int(rng.integers(3))]
            if name == "discs":
                c.disc(x, y, s, tone)
            elif name == "blocks":
                c.rectangle(x - 1.3 * s, y - s, x + 1.3 * s, y + s, tone)
            else:
                c.line([(x - 2 * s, y - s), (x + 2 * s, y + s)], 0.02, tone)
