"""Props of sidewalks: their meshes, and the places chosen for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from carlaloc_env.assets import street_furniture
from carlaloc_env.assets.plants import hedge
from carlaloc_env.assets.signs import sign
from carlaloc_env.assets.texture_atlas import STREET_NAMES
from carlaloc_env.assets.trees import tree
from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.mesh import Mesh

LAMP_HEIGHT_M, LAMP_ARM_M = 8.5, 2.0
"""Height of a lamp's light, and how far it reaches over the road [m]."""


@dataclass(slots=True, eq=False)
class Placement:
    """Props chosen so far: base points and directions by name."""

    bases_m: dict[tuple[str, int, str], list[Array]] = field(default_factory=dict)
    """Base points [m] by prop, variant and detail."""
    yaws: dict[tuple[str, int, str], list[float]] = field(default_factory=dict)
    """Directions of the x axes [rad]."""

    def put(self, name: str, base_m: Array, yaw: float, variant: int = 0, detail: str = "") -> None:
        """Adds one prop."""
        key = (name, variant, detail)
        self.bases_m.setdefault(key, []).append(base_m)
        self.yaws.setdefault(key, []).append(yaw)

    def bases_of(self, name: str) -> Array:
        """Base points of all props of one name [m], shape (K, 3)."""
        bases = [base_m for key, bases_m in self.bases_m.items() if key[0] == name for base_m in bases_m]
        return np.array(bases, dtype=np.float64).reshape(-1, 3)


def prop_mesh(name: str, variant: int, detail: str) -> Mesh:
    """Mesh of a placed prop."""
    if name.startswith("tree "):
        return tree(name.removeprefix("tree "), variant, detail)
    makers: dict[str, Callable[[], Mesh]] = {
        "lamp": lambda: street_furniture.lamp(LAMP_HEIGHT_M, LAMP_ARM_M),
        "banner": lambda: street_furniture.banner(variant),
        "bench": street_furniture.bench,
        "bin": street_furniture.bin_,
        "hydrant": street_furniture.hydrant,
        "newspaper_box": street_furniture.newspaper_box,
        "post_box": street_furniture.post_box,
        "cabinet": street_furniture.cabinet,
        "planter": street_furniture.planter,
        "column": lambda: street_furniture.advertising_column(variant),
        "street_name": lambda: sign("street_name", STREET_NAMES[variant]),
        "bus_shelter": lambda: street_furniture.bus_shelter(variant),
        "hedge": lambda: hedge(3.0, 1.2 + 0.1 * variant, 0.6, variant, "low"),
    }
    return makers[name]()
