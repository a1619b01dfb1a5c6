"""The lights of a night on the graphics side: their table, and lists by tile."""

import math

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.geometry.gbuffer import GBuffer
from carlaloc_env.render.lighting.fixed_exposure import READ_NOISE_E, electrons
from carlaloc_env.render.lighting.light_grid import LIGHT_CUTOFF, Fog, LightGrid, light_grid
from carlaloc_env.render.lighting.light_sources import Lights, nearest, street_lamps
from carlaloc_env.render.lighting.light_table import LIST_COLUMNS, TEXELS, fog_lights, surface_lights
from carlaloc_env.render.lighting.light_tiles import (
    DepthRange,
    TileQuads,
)
from carlaloc_env.render.lighting.model_lamps import Emitters
from carlaloc_env.render.lighting.uniforms import FOG_FLOOR_M, Scene
from carlaloc_env.render.shader_programs import set_uniforms
from carlaloc_env.scene.mesh import ModelLibrary

_LISTS = 0
"""Slot of the image of the lists."""
UNSEEN_NOISE = 0.2
"""Largest change of light that stays invisible, in standard deviations of the noise."""


class Night:
    """Finds the lights of pictures, and draws passes tile by tile with the lists of each."""

    def __init__(
        self, context: moderngl.Context, library: ModelLibrary, lamps_m: NDArray[np.float64]
    ) -> None:
        self._context = context
        self._emitters = Emitters(library)
        self._street = street_lamps(lamps_m)
        self._lists = self._image(16)
        self._quads = TileQuads(context)

    def lights(self, gbuffer: GBuffer) -> Lights:
        """The lights round a camera that matter most."""
        lights = Lights.joined([self._street, self._emitters.lights(gbuffer.actors)])
        return nearest(lights, gbuffer.view.position_m)

    def prepare(self, scene: Scene, depths: DepthRange, *, noisy: bool) -> LightGrid:
        """Find the lights of a picture and hold them for the next drawing.

        Args:
            scene: The picture.
            depths: Of its tiles.
            noisy: Whether what is drawn has the noise of a camera, which hides faint light.
        """
        eye_m, exposure, weather = scene.view.position_m, scene.sky.light.exposure, scene.weather
        noise = READ_NOISE_E / electrons(exposure) if noisy else 0.0
        thinned = math.exp(-max(float(eye_m[2]), FOG_FLOOR_M) / weather.fog_scale_height_m)
        lights, depth_m = self.lights(scene.gbuffer), scene.depth_m()
        grid = light_grid(
            scene.view,
            lights,
            depths,
            exposure=exposure,
            fog=Fog(
                extinction_per_m=weather.uniform_extinction_per_m + weather.fog_extinction_per_m * thinned,
                start_m=weather.fog_distance,
            ),
            depth_m=depth_m,
            normal_codes=scene.normal_codes(),
            least=max(LIGHT_CUTOFF, UNSEEN_NOISE * noise),
        )
        glows = fog_lights(lights, eye_m, exposure, grid.glow_range_m)[grid.glows]
        table = np.concatenate([glows, surface_lights(lights, eye_m, exposure)[grid.lamps]])
        rows = -(-len(table) // LIST_COLUMNS)
        if rows > self._lists.height:
            self._lists.release()
            self._lists = self._image(rows)
        padded = np.zeros((rows * LIST_COLUMNS, 4 * TEXELS), np.float32)
        padded[: len(table)] = table
        self._lists.write(padded.tobytes(), viewport=(0, 0, TEXELS * LIST_COLUMNS, rows))
        self._quads.hold(grid.groups.tiles)
        return grid

    def draw(self, program: moderngl.Program, first: int, count: int) -> None:
        """Run a fragment program over some of the tiles."""
        self._lists.bind_to_image(_LISTS, read=True, write=False)
        set_uniforms(program, u_lists=_LISTS)
        self._quads.draw(program, first, count)

    def _image(self, rows: int) -> moderngl.Texture:
        return self._context.texture((TEXELS * LIST_COLUMNS, rows), 4, dtype="f4")

    def release(self) -> None:
        """Free the buffers."""
        self._lists.release()
        self._quads.release()
