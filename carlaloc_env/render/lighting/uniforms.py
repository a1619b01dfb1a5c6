"""Uniforms of shading programs: the view, the samples, the light and the air of one picture."""

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.geometry.gbuffer import GBuffer, Targets
from carlaloc_env.render.lighting.fixed_exposure import READ_NOISE_E, electrons
from carlaloc_env.render.lighting.roof_heights import Roofs
from carlaloc_env.render.lighting.shadow_maps import STATIC_EXTENT_M, ShadowMap
from carlaloc_env.render.lighting.skies import Sky
from carlaloc_env.render.shader_programs import set_uniforms
from carlaloc_env.render.views import CameraView
from carlaloc_env.weather.parameters import WeatherParameters
from carlaloc_env.weather.snow_patches import least_patch

FOG_FLOOR_M = -50.0
"""Height below which fog grows no denser [m]."""
RIPPLES_NS = 1_000_000_000_000
"""Period of the rings on puddles [ns]; shaders count time in single precision."""
ALBEDO, NORMAL, SURFACE, DEPTH, SKY, STATIC, ACTORS, ROOFS, MIRROR, SHEEN, SNOW = range(11)
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
        """View of the camera."""
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
    """Set the uniforms of the rays of pixels."""
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
        "u_snow_map": SNOW,
        "u_snow_from": least_patch(weather.snow_cover),
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
