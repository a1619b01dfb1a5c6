"""Atlases of windows, shop fronts and doors."""

import numpy as np

from carlaloc_env.assets.texture_atlas import DoorCell, ShopBCell, ShopCell, WideWindowCell, WindowCell
from carlaloc_env.render.textures.canvas import Canvas, Rgb, scaled, sheet, strips
from carlaloc_env.render.textures.noise import Layer

_GLASS_ROUGHNESS = 0.06
"""Roughness of panes."""
_THREE_PANES = (
    WindowCell.PLAIN, WindowCell.NET, WindowCell.CURTAIN_WHITE, WindowCell.PLANT, WindowCell.LAMP,
)  # fmt: skip
"""Windows with sashes of three panes; the others have two."""
_SHOPS: dict[str, tuple[str, str, Rgb, Rgb, Rgb]] = {
    ShopCell.CAFE.name: ("CAFE LUNA", "coffee & cake", (60, 30, 22), (240, 214, 160), (160, 40, 36)),
    ShopCell.BOOKS.name: ("OLD BOOKS", "rare & used", (24, 58, 46), (236, 226, 190), (40, 96, 74)),
    ShopCell.GROCER.name: ("FRESH MARKET", "fruit & veg", (36, 110, 40), (250, 250, 240), (220, 150, 30)),
    ShopCell.FASHION.name: ("NOVA MODE", "new season", (26, 26, 30), (240, 240, 244), (130, 36, 90)),
    ShopBCell.BAKERY.name: (
        "BREAD & ROLLS",
        "since six o'clock",
        (214, 170, 96),
        (90, 40, 20),
        (190, 120, 50),
    ),
    ShopBCell.PHARMACY.name: ("PHARMACY", "open day & night", (236, 240, 236), (10, 110, 60), (20, 130, 80)),
    ShopBCell.BARBER.name: ("BARBER SHOP", "cut & shave", (40, 44, 90), (240, 230, 214), (170, 30, 40)),
    ShopBCell.ELECTRO.name: ("ELECTRO ONE", "phones TV radio", (20, 90, 150), (250, 250, 250), (60, 60, 66)),
}
"""Name, line below, board colour, letter colour, awning colour."""
_FRUIT: tuple[Rgb, ...] = (
    (206, 36, 30), (236, 140, 24), (240, 206, 40), (96, 160, 44), (150, 190, 60), (120, 40, 84),
    (250, 176, 60), (170, 24, 40), (226, 220, 190),
)  # fmt: skip
"""Colours of fruit on show, sRGB."""

_BREAD: tuple[Rgb, ...] = ((206, 150, 80), (176, 112, 52), (226, 184, 116), (140, 84, 40), (240, 214, 160))
"""Colours of bread on show, sRGB."""


