"""Materials and tints from which buildings choose."""

from carlaloc_env.scene.materials import Material

BRICKS = tuple(
    (material, tint)
    for material in (Material.BRICK_RED, Material.BRICK_BROWN)
    for tint in ((255, 255, 255), (255, 225, 200), (205, 190, 185), (255, 240, 190), (170, 160, 165))
)
"""Brickwork with its tints."""
PLASTERS = tuple(
    (Material.PLASTER, tint)
    for tint in (
        (250, 246, 235), (245, 214, 150), (238, 190, 140), (205, 215, 190), (190, 205, 225), (240, 205, 190),
        (225, 225, 215), (235, 170, 120), (250, 232, 180), (180, 185, 180), (215, 150, 125), (250, 240, 210),
    )
)  # fmt: skip
"""Render with its tints."""
STONES = tuple(
    (Material.ASHLAR, tint)
    for tint in ((255, 252, 240), (240, 225, 195), (215, 210, 205), (250, 235, 205), (200, 185, 165))
)
"""Ashlar with its tints."""
PANELS = tuple(
    (Material.CONCRETE_PANEL, tint)
    for tint in ((255, 255, 250), (225, 220, 210), (245, 230, 205), (200, 205, 210), (180, 170, 160))
)
"""Concrete panels with their tints."""
TOWERS = tuple(
    (Material.CURTAIN_WALL, tint)
    for tint in ((200, 225, 255), (180, 200, 190), (255, 240, 215), (150, 170, 190), (225, 225, 225))
)
"""Curtain walls with their tints."""
SHEETS = tuple(
    (Material.METAL_PAINTED, tint)
    for tint in ((215, 215, 210), (150, 175, 200), (190, 180, 150), (150, 165, 140), (200, 140, 110))
)
"""Painted sheet metal with its tints."""
BOARDS = ((Material.WOOD, (200, 90, 70)), (Material.WOOD, (170, 150, 130)), (Material.SIDING, (150, 36, 28)))
"""Timber walls with their tints."""
LIGHT = ((250, 248, 240), (225, 220, 210), (200, 195, 185))
"""Tints of light trims."""
DARK = ((70, 70, 72), (110, 100, 90), (60, 75, 70), (90, 50, 40))
"""Tints of dark trims."""
SIDINGS = tuple(
    (Material.SIDING, tint)
    for tint in (
        (255, 255, 250), (180, 205, 225), (250, 225, 160), (190, 210, 175), (225, 150, 130), (160, 165, 170),
        (235, 215, 190), (140, 60, 50), (110, 130, 150),
    )
)  # fmt: skip
"""Weatherboards with their tints."""
TILES = tuple(
    (Material.ROOF_TILE, tint)
    for tint in ((255, 235, 220), (170, 160, 155), (225, 150, 120), (255, 200, 160), (130, 115, 110))
)
"""Roof tiles with their tints."""
SLATES = tuple((Material.ROOF_SLATE, tint) for tint in ((255, 255, 255), (210, 215, 225), (225, 205, 195)))
"""Slates with their tints."""
ACCENTS = (
    (40, 70, 60),
    (90, 30, 26),
    (36, 52, 84),
    (60, 64, 66),
    (210, 206, 196),
    (70, 48, 30),
    (24, 26, 28),
)
"""Shutters, rails and timber."""
