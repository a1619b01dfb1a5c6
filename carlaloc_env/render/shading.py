"""Shading: from a G-buffer and a weather to light and to the picture."""

from __future__ import annotations

from collections import OrderedDict

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env import rng
from carlaloc_env.render.context import Programs, set_uniforms
from carlaloc_env.render.gbuffer import GBuffer, Targets
from carlaloc_env.render.lights import NO_LIGHTS
from carlaloc_env.render.mirror import Mirror
from carlaloc_env.render.night import FEATURES, Night
from carlaloc_env.render.projection import View
from carlaloc_env.render.rain import lit, rain_streaks
from carlaloc_env.render.rain_layer import RainLayer
from carlaloc_env.render.roofs import Roofs
from carlaloc_env.render.scenery import Scenery
from carlaloc_env.render.shadow import STATIC_EXTENT_M, STATIC_SIZE_PX, Casters, Shadows
from carlaloc_env.render.sky import READ_NOISE_E, SkyLight, electrons, exposure_time_s, sky_light
from carlaloc_env.render.tiles import LightGrid
from carlaloc_env.scene import ModelLibrary
from carlaloc_env.weather import WeatherParameters

Array = NDArray[np.float64]

CACHED_WEATHERS = 8
RIPPLES_NS = 1_000_000_000_000
"""Period of the rings on puddles [ns]; shaders count time in single precision."""

# Ramamoorthi and Hanrahan 2001, equation 13.
_C1, _C2, _C3, _C4, _C5 = 0.429043, 0.511664, 0.743125, 0.886227, 0.247708


