"""Shadows of the sun: a cached map of the static scene round the camera, and one of the actors."""

import math
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import cross
from carlaloc_env.render.geometry.geometry_pass import Casters
from carlaloc_env.render.geometry.static_scene import StaticScene
from carlaloc_env.render.shader_programs import Programs, set_uniforms
from carlaloc_env.render.views import CameraView

STATIC_SIZE_PX = 4096
"""Edge of the static map [px]."""
STATIC_EXTENT_M = 320.0
"""Edge length of the static map on the plane across the sunlight [m]: 7.8 cm per texel."""
STATIC_STEP_M = 40.0
"""Grid on which its centre lies [m], so that a drive needs a new map only now and then."""
STATIC_AHEAD_M = 80.0
"""How far its centre lies ahead of the camera [m]."""
ACTOR_EXTENT_M = 80.0
"""Edge length of the actors' map on the plane across the sunlight [m]."""
ACTOR_STEP_M = 5.0
"""Grid on which the centre of the actors' map lies [m]: a whole number of its texels."""
CACHED_MAPS = 2
"""Maps of each sort that are kept, those used last."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShadowMap:
    """A depth map, and the transform for lookups in it."""

    texture: moderngl.Texture
    framebuffer: moderngl.Framebuffer
    axes: Array
    """World axes to the light's right, up, away [m], shape (3, 3)."""
    origin_m: Array
    """World point at the centre of the map [m], shape (3,)."""
    half_extent_m: Array
    """Half edge lengths across and along the light [m], shape (3,)."""

    @property
    def clip(self) -> Array:
        """Rotation scaled to clip space −1…1, shape (3, 3)."""
        return self.axes / self.half_extent_m[:, None]

    def lookup(self, eye_m: Array) -> tuple[Array, Array]:
        """Matrix (3, 3) and offset (3,) from world offsets of the eye to texture coordinates 0…1."""
        matrix = 0.5 * self.clip
        return matrix, np.sum(matrix * (eye_m - self.origin_m), axis=1) + 0.5


def light_axes(sun_direction: Array) -> Array:
    """Right, up and away-from-the-sun axes of the sunlight in the world, shape (3, 3)."""
    away = -np.asarray(sun_direction, dtype=np.float64)
    aside = np.array([0.0, 0.0, 1.0]) if abs(away[2]) < 0.95 else np.array([0.0, 1.0, 0.0])
    right = cross(away, aside)
    right /= math.sqrt(float(np.sum(right**2)))
    return np.stack([right, cross(right, away), away])


def _may_shade(view: CameraView, sun_direction: Array, centre_m: Array, reach_m: Array) -> NDArray[np.bool_]:
    """Whether shadows of spheres (N, 3), (N, 1) that fall as far as these are wide may be in view, (N,)."""
    planes = view.planes()
    gap = np.sum(centre_m[:, None] * planes[:, :3], axis=2) + planes[:, 3]
    thrown = -np.sum(sun_direction * planes[:, :3], axis=1) * (2.0 * reach_m / max(sun_direction[2], 0.05))
    return np.asarray((gap + np.maximum(thrown, 0.0) > -reach_m).all(axis=1))


_Maps = OrderedDict[tuple[Any, ...], ShadowMap]
"""Maps that are kept, by what they show, the one used last at the end."""