def windows(rng: np.random.Generator, size: int) -> Layer:
    """Sixteen windows with two sashes, different frames, blinds, curtains and rooms."""
    return sheet([_window(cell, rng, size // 4) for cell in WindowCell], 4)


def shop_fronts(rng: np.random.Generator, size: int) -> Layer:
    """Four shops with board, awning, lit goods behind glass, and a door."""
    return sheet([_shop(cell.name, rng, size // 2) for cell in ShopCell], 2)


def more_shop_fronts(rng: np.random.Generator, size: int) -> Layer:
    """Four more shops, like the first four."""
    return sheet([_shop(cell.name, rng, size // 2) for cell in ShopBCell], 2)


def wide_windows(rng: np.random.Generator, size: int) -> Layer:
    """Eight windows of offices and flats, about twice as wide as high."""
    cells = [_wide_window(cell, rng, size) for cell in WideWindowCell]
    return strips(cells, columns=2, rows=4, size_px=size)


def doors(rng: np.random.Generator, size: int) -> Layer:
    """Panelled, glazed, steel and garage door."""
    drawn = (_panelled, _glazed, _steel, _garage)
    return sheet([drawn[cell](rng, size // 2) for cell in DoorCell], 2)


def _window(cell: WindowCell, rng: np.random.Generator, size: int) -> Layer:
    dark_frame = cell in (WindowCell.DARK, WindowCell.SLATS, WindowCell.SHELF, WindowCell.BLIND_FULL)
    frame: Rgb = (62, 52, 44) if dark_frame else (206, 202, 192)
    c = Canvas(size, 0.72, frame)
    base = int(rng.integers(34, 52))
    low, high = (base, base + 3, base + 6), (base + 22, base + 28, base + 34)
    c.shade(0.07, 0.05, 0.93, 0.95, low, high, _GLASS_ROUGHNESS)
    _behind(c, cell, rng)
    c.rectangle(0.5 - 0.03, 0.03, 0.5 + 0.03, 0.97, frame, 0.5)
    if cell in _THREE_PANES:
        for y in (0.36, 0.66):
            c.rectangle(0.05, y - 0.012, 0.95, y + 0.012, frame, 0.5)
    else:
        c.rectangle(0.05, 0.68, 0.95, 0.715, frame, 0.5)
    shadow = scaled(frame, 0.55)
    for x in (0.07, 0.53):
        c.rectangle(x, 0.05, x + 0.012, 0.95, shadow)
    c.rectangle(0.07, 0.935, 0.93, 0.95, shadow)
    return c.cell(rng, 0.04)


def _behind(c: Canvas, cell: WindowCell, rng: np.random.Generator) -> None:
    """Draw blinds, curtains and things behind the glass."""
    blind: Rgb = (196, 190, 172)
    heights = {WindowCell.BLIND_LOW: 0.72, WindowCell.BLIND_HALF: 0.48, WindowCell.BLIND_FULL: 0.10}
    if cell in heights:
        low = heights[cell]
        c.shade(0.07, low, 0.93, 0.95, (150, 145, 130), blind)
        c.rectangle(0.07, low - 0.012, 0.93, low, (120, 112, 98))
    curtains: dict[WindowCell, Rgb] = {
        WindowCell.CURTAIN_WHITE: (214, 210, 200),
        WindowCell.CURTAIN_RED: (150, 52, 44),
        WindowCell.CURTAIN_GREEN: (86, 112, 74),
    }
    if cell in curtains:
        _curtains(c, curtains[cell], rng)
    if cell is WindowCell.NET:
        c.shade(0.07, 0.05, 0.93, 0.62, (150, 150, 148), (120, 122, 124))
        for x in np.linspace(0.09, 0.91, 15):
            c.rectangle(x, 0.05, x + 0.014, 0.62, (168, 168, 164))
    if cell in (WindowCell.SLATS, WindowCell.SLATS_HALF):
        low = 0.08 if cell is WindowCell.SLATS else 0.5
        for y in np.arange(low, 0.93, 0.036):
            c.rectangle(0.07, y, 0.93, y + 0.021, (176, 174, 164))
    if cell is WindowCell.PLANT:
        for x in (0.24, 0.74):
            c.rectangle(x - 0.07, 0.05, x + 0.07, 0.15, (150, 78, 44))
            for _ in range(16):
                dx, dy = rng.normal(0, 0.06), abs(rng.normal(0.13, 0.07))
                c.disc(x + dx, 0.15 + dy, 0.03, (50, int(rng.integers(80, 120)), 40))
    if cell is WindowCell.LAMP:
        c.disc(0.30, 0.74, 0.09, (236, 214, 150))
        c.line([(0.30, 0.80), (0.30, 0.95)], 0.008, (30, 30, 30))
    if cell is WindowCell.SHELF:
        for y in (0.18, 0.40, 0.62):
            c.rectangle(0.09, y, 0.91, y + 0.018, (112, 80, 54))
            for x in np.arange(0.10, 0.88, 0.045):
                high = rng.uniform(0.08, 0.15)
                c.rectangle(x, y + 0.018, x + 0.036, y + 0.018 + high, _random_colour(rng, 60, 170))
    if cell is WindowCell.OPEN_SASH:
        c.rectangle(0.07, 0.05, 0.47, 0.66, (16, 16, 18), 0.9)
        c.polygon([(0.07, 0.05), (0.20, 0.12), (0.20, 0.74), (0.07, 0.66)], (188, 186, 180))
        c.polygon([(0.09, 0.11), (0.18, 0.16), (0.18, 0.69), (0.09, 0.62)], (74, 86, 96))
    if cell is WindowCell.BRIGHT:
        c.shade(0.07, 0.05, 0.93, 0.95, (124, 116, 98), (176, 166, 140), _GLASS_ROUGHNESS)
        c.rectangle(0.16, 0.12, 0.40, 0.48, (96, 66, 44))
        c.rectangle(0.62, 0.46, 0.86, 0.80, (60, 84, 110))


def _wide_window(cell: WideWindowCell, rng: np.random.Generator, size: int) -> Layer:
    dark = cell in (WideWindowCell.OFFICE, WideWindowCell.DARK, WideWindowCell.HALF_BLINDS)
    frame: Rgb = (52, 54, 56) if dark else (212, 210, 204)
    c = Canvas(size // 2, 1.5, frame)
    base = int(rng.integers(30, 46))
    low, high = (base, base + 4, base + 8), (base + 26, base + 34, base + 42)
    if cell is WideWindowCell.LIT:
        low, high = (112, 106, 92), (186, 178, 156)
    c.shade(0.04, 0.06, 0.96, 0.94, low, high, _GLASS_ROUGHNESS)
    if cell in (WideWindowCell.OFFICE, WideWindowCell.LIT, WideWindowCell.THREE_SASH):
        for x in (0.14, 0.44, 0.72):
            c.rectangle(x, 0.84, x + 0.16, 0.87, (196, 198, 190))
        c.rectangle(0.08, 0.06, 0.08 + float(rng.uniform(0.1, 0.2)), 0.34, _random_colour(rng, 50, 120))
        c.rectangle(0.62, 0.06, 0.78, 0.40, _random_colour(rng, 50, 120))
    if cell in (WideWindowCell.BLINDS, WideWindowCell.HALF_BLINDS):
        for y in np.arange(0.10 if cell is WideWindowCell.BLINDS else 0.5, 0.92, 0.042):
            c.rectangle(0.04, y, 0.96, y + 0.026, (178, 176, 166))
    if cell is WideWindowCell.CURTAINS:
        _curtains(c, (196, 186, 160), rng)
    if cell is WideWindowCell.PLANTS:
        for x in (0.16, 0.30, 0.68, 0.84):
            c.rectangle(x - 0.04, 0.06, x + 0.04, 0.16, (150, 78, 44))
            for _ in range(14):
                dx, dy = rng.normal(0, 0.035), abs(rng.normal(0.12, 0.08))
                c.disc(x + dx, 0.16 + dy, 0.035, (50, int(rng.integers(80, 130)), 40))
    bars = (0.33, 0.66) if cell in (WideWindowCell.THREE_SASH, WideWindowCell.OFFICE) else (0.5,)
    for x in bars:
        c.rectangle(x - 0.014, 0.03, x + 0.014, 0.97, frame, 0.5)
    if cell in (WideWindowCell.DARK, WideWindowCell.PLANTS, WideWindowCell.LIT):
        c.rectangle(0.03, 0.66, 0.97, 0.69, frame, 0.5)
    return c.patch(rng, size // 2, size // 4, 0.04)


def _curtains(c: Canvas, colour: Rgb, rng: np.random.Generator) -> None:
    for side in (0, 1):
        reach = float(rng.uniform(0.16, 0.30))
        for k in range(6):
            tone = 0.72 + 0.28 * np.cos(np.pi * k * 0.9) + float(rng.normal(0, 0.04))
            a, b = k / 6 * reach, (k + 1) / 6 * reach
            x0, x1 = (0.07 + a, 0.07 + b) if side == 0 else (0.93 - b, 0.93 - a)
            c.rectangle(x0, 0.05, x1, 0.95, scaled(colour, tone))


def _shop(cell: str, rng: np.random.Generator, size: int) -> Layer:
    name, line, board, letters, awning = _SHOPS[cell]
    c = Canvas(size, 1.0, (70, 66, 62))
    c.shade(0.0, 0.0, 1.0, 0.10, (92, 90, 86), (110, 106, 100))
    c.rectangle(0.0, 0.82, 1.0, 1.0, board, 0.4)
    c.rectangle(0.0, 0.82, 1.0, 0.832, letters)
    c.text(name, 0.5, 0.915, 0.86, 0.085, letters)
    c.shade(0.04, 0.10, 0.70, 0.80, (64, 56, 48), (108, 98, 80), _GLASS_ROUGHNESS)
    _goods(c, cell, rng)
    c.shade(0.76, 0.02, 0.96, 0.80, (42, 40, 40), (78, 76, 74), _GLASS_ROUGHNESS)
    c.rectangle(0.80, 0.24, 0.92, 0.34, (206, 40, 34))
    c.text("OPEN", 0.86, 0.29, 0.10, 0.06, (250, 250, 240))
    c.rectangle(0.775, 0.36, 0.785, 0.50, (190, 180, 150))
    for x in (0.04, 0.37, 0.70, 0.76, 0.96):
        c.rectangle(x - 0.012, 0.0, x + 0.012, 0.82, board, 0.4)
    for y in (0.10, 0.80):
        c.rectangle(0.03, y - 0.012, 0.71, y + 0.012, board, 0.4)
    c.text(line, 0.20, 0.70, 0.28, 0.04, (240, 236, 220))
    for k in range(14):
        left, middle, right = k / 14, (k + 0.5) / 14, (k + 1) / 14
        stripe = [(left, 0.84), (right, 0.84), (right, 0.755), (middle, 0.735), (left, 0.755)]
        c.polygon(stripe, awning if k % 2 else (232, 228, 214))
    return c.cell(rng, 0.05)


def _goods(c: Canvas, cell: str, rng: np.random.Generator) -> None:
    if cell == "FASHION":
        for x in (0.12, 0.24, 0.46, 0.60):
            colour = _random_colour(rng, 60, 220)
            c.disc(x, 0.60, 0.024, (214, 180, 150), 1.2)
            c.polygon([(x - 0.05, 0.55), (x + 0.05, 0.55), (x + 0.035, 0.40), (x - 0.035, 0.40)], colour)
            skirt = [(x - 0.035, 0.40), (x + 0.035, 0.40), (x + 0.065, 0.16), (x - 0.065, 0.16)]
            c.polygon(skirt, _random_colour(rng, 40, 200))
        return
    rows = (0.14, 0.30, 0.46, 0.60)
    for y in rows:
        c.rectangle(0.05, y - 0.012, 0.69, y, (120, 88, 58))
        x = 0.06
        while x < 0.61:
            if cell in ("GROCER", "BAKERY"):
                ripe = _FRUIT if cell == "GROCER" else _BREAD
                colour = ripe[int(rng.integers(len(ripe)))]
                for _ in range(7):
                    c.disc(x + rng.uniform(0.01, 0.06), y + rng.uniform(0.01, 0.05), 0.014, colour)
                x += 0.075
            elif cell in ("BOOKS", "PHARMACY"):
                w, h = float(rng.uniform(0.010, 0.022)), float(rng.uniform(0.07, 0.12))
                c.rectangle(x, y, x + w, y + h, _random_colour(rng, 40, 200))
                x += w + 0.003
            elif cell == "ELECTRO":
                w = float(rng.uniform(0.06, 0.13))
                c.rectangle(x, y, x + w, y + 0.11, (18, 18, 20))
                low, high = _random_colour(rng, 20, 200), _random_colour(rng, 60, 240)
                c.shade(x + 0.006, y + 0.012, x + w - 0.006, y + 0.10, low, high)
                x += w + 0.012
            else:
                c.rectangle(x, y, x + 0.03, y + 0.045, _random_colour(rng, 110, 240))
                c.disc(x + 0.015, y + 0.05, 0.018, _random_colour(rng, 90, 230))
                x += 0.058


def _panelled(rng: np.random.Generator, size: int) -> Layer:
    c = Canvas(size, 0.45, (44, 62, 58))
    c.rectangle(0.06, 0.0, 0.94, 0.98, (52, 78, 72), 0.45)
    for x0, x1 in ((0.14, 0.46), (0.54, 0.86)):
        for y0, y1 in ((0.06, 0.34), (0.40, 0.66)):
            c.rectangle(x0, y0, x1, y1, (30, 46, 42))
            c.rectangle(x0 + 0.03, y0 + 0.012, x1 - 0.03, y1 - 0.012, (60, 88, 82))
    c.shade(0.14, 0.74, 0.86, 0.93, (50, 54, 58), (86, 92, 98), _GLASS_ROUGHNESS)
    c.text("24", 0.5, 0.70, 0.2, 0.035, (210, 190, 120))
    c.disc(0.86, 0.37, 0.022, (206, 180, 96))
    c.rectangle(0.40, 0.505, 0.60, 0.525, (206, 180, 96))
    c.rectangle(0.06, 0.0, 0.94, 0.035, (34, 34, 34))
    return c.cell(rng, 0.05)


def _glazed(rng: np.random.Generator, size: int) -> Layer:
    c = Canvas(size, 0.45, (70, 46, 30))
    c.shade(0.14, 0.12, 0.86, 0.94, (44, 46, 48), (92, 96, 100), _GLASS_ROUGHNESS)
    for y in (0.38, 0.66):
        c.rectangle(0.10, y - 0.012, 0.90, y + 0.012, (70, 46, 30), 0.5)
    c.rectangle(0.485, 0.10, 0.515, 0.95, (70, 46, 30), 0.5)
    c.rectangle(0.88, 0.40, 0.93, 0.55, (190, 184, 170))
    c.rectangle(0.0, 0.0, 1.0, 0.03, (30, 26, 24))
    return c.cell(rng, 0.06)


def _steel(rng: np.random.Generator, size: int) -> Layer:
    c = Canvas(size, 0.45, (98, 104, 110))
    c.rectangle(0.06, 0.0, 0.94, 0.97, (120, 128, 134), 0.4)
    for y in np.arange(0.10, 0.34, 0.035):
        c.rectangle(0.24, y, 0.76, y + 0.016, (60, 64, 68))
    c.rectangle(0.30, 0.66, 0.70, 0.78, (226, 190, 30))
    c.text("EXIT", 0.5, 0.72, 0.34, 0.05, (20, 20, 20))
    c.rectangle(0.80, 0.43, 0.90, 0.46, (40, 40, 42))
    for y in (0.12, 0.50, 0.88):
        c.rectangle(0.04, y, 0.08, y + 0.05, (70, 74, 78))
    return c.cell(rng, 0.06)


def _garage(rng: np.random.Generator, size: int) -> Layer:
    c = Canvas(size, 1.15, (168, 164, 152))
    for k in range(5):
        y = 0.02 + k * 0.192
        c.shade(0.03, y, 0.97, y + 0.18, (170, 166, 154), (206, 202, 190), 0.5)
        for x in np.linspace(0.06, 0.76, 4):
            c.rectangle(x, y + 0.035, x + 0.17, y + 0.145, (150, 146, 134))
            c.rectangle(x + 0.012, y + 0.05, x + 0.158, y + 0.13, (190, 186, 174))
        c.rectangle(0.03, y + 0.18, 0.97, y + 0.192, (84, 82, 76))
    for x in np.linspace(0.06, 0.76, 4):
        c.shade(x + 0.012, 0.646, x + 0.158, 0.726, (40, 44, 48), (80, 86, 92), _GLASS_ROUGHNESS)
    c.rectangle(0.46, 0.06, 0.54, 0.085, (40, 40, 40))
    return c.cell(rng, 0.05)


def _random_colour(rng: np.random.Generator, low: int, high: int) -> Rgb:
    r, g, b = (int(v) for v in rng.integers(low, high, 3))
    return r, g, b
