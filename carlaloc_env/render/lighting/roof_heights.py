"""Depth of places below their surroundings: a cheap stand-in for ambient occlusion.

The static scene is drawn once from straight above. The blurred height of the highest surfaces, less the
height of a point, measures how much of the sky walls, bridges and trees hide from it.
"""

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.geometry.static_scene import StaticScene
from carlaloc_env.render.shader_programs import Programs, set_uniforms
from carlaloc_env.scene.materials import Material

SIZE_PX = 1024
"""Edge of the height map [px]."""
CELL_MIN_M = 0.75
"""Smallest edge of a cell [m]; large towns have larger ones."""
BLUR_M = 3.5
"""Standard deviation of the blur [m]."""


class Roofs:
    """Map of the blurred height of the highest surfaces of a scene."""

    def __init__(
        self, context: moderngl.Context, programs: Programs, scenery: StaticScene, *, leaves: bool = True
    ) -> None:
        """Draw the map, with or without `leaves`, through which snow falls."""
        if len(scenery):
            low, high = scenery.low_m, scenery.high_m
            self._centre_m = (low + high) / 2
            self._half_m = max(float(np.max(high[:2] - low[:2])) / 2, CELL_MIN_M * SIZE_PX / 2)
            height = self._draw(context, programs, scenery, (high[2] - low[2]) / 2 + 1.0, leaves=leaves)
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
        return np.asarray(points_m[:, 2] > self.heights_m(points_m))

    def heights_m(self, points_m: Array) -> NDArray[np.float32]:
        """Height of the highest surface over points of the world (N, 2 or 3) [m], shape (N,)."""
        size = self._height_m.shape[0]
        at = (points_m[:, :2] - self._centre_m[:2]) * (0.5 / self._half_m) + 0.5
        cell = np.clip((at * size).astype(np.int64), 0, size - 1)
        return np.asarray(self._height_m[cell[:, 1], cell[:, 0]])

    def _draw(
        self,
        context: moderngl.Context,
        programs: Programs,
        scenery: StaticScene,
        half_height_m: float,
        *,
        leaves: bool,
    ) -> NDArray[np.float32]:
        """Height of the highest surface in each cell [m], row = north, column = east."""
        texture = context.depth_texture((SIZE_PX, SIZE_PX))
        framebuffer = context.framebuffer(depth_attachment=texture)
        framebuffer.use()
        framebuffer.clear(depth=1.0)
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        features = () if leaves else (f"NO_LEAVES {Material.LEAF:d}u",)
        program = programs.get("shadow.vert", "shadow.frag", *features)
        down = np.diag([1.0 / self._half_m, 1.0 / self._half_m, -1.0 / half_height_m])
        set_uniforms(program, u_light=down.T.astype("<f4").tobytes(), u_origin=tuple(self._centre_m))
        everywhere = np.full(3, np.inf)
        scenery.draw_bare(program, scenery.casting(np.eye(3), -everywhere, everywhere))
        depth = np.frombuffer(texture.read(), dtype=np.float32).reshape(SIZE_PX, SIZE_PX)
        framebuffer.release()
        texture.release()
        height = self._centre_m[2] + half_height_m * (1.0 - 2.0 * depth)
        return np.asarray(height, dtype=np.float32)
