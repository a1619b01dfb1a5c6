"""Shading: from a G-buffer and a weather to light and to the picture."""

import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import Array
from carlaloc_env.render.geometry.gbuffer import GBuffer, Targets
from carlaloc_env.render.geometry.geometry_pass import Casters
from carlaloc_env.render.geometry.static_scene import StaticScene
from carlaloc_env.render.lighting.fixed_exposure import READ_NOISE_E, electrons, exposure_time_s
from carlaloc_env.render.lighting.light_sources import NO_LIGHTS, Lights
from carlaloc_env.render.lighting.light_tiles import DepthRange
from carlaloc_env.render.lighting.mirror import Mirror
from carlaloc_env.render.lighting.night_lighting import Night
from carlaloc_env.render.lighting.roof_heights import Roofs
from carlaloc_env.render.lighting.shading_passes import Cover, ShadingPasses
from carlaloc_env.render.lighting.shadow_maps import Shadows
from carlaloc_env.render.lighting.skies import Skies
from carlaloc_env.render.lighting.snow_map import SnowMap
from carlaloc_env.render.lighting.uniforms import (
    MIRROR,
    SNOW,
    Scene,
    bind_light,
    light_values,
    set_gbuffer_uniforms,
    set_shadow_uniforms,
    set_view_uniforms,
)
from carlaloc_env.render.rain_drops import Streaks, lit, streaks_before
from carlaloc_env.render.rain_layer import RainLayer
from carlaloc_env.render.shader_programs import Programs, set_uniforms
from carlaloc_env.render.views import CameraView
from carlaloc_env.road.wheel_tracks import WheelTracks
from carlaloc_env.scene.mesh import ModelLibrary
from carlaloc_env.weather.parameters import WeatherParameters

LIVE_SHADOWS: dict[str, Any] = {"static_size_px": 3072, "actor_size_px": 512, "in_view": True}
"""Shadow maps of a live window, which has a new static one drawn every few seconds."""


