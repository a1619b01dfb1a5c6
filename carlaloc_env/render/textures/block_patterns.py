"""Blocks of walls and pavements, by which the shader knows one block from the next.

A texture repeats after its tile; the shader gives each block of a front a tone of its own, and lays any of
the texture's panels or boards in each place.
"""

from dataclasses import dataclass

from carlaloc_env.scene.materials import Material


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockPattern:
    """Bricks, stones, slabs, panels or boards of one material."""

    columns: int
    """Blocks along a tile of the texture."""
    rows: int
    """Courses up a tile."""
    offset: float
    """How far each course begins after the one below, as a share of a block."""
    tone_range: float
    """Range of the blocks' tones, as a share of their mean."""
    cycles_per_m: float
    """Frequency of the blocks, from which their tones fade before they alias [1/m]."""
    shuffled: bool = False
    """Whether the shader lays any of the texture's blocks in each place. Such a texture has its blocks
    straight above each other; the shader sets the courses off."""


BLOCK_PATTERNS: dict[Material, BlockPattern] = {
    Material.ASHLAR: BlockPattern(columns=6, rows=12, offset=0.5, tone_range=0.18, cycles_per_m=1.7),
    Material.BRICK_BROWN: BlockPattern(columns=12, rows=34, offset=0.5, tone_range=0.30, cycles_per_m=4.7),
    Material.BRICK_RED: BlockPattern(columns=12, rows=34, offset=0.5, tone_range=0.30, cycles_per_m=4.7),
    Material.CONCRETE_PANEL: BlockPattern(
        columns=2, rows=4, offset=0.0, tone_range=0.14, cycles_per_m=0.7, shuffled=True
    ),
    Material.PAVEMENT: BlockPattern(columns=4, rows=6, offset=0.5, tone_range=0.12, cycles_per_m=1.4),
    Material.SIDING: BlockPattern(
        columns=1, rows=16, offset=0.37, tone_range=0.10, cycles_per_m=6.7, shuffled=True
    ),
}
"""Materials that are laid of equal blocks."""
