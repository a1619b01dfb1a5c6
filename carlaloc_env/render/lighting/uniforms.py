"""Uniforms of shading programs: the view, the samples, the light and the air of one picture.

The light of weathers on the graphics side: one sky map each, and what it gives to surfaces.

How deep a place lies below its surroundings: a cheap stand-in for ambient occlusion.

The static scene is drawn once from straight above. The blurred height of the highest surfaces, less the
height of a point, measures how much of the sky walls, bridges and trees hide from it.
"""

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.geometry.gbuffer import GBuffer, Targets
from carlaloc_env.render.geometry.static_scene import StaticScene
from carlaloc_env.render.gl_context import Programs, is_software, set_uniforms
from carlaloc_env.render.lighting.shadow_maps import STATIC_EXTENT_M, ShadowMap
from carlaloc_env.render.lighting.sky_model import READ_NOISE_E, SkyLight, electrons, sky_light
from carlaloc_env.render.views import CameraView
from carlaloc_env.weather.parameters import WeatherParameters

SIZE_PX = 1024
"""Edge of the height map [px]."""
CELL_MIN_M = 0.75
"""Smallest edge of a cell [m]; large towns have larger ones."""
BLUR_M = 3.5
"""Standard deviation of the blur [m]."""


class Roofs:
    """Map of the blurred height of the highest surfaces of a scene."""

    def __init__(self, context: moderngl.Context, programs: Programs, scenery: StaticScene) -> None:
        if len(scenery):
            low, high = scenery.low_m, scenery.high_m
            self._centre_m = (low + high) / 2
            self._half_m = max(float(np.max(high[:2] - low[:2])) / 2, CELL_MIN_M * SIZE_PX / 2)
            height = self._draw(context, programs, scenery, (high[2] - low[2]) / 2 + 1.0)
        else:
            self._centre_m, self._half_m = np.zeros(3), 1.0
            height = np.full((4, 4), -1e3, dtype=np.float32)
        self._height_m = height
        cell_m = 2 * self._half_m / SIZE_PX
        blurred = cv2.GaussianBlur(height, (0, 0), BLUR_M / cell_m)
        self.texture = context.texture(height.shape[::-1], 1, blurred.tobytes(), dtype="f4")
        self.texture.repeat_x = self.texture.repeat_y = False

    def frame(self, eye_m: Array) -> tuple[float, float, float, float]:
        """Scale (2) and offset (2) from horizontal offsets of the eye [m] to texture coordinates."""
        scale = 0.5 / self._half_m
        x, y = (eye_m[:2] - self._centre_m[:2]) * scale + 0.5
        return (scale, scale, float(x), float(y))

    def open_sky(self, points_m: Array) -> NDArray[np.bool_]:
        """Whether nothing of the static scene is above points of the world (N, 3) [m], shape (N,)."""
        size = self._height_m.shape[0]
        at = (points_m[:, :2] - self._centre_m[:2]) * (0.5 / self._half_m) + 0.5
        cell = np.clip((at * size).astype(np.int64), 0, size - 1)
        return np.asarray(points_m[:, 2] > self._height_m[cell[:, 1], cell[:, 0]])

    def _draw(
        self, context: moderngl.Context, programs: Programs, scenery: StaticScene, half_height_m: float
    ) -> NDArray[np.float32]:
        """Height of the highest surface in each cell [m], row = north, column = east."""
        texture = context.depth_texture((SIZE_PX, SIZE_PX))
        framebuffer = context.framebuffer(depth_attachment=texture)
        framebuffer.use()
        framebuffer.clear(depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        program = programs.get("shadow.vert", "shadow.frag")
        down = np.diag([1.0 / self._half_m, 1.0 / self._half_m, -1.0 / half_height_m])
        set_uniforms(program, u_light=down.T.astype("<f4").tobytes(), u_origin=tuple(self._centre_m))
        everywhere = np.full(3, np.inf)
        scenery.draw_bare(program, scenery.casting(np.eye(3), -everywhere, everywhere))
        depth = np.frombuffer(texture.read(), dtype=np.float32).reshape(SIZE_PX, SIZE_PX)
        framebuffer.release()
        texture.release()
        height = self._centre_m[2] + half_height_m * (1.0 - 2.0 * depth)
        return np.asarray(height, dtype=np.float32)


CACHED_WEATHERS = 8
"""Weathers whose skies are kept, those used last."""
_C1, _C2, _C3, _C4, _C5 = 0.429043, 0.511664, 0.743125, 0.886227, 0.247708
"""Factors of harmonics in irradiance (Ramamoorthi and Hanrahan 2001, equation 13)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sky:
    """A weather's light, ready for the shaders."""

    light: SkyLight
    polynomial: Array
    """Irradiance [lx] by the normal: 1 y z x xy yz z² xz x²−y², shape (9, 3)."""
    texture: moderngl.Texture
    """Exposed luminance of the upper half-sphere in hemi-octahedral layout."""
    mirrored: moderngl.Texture
    """The same for reflections, blurred more by every level: root of the share of `brightest`, 8 bits."""
    brightest: float
    """Exposed luminance that `mirrored` has as 1."""

    @property
    def above_cd_m2(self) -> Array:
        """Mean luminance over the upper half-sphere, weighted by height, shape (3,)."""
        return np.asarray(np.maximum(np.sum(self.polynomial[[0, 2, 6]], axis=0), 0.0) / np.pi)


class Skies:
    """Makes and keeps the skies of the weathers used last."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._kept: OrderedDict[WeatherParameters, Sky] = OrderedDict()

    def of(self, weather: WeatherParameters) -> Sky:
        """The sky of a weather."""
        if weather in self._kept:
            self._kept.move_to_end(weather)
            return self._kept[weather]
        light = sky_light(weather)
        exposed = np.ones((*light.sky_cd_m2.shape[:2], 4), dtype=np.float32)
        exposed[..., :3] = (light.sky_cd_m2 + light.sun_cd_m2) * light.exposure
        texture = self._context.texture(exposed.shape[1::-1], 4, exposed.astype("f2").tobytes(), dtype="f2")
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        # Surfaces mirror the sun as a light of its own.
        exposed[..., :3] = light.sky_cd_m2 * light.exposure
        brightest = max(float(exposed[..., :3].max()), 1e-6)
        self._kept[weather] = Sky(
            light=light,
            polynomial=_polynomial(light.irradiance),
            texture=texture,
            mirrored=self._mirrored(exposed / brightest),
            brightest=brightest,
        )
        if len(self._kept) > CACHED_WEATHERS:
            _, old = self._kept.popitem(last=False)
            old.texture.release()
            old.mirrored.release()
        return self._kept[weather]

    def _mirrored(self, share: NDArray[Any]) -> moderngl.Texture:
        """Texture of 8 bits with all its levels, which a CPU reads in half the time of one of 16."""
        texture = self._context.texture(share.shape[1::-1], 4)
        texture.build_mipmaps()
        # Texels are a third of a degree wide: a CPU does without the mean of four, half of what a look costs.
        between = (moderngl.NEAREST_MIPMAP_NEAREST, moderngl.NEAREST)
        smooth = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        texture.filter = between if is_software(self._context) else smooth
        texture.repeat_x = texture.repeat_y = False
        for level in range(share.shape[0].bit_length()):
            codes = np.rint(255.0 * np.sqrt(np.clip(share, 0.0, 1.0))).astype(np.uint8)
            texture.write(codes.tobytes(), level=level)
            if len(share) > 1:
                share = 0.25 * (share[::2, ::2] + share[1::2, ::2] + share[::2, 1::2] + share[1::2, 1::2])
        return texture

    def release(self) -> None:
        """Free all textures."""
        for sky in self._kept.values():
            sky.texture.release()
            sky.mirrored.release()


def _polynomial(harmonics: Array) -> Array:
    """Irradiance as a polynomial in the normal: 1 y z x xy yz z² xz x²−y², shape (9, 3)."""
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = harmonics
    linear = (2 * _C2 * factor for factor in (l1m1, l10, l11))
    square = (2 * _C1 * l2m2, 2 * _C1 * l2m1, _C3 * l20, 2 * _C1 * l21, _C1 * l22)
    return np.stack([_C4 * l00 - _C5 * l20, *linear, *square])


FOG_FLOOR_M = -50.0
"""Height below which fog grows no denser [m]."""
RIPPLES_NS = 1_000_000_000_000
"""Period of the rings on puddles [ns]; shaders count time in single precision."""
ALBEDO, NORMAL, SURFACE, DEPTH, SKY, STATIC, ACTORS, ROOFS, MIRROR, SHEEN = range(10)
"""Slots of the textures."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """One picture under one weather."""

    gbuffer: GBuffer
    weather: WeatherParameters
    sky: Sky
    key: int
    """Of its dither and its noise."""
    seed: int
    """Of the rain."""
    stamp_ns: int

    @property
    def view(self) -> CameraView:
        """Where it is seen from."""
        return self.gbuffer.view

    def depth_m(self) -> NDArray[np.float32]:
        """Planar depth of what is shaded [m], 0 = sky, shape (H, W)."""
        return self.gbuffer.shaded_depth_m()

    def normal_codes(self) -> NDArray[np.uint16]:
        """Octahedral world normals of what is shaded, shape (H, W, 2)."""
        return self.gbuffer.shaded_normal_codes()


def set_gbuffer_uniforms(program: moderngl.Program, targets: Targets) -> None:
    """Bind the textures of a G-buffer."""
    for slot, texture in enumerate((targets.albedo, targets.normal, targets.surface, targets.depth)):
        texture.use(slot)
    set_uniforms(program, u_albedo=ALBEDO, u_normal=NORMAL, u_surface=SURFACE, u_depth=DEPTH)


def set_view_uniforms(program: moderngl.Program, view: CameraView) -> None:
    """Where the rays of the pixels go."""
    c = view.camera
    right, down, ahead = view.R_camera_world
    right, down = right / c.fx_px, down / c.fy_px
    # Pixels are counted at their centres by cameras, at their corners by the shaders.
    first = ahead - (c.cx_px + 0.5) * right - (c.cy_px + 0.5) * down
    set_uniforms(
        program,
        u_unproject=view.unproject,
        u_size=(float(c.width_px), float(c.height_px)),
        u_rotation=view.R_camera_world.astype("<f4").tobytes(),
        u_eye=tuple(view.position_m),
        u_ray_first=tuple(first),
        u_ray_right=tuple(right),
        u_ray_down=tuple(down),
    )


def light_values(scene: Scene, roofs: Roofs) -> dict[str, object]:
    """Uniforms by name: sky, air, wetness and exposure of a weather."""
    weather, light = scene.weather, scene.sky.light
    e = light.exposure
    ambient = scene.sky.polynomial * (e / np.pi)
    ripples = 1.0 + scene.stamp_ns % RIPPLES_NS * 1e-9 if weather.precipitation > 0.0 else 0.0
    return {
        "u_sky": SKY,
        "u_sheen": SHEEN,
        "u_brightest": scene.sky.brightest,
        "u_roofs": ROOFS,
        "u_mirror": MIRROR,
        "u_fog_light": tuple(light.fog_cd_m2 * e),
        "u_air": (
            weather.fog_extinction_per_m,
            1.0 / weather.fog_scale_height_m,
            weather.fog_distance,
            weather.uniform_extinction_per_m,
        ),
        "u_dither": scene.key,
        "u_noise": (1.0 / electrons(e), (READ_NOISE_E / electrons(e)) ** 2),
        "u_ambient": ambient.astype("<f4").tobytes(),
        "u_wall_light": tuple(ambient[0]),
        "u_ground": tuple(light.ground_cd_m2 * e),
        "u_exposure": e,
        "u_sun": tuple(light.sun_direction),
        "u_sun_light": tuple(light.sun_lx * (e / np.pi)),
        "u_ripples": ripples,
        "u_roofs_frame": roofs.frame(scene.view.position_m),
        "u_wet": (weather.surface_wetness, 0.80 - 0.30 * weather.precipitation_deposits / 100.0),
    }


def bind_light(scene: Scene, roofs: Roofs) -> None:
    """Put the textures of a weather's light into their slots."""
    scene.sky.texture.use(SKY)
    scene.sky.mirrored.use(SHEEN)
    roofs.texture.use(ROOFS)


def set_shadow_uniforms(
    program: moderngl.Program, view: CameraView, *, static: ShadowMap | None, actors: ShadowMap | None
) -> None:
    """Bind shadow maps, and set how programs look them up."""
    if static is not None:
        static.texture.use(STATIC)
        matrix, offset = static.lookup(view.position_m)
        set_uniforms(
            program,
            u_shadow=STATIC,
            u_light=_bytes(matrix),
            u_light_eye=tuple(offset),
            u_texel=STATIC_EXTENT_M / static.texture.width,
            u_shadow_step=1.0 / static.texture.width,
        )
    if actors is not None:
        actors.texture.use(ACTORS)
        matrix, offset = actors.lookup(view.position_m)
        set_uniforms(
            program, u_shadow_actors=ACTORS, u_light_actors=_bytes(matrix), u_light_actors_eye=tuple(offset)
        )


def _bytes(matrix: NDArray[np.float64]) -> bytes:
    """Columns first, as the shaders want them."""
    return matrix.T.astype("<f4").tobytes()
