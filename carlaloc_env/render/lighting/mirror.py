"""Reflections of the scene in wet level ground, at a third of the picture's columns and rows.

Grains of the ground smear them, so that they need not be as fine as the picture.
"""

from collections.abc import Callable

import moderngl
import numpy as np

from carlaloc_env.render.geometry.gbuffer import GBuffer
from carlaloc_env.render.shader_programs import Programs
from carlaloc_env.render.views import CameraView

COLUMN_PX, ROW_PX = 3, 3
"""Pixels of the picture for one of the mirror's."""
SMEAR = 9.0
"""Level of the mirror by the roughness of the ground: film on asphalt smears it over about a degree."""
LEVELS = 5
"""Halvings of the mirror, which stand for smears of rough ground."""
_MARGIN = 0.03
"""How far above the horizon ground is still looked for, as a share of the picture's height."""


class Mirror:
    """Draws what wet ground mirrors of the scene round it."""

    def __init__(self, context: moderngl.Context, programs: Programs) -> None:
        self._context = context
        self._programs = programs
        self._targets: dict[tuple[int, int], tuple[moderngl.Texture, moderngl.Framebuffer]] = {}

    def draw(
        self,
        gbuffer: GBuffer,
        features: tuple[str, ...],
        prepare: Callable[[moderngl.Program], None],
        triangle: Callable[[moderngl.Program], None],
    ) -> moderngl.Texture:
        """Texture of the mirrored light; its alpha is where the mirrored ray meets the scene.

        Args:
            gbuffer: The picture.
            features: Features of the shader.
            prepare: Sets the uniforms of the program.
            triangle: Draws a triangle over everything.
        """
        camera = gbuffer.camera
        size_px = -(-camera.width_px // COLUMN_PX), -(-camera.height_px // ROW_PX)
        texture, framebuffer = self._target(size_px)
        framebuffer.use()
        framebuffer.clear()
        scale = f"COLUMN_PX {COLUMN_PX}", f"ROW_PX {ROW_PX}"
        program = self._programs.get("screen.vert", "mirror.frag", *scale, *features)
        prepare(program)
        top = round(texture.height * max(horizon(gbuffer.view) - _MARGIN, 0.0))
        self._context.enable_only(moderngl.NOTHING)
        if top < texture.height:
            framebuffer.scissor = (0, top, texture.width, texture.height - top)
            triangle(program)
            framebuffer.scissor = (0, 0, texture.width, texture.height)
        texture.build_mipmaps(max_level=LEVELS)
        return texture

    def _target(self, size_px: tuple[int, int]) -> tuple[moderngl.Texture, moderngl.Framebuffer]:
        if size_px not in self._targets:
            texture = self._context.texture(size_px, 4, dtype="f2")
            texture.build_mipmaps(max_level=LEVELS)
            texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
            texture.repeat_x = texture.repeat_y = False
            self._targets[size_px] = (texture, self._context.framebuffer([texture]))
        return self._targets[size_px]

    def release(self) -> None:
        """Free the textures."""
        for texture, framebuffer in self._targets.values():
            framebuffer.release()
            texture.release()


def horizon(view: CameraView) -> float:
    """Height of the horizon's highest end at the left or right edge, as a share of the picture's height."""
    camera = view.camera
    edges = np.array([-camera.cx_px, camera.width_px - camera.cx_px]) / camera.fx_px
    right, down, ahead = view.R_camera_world[:, 2]
    if abs(down) < 1e-3:
        return 0.0
    # The rays (x, y, 1) with no upward part: right · x + down · y + ahead = 0.
    rows = (-(right * edges + ahead) / down) * camera.fy_px + camera.cy_px
    return float(np.min(rows)) / camera.height_px
