"""Passes over some tiles of a picture: one instanced quad a tile."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.gl.context import set_uniforms
from carlaloc_env.render.gl.growing_buffer import GrowingBuffer
from carlaloc_env.render.lighting.light_tiles.screen_tiles import TILE, TILE_PX


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