class Shader:
    """Shades G-buffers of one scene; keeps sky maps by weather and shadow maps by place."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        *,
        scenery: StaticScene,
        library: ModelLibrary,
        lamps_m: Array,
        tracks: Callable[[], WheelTracks],
        live: bool = False,
    ) -> None:
        """Make ready to shade.

        Args:
            context: Where it is drawn.
            programs: Shader programs of the context.
            scenery: All of the static scene.
            library: Movable models.
            lamps_m: Street lamps [m], shape (K, 3).
            tracks: Gives the lanes' wheel tracks, asked for when snow lies.
            live: Do with fewer shadow taps and without mirrors, for a live window.
        """
        self._context = context
        self._programs = programs
        self._live = live
        self._night = Night(context, library, lamps_m)
        self._depths: weakref.WeakKeyDictionary[GBuffer, DepthRange] = weakref.WeakKeyDictionary()
        self._shadows = (
            Shadows(context, programs, scenery, **(LIVE_SHADOWS if live else {})) if len(scenery) else None
        )
        self._rain = RainLayer()
        self._mirror = Mirror(context, programs)
        self._roofs = Roofs(context, programs, scenery)
        self._make_snow = partial(SnowMap, context, programs, scenery)
        self._tracks = tracks
        self._snow: SnowMap | None = None
        self._skies = Skies(context)
        self._arrays: dict[int, moderngl.VertexArray] = {}
        self._outputs: dict[tuple[int, ...], tuple[moderngl.Texture, moderngl.Framebuffer]] = {}

    def resolve(self, view: CameraView, drawn: Targets, resolved: Targets) -> None:
        """Average the samples of a G-buffer to one per pixel."""
        program = self._programs.get("screen.vert", "resolve.frag")
        set_view_uniforms(program, view)
        set_gbuffer_uniforms(program, drawn)
        resolved.framebuffer.use()
        self._context.enable_only(moderngl.NOTHING)
        self._triangle(program)

    def begin(
        self,
        gbuffer: GBuffer,
        weather: WeatherParameters,
        casters: Casters,
        stamp_ns: int,
        seed: int,
        slot: int = 0,
    ) -> Callable[[], NDArray[np.uint8]]:
        """Begin a picture; what is returned waits for it: dither, sRGB and opaque, shape (H, W, 4).

        It has to be called, inside the context, before the next picture of that size and slot is begun.
        """
        scene = self._scene(gbuffer, weather, stamp_ns, seed)
        texture, lights = self._run(scene, casters, linear=False, slot=slot)

        def finished() -> NDArray[np.uint8]:
            out = np.empty((gbuffer.camera.height_px, gbuffer.camera.width_px, 4), dtype=np.uint8)
            texture.read_into(out)
            if weather.falls:
                e = scene.sky.light.exposure
                drops, shine = self._drops(scene, lights, exposure_time_s(e))
                noise = (electrons(e), READ_NOISE_E) if weather.is_night else (0.0, 0.0)
                self._rain.over_image(
                    out, scene.view, scene.depth_m(), drops, shine * e, key=scene.key, electrons=noise
                )
            return out

        return finished

    def radiance_cd_m2(
        self, gbuffer: GBuffer, weather: WeatherParameters, casters: Casters, stamp_ns: int | None, seed: int
    ) -> NDArray[np.float32]:
        """Luminance before exposure [cd/m²], shape (H, W, 3)."""
        scene = self._scene(gbuffer, weather, stamp_ns or 0, seed)
        texture, lights = self._run(scene, casters, linear=True)
        out = np.empty((gbuffer.camera.height_px, gbuffer.camera.width_px, 4), dtype=np.float32)
        texture.read_into(out)
        e = scene.sky.light.exposure
        if weather.falls and stamp_ns is not None:
            drops, shine = self._drops(scene, lights, exposure_time_s(e))
            self._rain.over_radiance(out, scene.view, scene.depth_m(), drops, shine * e)
        return out[..., :3] / np.float32(e)

    def rain_cd_m2(
        self, gbuffer: GBuffer, weather: WeatherParameters, stamp_ns: int, seed: int, exposure_s: float
    ) -> NDArray[np.float32]:
        """Light of streaks [cd/m²] in three channels, and how much they hide in the fourth, (H, W, 4)."""
        scene, drops, shine = self.falling(gbuffer, weather, stamp_ns, seed, exposure_s)
        return self._rain.layer(scene.view, scene.depth_m(), drops, shine)

    def falling(
        self, gbuffer: GBuffer, weather: WeatherParameters, stamp_ns: int, seed: int, span_s: float
    ) -> tuple[Scene, Streaks, Array]:
        """What falls before a picture in a span that ends with it, and its luminance [cd/m²], (N, 3)."""
        scene = self._scene(gbuffer, weather, stamp_ns, seed)
        lights = self._night.lights(gbuffer) if weather.is_night else NO_LIGHTS
        return scene, *self._drops(scene, lights, span_s)

    def _scene(self, gbuffer: GBuffer, weather: WeatherParameters, stamp_ns: int, seed: int) -> Scene:
        return Scene(
            gbuffer=gbuffer,
            weather=weather,
            sky=self._skies.of(weather),
            key=_grain_key(gbuffer.view, stamp_ns, seed),
            seed=seed,
            stamp_ns=stamp_ns,
        )

    def _run(
        self, scene: Scene, casters: Casters, *, linear: bool, slot: int = 0
    ) -> tuple[moderngl.Texture, Lights]:
        """The picture without falling drops, and the lamps of the night that light it."""
        gbuffer, sun = scene.gbuffer, scene.sky.light.sun_direction
        resolved = gbuffer.shaded is not gbuffer.drawn
        features = self._features(scene, linear=linear, resolved=resolved)
        static = actors = None
        if self._shadows is not None and "SUN" in features:
            static = self._shadows.static(scene.view, sun)
        if self._shadows is not None and "ACTORS" in features:
            above = np.array([0.0, 0.0, 1.0])
            actors = self._shadows.actors(scene.view, above if static is None else sun, casters)
        grid = None
        if scene.weather.is_night:
            grid = self._night.prepare(scene, self._depths_of(scene), noisy=not linear)
        values = light_values(scene, self._roofs)
        if "SNOW" in features:
            self._snow = self._snow or self._make_snow(self._tracks())
            self._snow.texture.use(SNOW)
            values["u_snow_frame"] = self._snow.frame(scene.view.position_m)
        bind_light(scene, self._roofs)
        if "MIRROR" in features:
            self._mirrored(scene, values).use(MIRROR)
        texture, framebuffer = self._output(gbuffer, linear=linear, slot=slot)
        framebuffer.use()
        cover = None if grid is None else Cover(groups=grid.groups, draw=self._night.draw, view=scene.view)
        framebuffer.viewport = (0, 0, *((texture.width, texture.height) if cover is None else cover.size_px))
        framebuffer.depth_mask = False

        def prepare(program: moderngl.Program) -> None:
            set_gbuffer_uniforms(program, gbuffer.shaded)
            set_view_uniforms(program, scene.view)
            set_uniforms(program, **values)
            set_shadow_uniforms(program, scene.view, static=static, actors=actors)

        passes = ShadingPasses(self._context, self._programs, features, prepare, splits=not resolved)
        if cover is None:
            passes.whole(self._triangle)
        else:
            passes.tiles(cover)
        return texture, NO_LIGHTS if grid is None else grid.lights

    def _depths_of(self, scene: Scene) -> DepthRange:
        """Depths of a picture's tiles; all weathers share them."""
        if scene.gbuffer not in self._depths:
            self._depths[scene.gbuffer] = DepthRange.of(scene.depth_m())
        return self._depths[scene.gbuffer]

    def _features(self, scene: Scene, *, linear: bool, resolved: bool) -> tuple[str, ...]:
        weather = scene.weather
        sunny = bool(scene.sky.light.sun_lx.any()) and self._shadows is not None
        overcast = not sunny and not weather.is_night and self._shadows is not None
        wet = weather.surface_wetness > 0.05
        wanted = {
            "SUN": sunny,
            "OVERCAST": overcast,
            "ACTORS": sunny or overcast,
            "WET": wet,
            "SNOW": weather.snow_cover > 0.0,
            "MIRROR": wet and not self._live,
            "FEW_TAPS": self._live,
            "NIGHT": weather.is_night,
            "LINEAR": linear,
            "RESOLVED": resolved,
        }
        return tuple(name for name, on in wanted.items() if on)

    def _mirrored(self, scene: Scene, values: dict[str, object]) -> moderngl.Texture:
        def prepare(program: moderngl.Program) -> None:
            set_gbuffer_uniforms(program, scene.gbuffer.shaded)
            set_view_uniforms(program, scene.view)
            set_uniforms(program, **values)

        features = ("NIGHT_GLOW",) if scene.weather.is_night else ()
        return self._mirror.draw(scene.gbuffer, features, prepare, self._triangle)

    def _drops(self, scene: Scene, lights: Lights, exposure_s: float) -> tuple[Streaks, Array]:
        """Drops or flakes before a picture and their luminance [cd/m²], shape (N, 3)."""
        view = scene.view
        streaks = streaks_before(
            view,
            scene.weather,
            stamp_ns=scene.stamp_ns,
            seed=scene.seed,
            velocity_mps=view.velocity_mps,
            exposure_time_s=exposure_s,
        )
        streaks = streaks.take(np.flatnonzero(self._roofs.open_sky(streaks.end_m + view.position_m)))
        sky = scene.sky.round_cd_m2 if streaks.flakes else scene.sky.above_cd_m2
        return streaks, lit(streaks, view.position_m, sky, lights)

    def _output(
        self, gbuffer: GBuffer, *, linear: bool, slot: int
    ) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        size = (gbuffer.camera.width_px, gbuffer.camera.height_px)
        zbuffer = gbuffer.shaded.zbuffer
        key = (*size, int(linear), slot, 0 if zbuffer is None else zbuffer.glo)
        if key not in self._outputs:
            texture = self._context.texture(size, 4, dtype="f4" if linear else "f1")
            self._outputs[key] = (texture, self._context.framebuffer([texture], zbuffer))
        return self._outputs[key]

    def _triangle(self, program: moderngl.Program) -> None:
        if program.glo not in self._arrays:
            self._arrays[program.glo] = self._context.vertex_array(program, [])
        self._arrays[program.glo].render(moderngl.TRIANGLES, vertices=3)

    def release(self) -> None:
        """Free all textures."""
        if self._shadows is not None:
            self._shadows.release()
        self._skies.release()
        for texture, framebuffer in self._outputs.values():
            framebuffer.release()
            texture.release()
        for array in self._arrays.values():
            array.release()
        self._night.release()
        self._mirror.release()
        self._roofs.texture.release()
        if self._snow is not None:
            self._snow.texture.release()


def _grain_key(view: CameraView, stamp_ns: int, seed: int) -> int:
    """Key of a picture's dither and noise: other in every camera, since no two see the same photons."""
    x, y, z = (round(1e3 * float(value)) for value in view.position_m)
    return int(clock.stream(seed, f"render/grain/{x}/{y}/{z}", stamp_ns).integers(1 << 32))
