"""Which far chunks hide entirely behind what has been drawn already."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.render.context import Programs, set_uniforms
from carlaloc_env.render.projection import View

Array = NDArray[np.float64]

MARGIN_M = 0.3
"""Boxes are grown by this, so that a rounding never hides what can be seen [m]."""


class Occlusion:
    """Draws boxes against the depth test without a trace and asks whether any sample passed.

    Nothing visible is ever left out, so the picture stays the same; hidden streets cost no triangles.
    """

    def __init__(self, context: moderngl.Context, programs: Programs) -> None:
        self._context = context
        self._program = programs.get("box.vert", "shadow.frag")
        self._array = context.vertex_array(self._program, [])
        self._queries: list[moderngl.Query] = []

    def seen(
        self,
        framebuffer: moderngl.Framebuffer,
        view: View,
        depth_range: tuple[float, float],
        low_m: Array,
        high_m: Array,
    ) -> NDArray[np.bool_]:
        """Whether boxes (N, 3), (N, 3) show in a half-drawn picture, shape (N,)."""
        while len(self._queries) < len(low_m):
            self._queries.append(self._context.query(samples=True))
        set_uniforms(
            self._program,
            u_rotation=view.R_camera_world.T.astype("<f4").tobytes(),
            u_clip=view.clip_scale,
            u_range=depth_range,
        )
        low = low_m - view.position_m - MARGIN_M
        high = high_m - view.position_m + MARGIN_M
        attachments = len(framebuffer.color_attachments)
        _set_colour_mask(framebuffer, attachments, False)
        framebuffer.depth_mask = False
        for query, a, b in zip(self._queries, low, high, strict=False):
            set_uniforms(self._program, u_low=tuple(a), u_high=tuple(b))
            with query:
                self._array.render(moderngl.TRIANGLE_STRIP, vertices=14)
        _set_colour_mask(framebuffer, attachments, True)
        framebuffer.depth_mask = True
        return np.array([query.samples > 0 for query in self._queries[: len(low)]], dtype=bool)

    def release(self) -> None:
        """Free the queries."""
        self._array.release()


def _set_colour_mask(framebuffer: Any, attachments: int, write: bool) -> None:
    framebuffer.color_mask = [(write,) * 4] * attachments
