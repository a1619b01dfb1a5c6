"""One colour for every material, for tests that need no textures."""

import numpy as np

from carlaloc_env.scene.materials import Material, material_values

_COLOURS: dict[str, tuple[float, float, float]] = {
    "ASPHALT": (0.10, 0.10, 0.10), "ASPHALT_OLD": (0.13, 0.13, 0.12),
    "ASPHALT_MOTORWAY": (0.11, 0.11, 0.11), "ROAD_PAINT_WHITE": (0.55, 0.55, 0.52),
    "ROAD_PAINT_YELLOW": (0.50, 0.33, 0.04), "GRASS": (0.06, 0.11, 0.03), "SOIL": (0.15, 0.12, 0.09),
    "BRICK_RED": (0.26, 0.12, 0.08), "BRICK_BROWN": (0.20, 0.13, 0.09), "PLASTER": (0.50, 0.47, 0.42),
    "CURTAIN_WALL": (0.04, 0.05, 0.06), "WINDOW": (0.04, 0.05, 0.06), "SHOP_FRONT": (0.06, 0.06, 0.06),
    "BARK": (0.12, 0.09, 0.07), "LEAF": (0.06, 0.12, 0.03), "CAR_PAINT": (0.80, 0.80, 0.80),
    "GLASS": (0.03, 0.03, 0.03), "RUBBER": (0.03, 0.03, 0.03), "CLOTH": (0.60, 0.60, 0.60),
    "WATER": (0.02, 0.05, 0.04), "LAMP_WHITE": (0.80, 0.72, 0.60), "LAMP_RED": (0.70, 0.04, 0.02),
    "LAMP_TAIL": (0.35, 0.02, 0.015), "LAMP_AMBER": (0.80, 0.38, 0.02), "LAMP_GREEN": (0.05, 0.70, 0.35),
}  # fmt: skip
"""Linear mean albedo."""


def plain_albedo() -> np.ndarray:
    """One colour and roughness per material instead of textures, shape (M, 1, 1, 4)."""
    rows = [_COLOURS.get(material.name, (0.3, 0.3, 0.3)) for material in Material]
    roughness = material_values("roughness")[:, None]
    return np.concatenate([np.array(rows), roughness], axis=1).astype(np.float16)[:, None, None]
