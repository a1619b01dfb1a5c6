"""Tiles of a picture, sorted by their content, and passes over some of them: one instanced quad a tile."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.jit import compiled
from carlaloc_env.render.growing_buffer import GrowingBuffer
from carlaloc_env.render.shader_programs import set_uniforms

TILE_PX = 32
"""Edge of a tile [px]."""
FEW_TILES = 16
"""Kinds of tiles of which there are fewer run all loops."""
TILE = np.dtype([("cell", "<u4", 2), ("lamps", "<u4", 2), ("beams", "<u4", 2), ("glows", "<u4", 2)])
"""One tile: column and row, then the first entry and the end of its lists."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthRange:
    """Nearest and farthest surface in every tile, planar [m]; nearest = inf where there is sky only."""

    near_m: Array
    """Shape (R, C)."""
    far_m: Array
    """Shape (R, C)."""
    sky: NDArray[np.bool_]
    """Whether some of the tile is sky, shape (R, C)."""

    @property
    def shown(self) -> NDArray[np.intp]:
        """Content of tiles, shape (R, C): surfaces only (0), surfaces and sky (1), sky only (2)."""
        return np.asarray(self.sky.astype(np.intp) + np.isinf(self.near_m))

    @classmethod
    def of(cls, depth_m: NDArray[np.float32]) -> DepthRange:
        """Ranges of a depth picture (H, W) with 0 = sky."""
        shape = tuple(-(-size // TILE_PX) for size in depth_m.shape)
        near, far, sky = np.empty(shape), np.empty(shape), np.empty(shape, bool)
        _depth_ranges(near, far, sky, depth_m, TILE_PX)
        return cls(near_m=near, far_m=far, sky=sky)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TileGroups:
    """Tiles of a picture, sorted by the features of the program that shades them."""

    tiles: NDArray[np.void]
    """`TILE` rows."""
    groups: dict[tuple[str, ...], tuple[int, int]]
    """By the features: first tile and how many; within a group first surfaces, at last the sky only."""
    shown: NDArray[np.intp]
    """Content of every tile, as in `DepthRange.shown`, shape (len(tiles),)."""

    @classmethod
    def sorted_by(
        cls,
        tiles: NDArray[np.void],
        kind: NDArray[np.intp],
        kinds: tuple[tuple[str, ...], ...],
        shown: NDArray[np.intp],
    ) -> TileGroups:
        """Sort tiles by the number of their kind, and those of a kind by what they show."""
        order = np.lexsort((shown, kind))
        ends = np.cumsum(np.bincount(kind, minlength=len(kinds)))
        return cls(
            tiles=tiles[order],
            groups={
                features: (int(end - many), int(many))
                for features, end, many in zip(kinds, ends, np.diff(ends, prepend=0), strict=True)
            },
            shown=shown[order],
        )

    def of(self, features: tuple[str, ...], shown: tuple[int, int]) -> tuple[int, int]:
        """First tile of a group, and how many, that show something between two of `DepthRange.shown`."""
        first, count = self.groups[features]
        low, high = np.searchsorted(self.shown[first : first + count], (shown[0], shown[1] + 1))
        return first + int(low), int(high - low)


def every_tile(shape: tuple[int, ...]) -> NDArray[np.void]:
    """All tiles of a picture of (R, C) of them, row by row, without lists."""
    rows, columns = shape
    tiles = np.zeros(rows * columns, dtype=TILE)
    tiles["cell"][:, 0] = np.tile(np.arange(columns), rows)
    tiles["cell"][:, 1] = np.repeat(np.arange(rows), columns)
    return tiles


@compiled
def _depth_ranges(
    near_m: Array, far_m: Array, sky: NDArray[np.bool_], depth_m: NDArray[np.float32], tile_px: int
) -> None:
    """Write the nearest and farthest surface of every tile [m], inf and 0 where there is sky only.

    Args:
        near_m: Shape (R, C).
        far_m: Shape (R, C).
        sky: Whether some of the tile is sky, shape (R, C).
        depth_m: Planar depth, 0 = sky, shape (H, W).
        tile_px: Edge of a tile [px].
    """
    near_m[:] = np.inf
    far_m[:] = 0.0
    sky[:] = False
    columns = depth_m.shape[1]
    for v in range(depth_m.shape[0]):
        row = v // tile_px
        for column in range(near_m.shape[1]):
            near, far, least = np.float32(np.inf), np.float32(0.0), np.float32(np.inf)
            for u in range(column * tile_px, min(column * tile_px + tile_px, columns)):
                depth = depth_m[v, u]
                far = max(far, depth)
                least = min(least, depth)
                near = min(near, depth if depth > 0.0 else np.float32(np.inf))
            near_m[row, column] = min(near_m[row, column], near)
            far_m[row, column] = max(far_m[row, column], far)
            sky[row, column] = sky[row, column] or least <= 0.0


class TileQuads:
    """Holds the tiles of a picture and runs fragment programs over ranges of them."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._tiles = GrowingBuffer(context, 4096 * TILE.itemsize)
        self._command = context.buffer(reserve=20, dynamic=True)
        self._arrays: dict[tuple[int, int], moderngl.VertexArray] = {}

    def hold(self, tiles: NDArray[np.void]) -> None:
        """Keep `TILE` rows for the next passes."""
        self._tiles.write(tiles.tobytes())

    def draw(self, program: moderngl.Program, first: int, count: int) -> None:
        """Run a program made of ``screen.vert`` with `TILES` over some of the tiles."""
        set_uniforms(program, u_tile=float(TILE_PX))
        if count:
            # A point, `count` tiles, no first point, `first` tile; the stride is five words.
            self._command.write(np.array([1, count, 0, first, 0], dtype="<u4").tobytes())
            self._array(program).render_indirect(self._command, mode=moderngl.POINTS, count=1)

    def _array(self, program: moderngl.Program) -> moderngl.VertexArray:
        tiles = self._tiles.buffer
        key = (program.glo, tiles.glo)
        if key not in self._arrays:
            names = ("in_cell", "in_lamps", "in_beams", "in_glows")
            layout = " ".join("2u4" if name in program else "8x" for name in names)
            used = [name for name in names if name in program]
            self._arrays[key] = self._context.vertex_array(program, [(tiles, f"{layout}/i", *used)])
        return self._arrays[key]

    def release(self) -> None:
        """Free the buffers."""
        for array in self._arrays.values():
            array.release()
        self._tiles.release()
        self._command.release()