class Shader:
    """Shades G-buffers of one scene; keeps sky maps by weather and shadow maps by place."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        *,
        scenery: Scenery,
        library: ModelLibrary,
        lamps_m: Array,
        live: bool = False,
    ) -> None:
        """Make ready to shade.

        Args:
            context: Where it is drawn.
            programs: Shader programs of the context.
            scenery: All of the static scene.
            library: Movable models.
            lamps_m: Street lamps [m], shape (K, 3).
            live: Do with fewer shadow taps and without mirrors, for a live window.
        """
        self._context = context
        self._programs = programs
        self._live = live
        self._night = Night(context, library, lamps_m)
        self._shadows = (
            Shadows(context, programs, scenery, actor_size_px=512 if live else 1024) if len(scenery) else None
        )
        self._rain = RainLayer(context, programs)
        self._mirror = Mirror(context, programs)
        self._roofs = Roofs(context, programs, scenery)
        self._arrays: dict[int, moderngl.VertexArray] = {}
        self._skies: OrderedDict[WeatherParameters, tuple[SkyLight, moderngl.Texture]] = OrderedDict()
        self._outputs: dict[tuple[int, ...], tuple[moderngl.Texture, moderngl.Framebuffer]] = {}

    def resolve(self, view: View, drawn: Targets, resolved: Targets) -> None:
        """Average the samples of a G-buffer to one per pixel."""
        program = self._programs.get("screen.vert", "resolve.frag")
        self._screen_uniforms(program, view)
        self._bind(program, drawn)
        resolved.framebuffer.use()
        self._context.enable_only(moderngl.NOTHING)
        self._triangle(program)

    def shade(
        self,
        gbuffer: GBuffer,
        weather: WeatherParameters,
        casters: Casters,
        stamp_ns: int,
        seed: int,
    ) -> NDArray[np.uint8]:
        """Picture with dither, sRGB and opaque, shape (H, W, 4)."""
        texture = self._run(gbuffer, weather, casters, stamp_ns, seed, linear=False)
        out = np.empty((gbuffer.camera.height_px, gbuffer.camera.width_px, 4), dtype=np.uint8)
        texture.read_into(out)
        return out

    def radiance_cd_m2(
        self,
        gbuffer: GBuffer,
        weather: WeatherParameters,
        casters: Casters,
        stamp_ns: int | None,
        seed: int,
    ) -> NDArray[np.float32]:
        """Luminance before exposure [cd/m²], shape (H, W, 3)."""
        texture = self._run(gbuffer, weather, casters, stamp_ns, seed, linear=True)
        out = np.empty((gbuffer.camera.height_px, gbuffer.camera.width_px, 4), dtype=np.float32)
        texture.read_into(out)
        return out[..., :3] / np.float32(self._sky(weather)[0].exposure)

    def rain_cd_m2(
        self, gbuffer: GBuffer, weather: WeatherParameters, stamp_ns: int, seed: int, exposure_s: float
    ) -> NDArray[np.float32]:
        """Light of streaks [cd/m²] in three channels, and how much they hide in the fourth, (H, W, 4)."""
        light, _ = self._sky(weather)
        grid = None
        if weather.is_night:
            grid = self._night.prepare(gbuffer, weather.extinction_per_m, light.exposure)
        texture = self._rain_texture(gbuffer, weather, light, grid, stamp_ns, seed, exposure_s)
        out = np.empty((gbuffer.camera.height_px, gbuffer.camera.width_px, 4), dtype=np.float16)
        texture.read_into(out)
        rain = out.astype(np.float32)
        rain[..., :3] /= np.float32(light.exposure)
        return rain

    def _run(
        self,
        gbuffer: GBuffer,
        weather: WeatherParameters,
        casters: Casters,
        stamp_ns: int | None,
        seed: int,
        *,
        linear: bool,
    ) -> moderngl.Texture:
        light, sky = self._sky(weather)
        falling = weather.precipitation > 0.0 and stamp_ns is not None
        stamp_ns = stamp_ns or 0
        key = _grain_key(gbuffer.view, stamp_ns, seed)
        resolved = gbuffer.shaded is not gbuffer.drawn
        features = self._features(weather, light, linear=linear, resolved=resolved, falling=falling)
        program = self._programs.get("screen.vert", "shade.frag", *features)
        view = gbuffer.view
        if "SUN" in features:
            self._sun_uniforms(program, view, light)
        if "ACTORS" in features:
            direction = light.sun_direction if "SUN" in features else np.array([0.0, 0.0, 1.0])
            self._actor_uniforms(program, view, direction, casters)
        grid = None
        if weather.is_night:
            grid = self._night.prepare(gbuffer, weather.extinction_per_m, light.exposure)
        if "RAIN" in features:
            exposure_s = exposure_time_s(light.exposure)
            self._rain_texture(gbuffer, weather, light, grid, stamp_ns, seed, exposure_s).use(8)
        if "MIRROR" in features:
            self._mirrored(gbuffer, weather, light, key, stamp_ns).use(9)
        self._bind(program, gbuffer.shaded)
        sky.use(4)
        self._roofs.texture.use(7)
        self._screen_uniforms(program, view)
        self._light_uniforms(program, gbuffer, weather, light, key, stamp_ns)
        texture, framebuffer = self._output(gbuffer, linear=linear)
        framebuffer.use()
        # The depth test splits the picture: surfaces lie before the triangle, the sky on it.
        framebuffer.depth_mask = False
        self._context.enable_only(moderngl.NOTHING if resolved else moderngl.DEPTH_TEST)
        self._context.depth_func = ">"
        if grid is None:
            self._triangle(program)
        else:
            self._night.draw(program, 0, grid.plain)
            program = self._programs.get("screen.vert", "shade.frag", *features, "BEAMS")
            self._bind(program, gbuffer.shaded)
            self._screen_uniforms(program, view)
            self._light_uniforms(program, gbuffer, weather, light, key, stamp_ns)
            self._night.draw(program, grid.plain, len(grid.tiles) - grid.plain)
        if resolved:
            return texture
        shared = [name for name in features if name not in ("SUN", "WET")]
        program = self._programs.get("screen.vert", "sky.frag", *shared)
        self._screen_uniforms(program, view)
        self._light_uniforms(program, gbuffer, weather, light, key, stamp_ns)
        self._context.depth_func = "=="
        if grid is None:
            self._triangle(program)
        else:
            self._night.draw(program, 0, len(grid.tiles))
        return texture

    def _features(
        self, weather: WeatherParameters, light: SkyLight, *, linear: bool, resolved: bool, falling: bool
    ) -> tuple[str, ...]:
        sunny = bool(light.sun_lx.any()) and self._shadows is not None
        overcast = not sunny and not weather.is_night and self._shadows is not None
        wet = weather.surface_wetness > 0.05
        wanted = {
            "SUN": sunny,
            "OVERCAST": overcast,
            "ACTORS": sunny or overcast,
            "WET": wet,
            "MIRROR": wet and not self._live,
            "FEW_TAPS": self._live,
            "NIGHT": weather.is_night,
            "RAIN": falling,
            "LINEAR": linear,
            "RESOLVED": resolved,
        }
        return (*(FEATURES if weather.is_night else ()), *(name for name, on in wanted.items() if on))

    def _mirrored(
        self, gbuffer: GBuffer, weather: WeatherParameters, light: SkyLight, key: int, stamp_ns: int
    ) -> moderngl.Texture:
        def prepare(program: moderngl.Program) -> None:
            self._bind(program, gbuffer.shaded)
            self._screen_uniforms(program, gbuffer.view)
            self._light_uniforms(program, gbuffer, weather, light, key, stamp_ns)

        features = ("NIGHT_GLOW",) if weather.is_night else ()
        return self._mirror.draw(gbuffer, features, prepare, self._triangle)

    def _rain_texture(
        self,
        gbuffer: GBuffer,
        weather: WeatherParameters,
        light: SkyLight,
        grid: LightGrid | None,
        stamp_ns: int,
        seed: int,
        exposure_s: float,
    ) -> moderngl.Texture:
        view = gbuffer.view
        streaks = rain_streaks(
            view,
            weather,
            stamp_ns=stamp_ns,
            seed=seed,
            velocity_mps=view.velocity_mps,
            exposure_time_s=exposure_s,
        )
        streaks = streaks.take(np.flatnonzero(self._roofs.open_sky(streaks.end_m + view.position_m)))
        above = np.maximum(np.sum(_polynomial(light.irradiance)[[0, 2, 6]], axis=0), 0.0) / np.pi
        lamps = NO_LIGHTS if grid is None else grid.lights
        shine = lit(streaks, view.position_m, above, lamps) * light.exposure
        return self._rain.draw(gbuffer, streaks, shine)

    def _sky(self, weather: WeatherParameters) -> tuple[SkyLight, moderngl.Texture]:
        if weather in self._skies:
            self._skies.move_to_end(weather)
            return self._skies[weather]
        light = sky_light(weather)
        exposed = np.ones((*light.sky_cd_m2.shape[:2], 4), dtype=np.float16)
        exposed[..., :3] = light.sky_cd_m2 * light.exposure
        texture = self._context.texture(exposed.shape[1::-1], 4, exposed.tobytes(), dtype="f2")
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_NEAREST, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        self._skies[weather] = (light, texture)
        if len(self._skies) > CACHED_WEATHERS:
            self._skies.popitem(last=False)[1][1].release()
        return self._skies[weather]

    def _bind(self, program: moderngl.Program, targets: Targets) -> None:
        targets.albedo.use(0)
        targets.normal.use(1)
        targets.surface.use(2)
        targets.depth.use(3)
        set_uniforms(program, u_albedo=0, u_normal=1, u_surface=2, u_depth=3, u_sky=4)

    def _screen_uniforms(self, program: moderngl.Program, view: View) -> None:
        c = view.camera
        set_uniforms(
            program,
            u_unproject=(1 / c.fx_px, 1 / c.fy_px, -c.cx_px / c.fx_px, -c.cy_px / c.fy_px),
            u_size=(float(c.width_px), float(c.height_px)),
            u_rotation=view.R_camera_world.astype("<f4").tobytes(),
            u_eye=tuple(view.position_m),
        )

    def _light_uniforms(
        self,
        program: moderngl.Program,
        gbuffer: GBuffer,
        weather: WeatherParameters,
        light: SkyLight,
        key: int,
        stamp_ns: int,
    ) -> None:
        e, view = light.exposure, gbuffer.view
        ambient = _polynomial(light.irradiance) * (e / np.pi)
        ripples = 1.0 + stamp_ns % RIPPLES_NS * 1e-9 if weather.precipitation > 0.0 else 0.0
        set_uniforms(
            program,
            u_sky=4,
            u_fog_light=tuple(light.fog_cd_m2 * e),
            u_air=(
                weather.fog_extinction_per_m,
                1.0 / weather.fog_scale_height_m,
                weather.fog_distance,
                weather.uniform_extinction_per_m,
            ),
            u_dither=key,
            u_electrons=(electrons(e), READ_NOISE_E),
            u_ambient=ambient.astype("<f4").tobytes(),
            u_wall_light=tuple(ambient[0]),
            u_ground=tuple(light.ground_cd_m2 * e),
            u_exposure=e,
            u_sun=tuple(light.sun_direction),
            u_sun_light=tuple(light.sun_lx * (e / np.pi)),
            u_texel=STATIC_EXTENT_M / STATIC_SIZE_PX,
            u_shadow_step=1.0 / STATIC_SIZE_PX,
            u_roofs=7,
            u_rain=8,
            u_mirror=9,
            u_ripples=ripples,
            u_roofs_frame=self._roofs.frame(view.position_m),
            u_wet=(weather.surface_wetness, 0.80 - 0.30 * weather.precipitation_deposits / 100.0),
        )

    def _sun_uniforms(self, program: moderngl.Program, view: View, light: SkyLight) -> None:
        assert self._shadows is not None
        static = self._shadows.static(view, light.sun_direction)
        static.texture.use(5)
        matrix, offset = static.lookup(view.position_m)
        set_uniforms(program, u_shadow=5, u_light=matrix.T.astype("<f4").tobytes(), u_light_eye=tuple(offset))

    def _actor_uniforms(
        self,
        program: moderngl.Program,
        view: View,
        direction: Array,
        casters: Casters,
    ) -> None:
        assert self._shadows is not None
        actors = self._shadows.actors(view, direction, casters)
        actors.texture.use(6)
        matrix, offset = actors.lookup(view.position_m)
        set_uniforms(
            program,
            u_shadow_actors=6,
            u_light_actors=matrix.T.astype("<f4").tobytes(),
            u_light_actors_eye=tuple(offset),
        )

    def _output(self, gbuffer: GBuffer, *, linear: bool) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        size = (gbuffer.camera.width_px, gbuffer.camera.height_px)
        zbuffer = gbuffer.shaded.zbuffer
        key = (*size, int(linear), 0 if zbuffer is None else zbuffer.glo)
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
        for _, texture in self._skies.values():
            texture.release()
        for texture, framebuffer in self._outputs.values():
            framebuffer.release()
            texture.release()
        for array in self._arrays.values():
            array.release()
        self._night.release()
        self._rain.release()
        self._mirror.release()
        self._roofs.texture.release()


def _grain_key(view: View, stamp_ns: int, seed: int) -> int:
    """Key of a picture's dither and noise: other in every camera, since no two see the same photons."""
    x, y, z = (round(1e3 * float(value)) for value in view.position_m)
    return int(rng.stream(seed, f"render/grain/{x}/{y}/{z}", stamp_ns).integers(1 << 32))


def _polynomial(harmonics: Array) -> Array:
    """Irradiance as a polynomial in the normal: 1 y z x xy yz z² xz x²−y², shape (9, 3)."""
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = harmonics
    return np.stack(
        [
            _C4 * l00 - _C5 * l20,
            2 * _C2 * l1m1,
            2 * _C2 * l10,
            2 * _C2 * l11,
            2 * _C1 * l2m2,
            2 * _C1 * l2m1,
            _C3 * l20,
            2 * _C1 * l21,
            _C1 * l22,
        ]
    )
