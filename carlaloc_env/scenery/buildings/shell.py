"""The look of one building, chosen from its style, and faces in its materials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import WHITE, Colour
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.scenery.buildings.styles import Style
from carlaloc_env.scenery.meshing.atlas_cells import cell_uv
from carlaloc_env.scenery.meshing.mesh_builder import MeshBuilder

GARAGE_DOOR = 3
"""The door picture that is a garage's; those before it are for people."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """The look of one building, chosen from its style."""

    style: Style
    """The style."""
    material: Material
    """Material of the walls."""
    tint: Colour
    """Linear tint of the walls."""
    trim: Colour
    """Linear tint of sills, cornices and frames."""
    sign: Colour
    """Linear tint of shop signs and awnings."""
    accent: Colour = (60, 64, 66)
    """Linear tint of shutters, rails, doors' canopies and timber."""
    roof: tuple[Material, Colour] = (Material.ROOF_TILE, (255, 235, 220))
    """Material of a pitched roof with its linear tint."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shell:
    """The faces of one building in the making."""

    out: MeshBuilder
    """Where they go, in the building's frame."""
    look: Appearance
    """Materials and tints."""

    def faces(
        self, quads: Array, material: Material, colour: ArrayLike = WHITE, *, uv_m: Array | None = None
    ) -> None:
        """Add faces of any material."""
        self.out.quads(quads, material=material, tag=Tag.BUILDING, colour=colour, uv_m=uv_m)

    def pictures(
        self, quads: Array, material: Material, cell: NDArray[np.integer], aspect: float = 1.0
    ) -> None:
        """Add upright faces that each show one picture of a material, as `cell_uv` counts them."""
        self.faces(quads, material, uv_m=cell_uv(material, cell, aspect))

    def wall(self, quads: Array) -> None:
        """Add faces in the building's wall material."""
        self.faces(quads, self.look.material, self.look.tint)

    def trim(self, quads: Array, material: Material = Material.CONCRETE) -> None:
        """Add faces in the colour of its sills and cornices."""
        self.faces(quads, material, self.look.trim)

    def accent(self, quads: Array, material: Material) -> None:
        """Add faces in the colour of its shutters and rails."""
        self.faces(quads, material, self.look.accent)

    def roof(self, quads: Array) -> None:
        """Add faces in the material of its pitched roof."""
        self.faces(quads, *self.look.roof)