class Shadows:
    """Makes and keeps the shadow maps of one scene."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        scenery: StaticScene,
        *,
        static_size_px: int = STATIC_SIZE_PX,
        actor_size_px: int = 1024,
        in_view: bool = False,
    ) -> None:
        """Make ready; with `in_view` actors count whose shadows may be seen: pictures then share no map."""
        self._context = context
        self._programs = programs
        self._scenery = scenery
        self._static_size_px, self._actor_size_px, self._in_view = static_size_px, actor_size_px, in_view
        self._maps: _Maps = OrderedDict()
        self._actor_maps: _Maps = OrderedDict()

    def static(self, view: CameraView, sun_direction: Array) -> ShadowMap:
        """Map of the static scene round a camera; made when the camera has left the last one.

        Its texels lie on a grid fixed to the world and its centre follows from the camera's pose
        alone, so that the same picture comes out in whatever order pictures are drawn.
        """
        axes = light_axes(sun_direction)
        ahead = view.R_camera_world[2] * np.array([1.0, 1.0, 0.0])
        ahead /= max(math.sqrt(float(np.sum(ahead**2))), 1e-6)
        focus = view.position_m + STATIC_AHEAD_M * ahead
        focus[2] = 0.0
        across = np.rint(np.sum(axes[:2] * focus, axis=1) / STATIC_STEP_M) * STATIC_STEP_M
        key = (*np.round(sun_direction, 6), *across)
        if key in self._maps:
            self._maps.move_to_end(key)
            return self._maps[key]
        result = self._maps[key] = self._blank_static(axes, across)
        centre = np.sum(axes * result.origin_m, axis=1)
        casting = self._scenery.casting(axes, centre - result.half_extent_m, centre + result.half_extent_m)
        program = self._programs.get("shadow.vert", "shadow.frag")
        self._begin(result, program)
        self._scenery.draw_bare(program, casting)
        self._end()
        return result

    def actors(self, view: CameraView, sun_direction: Array, casters: Casters) -> ShadowMap:
        """Map of the movable models near a camera; both eyes and all weathers of one sun share it.

        Its texels lie on a grid fixed to the world, and only models that reach into it are drawn.
        """
        ahead = view.R_camera_world[2] * np.array([1.0, 1.0, 0.0])
        half = ACTOR_EXTENT_M / 2
        axes = light_axes(sun_direction)
        across = np.sum(axes * (view.position_m + 25.0 * ahead), axis=1)
        across = np.rint(across / ACTOR_STEP_M) * ACTOR_STEP_M
        half_extent_m = np.array([half, half, 120.0])
        instances = casters.instances
        away = np.sum(axes * instances.T_world_model[:, None, :3, 3], axis=2) - across
        reach = casters.radius_m[instances.model][:, None]
        reaches = (np.abs(away) < half_extent_m + reach).all(axis=1)
        if self._in_view:
            reaches &= _may_shade(view, sun_direction, instances.T_world_model[:, :3, 3], reach)
        which = np.flatnonzero(reaches)
        drawn = (axes, across, instances.model[which], instances.T_world_model[which])
        key = tuple(part.tobytes() for part in drawn)
        if key in self._actor_maps:
            self._actor_maps.move_to_end(key)
            return self._actor_maps[key]
        texture, framebuffer = self._target(self._actor_maps, self._actor_size_px)
        result = self._actor_maps[key] = ShadowMap(
            texture=texture,
            framebuffer=framebuffer,
            axes=axes,
            origin_m=np.sum(axes * across[:, None], axis=0),
            half_extent_m=half_extent_m,
        )
        program = self._programs.get("shadow.vert", "shadow.frag", "INSTANCED")
        casters.poses.fill(instances, which)
        self._begin(result, program)
        casters.library.draw(program, casters.poses.used, bare=True, instances=casters.poses)
        self._end()
        return result

    def _blank_static(self, axes: Array, across: Array) -> ShadowMap:
        texture, framebuffer = self._target(self._maps, self._static_size_px)
        # Deep enough for everything that stands in the scene, whatever the camera's place.
        low, high = self._scenery.low_m, self._scenery.high_m
        reach = math.sqrt(float(np.sum((high - low) ** 2))) / 2 + 1.0
        along = float(np.sum(axes[2] * (low + high) / 2))
        half = STATIC_EXTENT_M / 2
        return ShadowMap(
            texture=texture,
            framebuffer=framebuffer,
            axes=axes,
            origin_m=axes[0] * across[0] + axes[1] * across[1] + axes[2] * along,
            half_extent_m=np.array([half, half, reach]),
        )

    def _target(self, kept: _Maps, size_px: int) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        """Target of a new map: that of the oldest kept one once there are `CACHED_MAPS` of them."""
        if len(kept) >= CACHED_MAPS:
            _, old = kept.popitem(last=False)
            return old.texture, old.framebuffer
        texture = self._context.depth_texture((size_px, size_px))
        texture.compare_func = "<="
        texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        texture.repeat_x = texture.repeat_y = False
        return texture, self._context.framebuffer(depth_attachment=texture)

    def _begin(self, result: ShadowMap, program: moderngl.Program) -> None:
        result.framebuffer.use()
        result.framebuffer.clear(depth=1.0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "<"
        self._context.polygon_offset = (2.0, 2.0)
        set_uniforms(program, u_light=result.clip.T.astype("<f4").tobytes(), u_origin=tuple(result.origin_m))

    def _end(self) -> None:
        self._context.polygon_offset = (0.0, 0.0)

    def release(self) -> None:
        """Free the maps."""
        for shadow in (*self._maps.values(), *self._actor_maps.values()):
            shadow.framebuffer.release()
            shadow.texture.release()
        self._maps.clear()
        self._actor_maps.clear()
