"""The lights of a night on the graphics side: uniform blocks, and one quad per tile of the picture."""

from __future__ import annotations

import math

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.context import set_uniforms
from carlaloc_env.render.gbuffer import GBuffer
from carlaloc_env.render.lights import (
    MOST_LIGHTS,
    Emitters,
    Lights,
    concatenate_lights,
    nearest,
    street_lamps,
)
from carlaloc_env.render.tiles import LIST_SIZE, TILE, TILE_PX, DepthRange, LightGrid, light_grid
from carlaloc_env.render.uniforms import Scene
from carlaloc_env.scene import ModelLibrary

FEATURES = (f"MOST_LIGHTS {MOST_LIGHTS}", f"LIST_SIZE {LIST_SIZE}", "TILES")
_LAMPS, _LISTS = 0, 1


class Night:
    """Finds the lights of pictures, and draws passes tile by tile with the lists of each."""

    def __init__(
        self, context: moderngl.Context, library: ModelLibrary, lamps_m: NDArray[np.float64]
    ) -> None:
        self._context = context
        self._emitters = Emitters(library)
        self._street = street_lamps(lamps_m)
        self._lamps = context.buffer(reserve=80 * MOST_LIGHTS, dynamic=True)
        self._lists = context.buffer(reserve=4 * LIST_SIZE, dynamic=True)
        self._tiles = context.buffer(reserve=4096 * TILE.itemsize, dynamic=True)
        self._command = context.buffer(reserve=20, dynamic=True)
        self._arrays: dict[tuple[int, int], moderngl.VertexArray] = {}

    def lights(self, gbuffer: GBuffer) -> Lights:
        """The lights round a camera that matter most."""
        lights = concatenate_lights([self._street, self._emitters.lights(gbuffer.actors)])
        return nearest(lights, gbuffer.view.position_m)

    def prepare(self, scene: Scene) -> LightGrid:
        """Find the lights of a picture and hold them for the next drawing."""
        eye_m, exposure = scene.view.position_m, scene.sky.light.exposure
        lights, depth_m = self.lights(scene.gbuffer), scene.depth_m()
        grid = light_grid(
            scene.view,
            lights,
            DepthRange.of(depth_m),
            scene.weather.extinction_per_m * exposure / 4.0,
            depth_m=depth_m,
            exposure=exposure,
            normal_codes=scene.normal_codes(),
        )
        rows = np.zeros((MOST_LIGHTS, 5, 4), dtype="<f4")
        n = len(lights)
        rows[:n, 0, :3], rows[:n, 0, 3] = lights.position_m - eye_m, 1.0 / lights.range_m**2
        rows[:n, 1, :3], rows[:n, 1, 3] = lights.colour_cd * (exposure / math.pi), lights.cap
        rows[:n, 2, :3], rows[:n, 2, 3] = lights.axis, lights.edge[:, 0]
        rows[:n, 3, :3], rows[:n, 3, 3] = lights.left, 1.0 / np.diff(lights.edge, axis=1)[:, 0]
        hue = lights.colour_cd / np.maximum(lights.colour_cd.max(axis=1, initial=0.0)[:, None], 1e-9)
        rows[:n, 4, :3] = hue * (lights.glow_cd * exposure / math.pi)[:, None]
        rows[:n, 4, 3] = 1.0 / np.maximum(grid.glow_range_m, 1e-3) ** 2
        self._write(self._lamps, rows.tobytes())
        self._write(self._lists, grid.entries.tobytes())
        if grid.tiles.nbytes > self._tiles.size:
            self._tiles = self._context.buffer(reserve=grid.tiles.nbytes, dynamic=True)
        self._write(self._tiles, grid.tiles.tobytes())
        return grid

    def draw(self, program: moderngl.Program, first: int, count: int) -> None:
        """Run a fragment program over some of the tiles."""
        for name, buffer, slot in (("Lamps", self._lamps, _LAMPS), ("Lists", self._lists, _LISTS)):
            block = program.get(name, None)
            if block is not None:
                block.binding = slot  # type: ignore[union-attr]
                buffer.bind_to_uniform_block(slot)
        set_uniforms(program, u_tile=float(TILE_PX))
        if count:
            # Four corners, `count` tiles, no first corner, `first` tile; the stride is five words.
            self._command.write(np.array([4, count, 0, first, 0], dtype="<u4").tobytes())
            self._array(program).render_indirect(self._command, mode=moderngl.TRIANGLE_STRIP, count=1)

    def _array(self, program: moderngl.Program) -> moderngl.VertexArray:
        key = (program.glo, self._tiles.glo)
        if key not in self._arrays:
            names = ("in_place", "in_lamps", "in_beams", "in_glows")
            layout = " ".join("2u4" if name in program else "8x" for name in names)
            used = [name for name in names if name in program]
            self._arrays[key] = self._context.vertex_array(program, [(self._tiles, f"{layout}/i", *used)])
        return self._arrays[key]

    @staticmethod
    def _write(buffer: moderngl.Buffer, data: bytes) -> None:
        buffer.orphan()
        if data:
            buffer.write(data)

    def release(self) -> None:
        """Free the buffers."""
        for array in self._arrays.values():
            array.release()
        for buffer in (self._lamps, self._lists, self._tiles, self._command):
            buffer.release()
