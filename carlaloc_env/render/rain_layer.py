"""The layer of rain streaks that lies before a picture, drawn once per weather and instant."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.context import Programs, set_uniforms
from carlaloc_env.render.gbuffer import GBuffer
from carlaloc_env.render.rain import Streaks

Array = NDArray[np.float64]

_STREAK = np.dtype([("end", "<f4", 3), ("begin", "<f4", 3), ("light", "<f4", 4), ("diameter", "<f4")])


class RainLayer:
    """Draws streaks into a texture: their exposed light and, in alpha, how much they hide."""

    def __init__(self, context: moderngl.Context, programs: Programs) -> None:
        self._context = context
        self._program = programs.get("rain.vert", "rain.frag")
        self._buffer = context.buffer(reserve=4096 * _STREAK.itemsize, dynamic=True)
        self._array = self._bound()
        self._targets: dict[tuple[int, int], tuple[moderngl.Texture, moderngl.Framebuffer]] = {}

    def _bound(self) -> moderngl.VertexArray:
        content = (self._buffer, "3f4 3f4 4f4 1f4/i", "in_end", "in_begin", "in_light", "in_diameter")
        return self._context.vertex_array(self._program, [content])

    def draw(self, gbuffer: GBuffer, streaks: Streaks, light: Array) -> moderngl.Texture:
        """Texture of the streaks that are not hidden by surfaces.

        Args:
            gbuffer: The picture.
            streaks: Drops.
            light: Their exposed radiance, shape (N, 3).
        """
        camera, view = gbuffer.camera, gbuffer.view
        texture, framebuffer = self._target((camera.width_px, camera.height_px))
        rows = np.zeros(len(streaks), dtype=_STREAK)
        rows["end"], rows["begin"], rows["diameter"] = streaks.end_m, streaks.begin_m, streaks.diameter_m
        rows["light"][:, :3], rows["light"][:, 3] = light, streaks.opacity
        if rows.nbytes > self._buffer.size:
            self._array.release()
            self._buffer.release()
            self._buffer = self._context.buffer(reserve=2 * rows.nbytes, dynamic=True)
            self._array = self._bound()
        self._buffer.orphan()
        if len(rows):
            self._buffer.write(rows.tobytes())
        framebuffer.use()
        framebuffer.clear()
        gbuffer.shaded.depth.use(0)
        sx, sy, ox, oy = view.clip_scale
        set_uniforms(
            self._program,
            u_depth=0,
            u_rotation=view.R_camera_world.T.astype("<f4").tobytes(),
            u_clip=(sx, sy, ox, oy),
            u_size=(float(camera.width_px), float(camera.height_px)),
            u_focal=(camera.fx_px, camera.fy_px),
        )
        self._context.enable_only(moderngl.BLEND)
        self._context.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        if len(rows):
            self._array.render(moderngl.TRIANGLE_STRIP, vertices=4, instances=len(rows))
        self._context.enable_only(moderngl.NOTHING)
        return texture

    def _target(self, size_px: tuple[int, int]) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        if size_px not in self._targets:
            texture = self._context.texture(size_px, 4, dtype="f2")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            texture.repeat_x = texture.repeat_y = False
            self._targets[size_px] = (texture, self._context.framebuffer([texture]))
        return self._targets[size_px]

    def release(self) -> None:
        """Free the textures."""
        self._array.release()
        self._buffer.release()
        for texture, framebuffer in self._targets.values():
            framebuffer.release()
            texture.release()
