"""What one building chose from its style, and faces in its materials."""

from __future__ import annotations

from dataclasses import dataclass

from carlaloc_env.core.array_types import Array
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import Colour
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.town.buildings.styles import Style
from carlaloc_env.town.meshing.mesh_builder import MeshBuilder


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """What one building chose from its style."""

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


def wall_faces(out: MeshBuilder, appearance: Appearance, quads: Array) -> None:
    """Add faces in the building's wall material."""
    out.quads(quads, material=appearance.material, tag=Tag.BUILDING, colour=appearance.tint)


def trim_faces(out: MeshBuilder, appearance: Appearance, quads: Array) -> None:
    """Add faces in the colour of its sills and cornices."""
    out.quads(quads, material=Material.CONCRETE, tag=Tag.BUILDING, colour=appearance.trim)
