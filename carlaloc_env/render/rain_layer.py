"""The rain that lies before a picture: streaks drawn by the processor, on the few pixels that they touch.

A full picture of streaks costs a software driver more than the scene's own shading of those pixels, so
the finished picture is taken back to light where a streak crosses it, mixed, and developed again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.render.lighting.night_lighting import UNSEEN_NOISE
from carlaloc_env.render.lighting.shader_constants import TONE_ROOM, TONE_SHOULDER
from carlaloc_env.render.rain_drops import Streaks
from carlaloc_env.render.streak_kernels import noticeable, over_codes, over_light, streak_pixels
from carlaloc_env.render.views import CameraView

UNSEEN_STEP = 0.25
"""Largest change that stays invisible [steps of 8 bits]."""
_STEPS = 4096
"""Steps of the root of exposed light up to 2."""
_UNKNOWN = np.zeros((0, 4), np.uint8)
"""Stands for an image that is not known."""
_NOTHING_UNSEEN = np.zeros(256)
"""Every change counts."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Canvas:
    """Buffers for the layer of one size of pictures, all zeros between two pictures."""

    light: NDArray[np.float32]
    """Light of the streaks and, in the fourth channel, how much they hide, shape (H·W, 4)."""
    touched: NDArray[np.int32]
    """Indices of pixels, shape (H·W,)."""


@dataclass(slots=True, kw_only=True)
class RainLayer:
    """Draws streaks before pictures."""

    _canvases: dict[tuple[int, int], _Canvas] = field(default_factory=dict)

    def layer(
        self, view: CameraView, depth_m: NDArray[np.float32], streaks: Streaks, light: Array
    ) -> NDArray[np.float32]:
        """The layer alone, shape (H, W, 4): what streaks add, and the share that they hide.

        Args:
            view: Camera.
            depth_m: Planar depth, 0 = sky, shape (H, W).
            streaks: Drops.
            light: Their light, shape (N, 3).
        """
        canvas, count = self._drawn(depth_m, _seen_by(view, streaks, light))
        out = canvas.light.copy().reshape(*depth_m.shape, 4)
        canvas.light[canvas.touched[:count]] = 0.0
        return out

    def over_image(
        self,
        image: NDArray[np.uint8],
        view: CameraView,
        depth_m: NDArray[np.float32],
        streaks: Streaks,
        light: Array,
        *,
        key: int,
        electrons: tuple[float, float],
    ) -> None:
        """Draw exposed streaks over a developed picture (H, W, 4), in place.

        Args:
            image: sRGB.
            view: Camera.
            depth_m: Planar depth, 0 = sky, shape (H, W).
            streaks: Drops.
            light: Their exposed light, shape (N, 3).
            key: Of the dither and the noise.
            electrons: Of a pixel at value 1, and noise of reading it; zeros where no noise shows.
        """
        seen = _seen_by(view, streaks, light)
        shown = np.empty(len(streaks), bool)
        unseen = _unseen(*electrons)
        noticeable(shown, image, *seen, _LIGHT_OF_CODE, unseen)
        canvas, count = self._drawn(depth_m, seen.take(shown), image.reshape(-1, 4), unseen)
        over_codes(
            image.reshape(-1, 4),
            canvas.light,
            canvas.touched,
            count,
            _LIGHT_OF_CODE,
            unseen,
            _CODE_OF_ROOT,
            np.uint32(key),
            *electrons,
        )

    def over_radiance(
        self,
        image: NDArray[np.float32],
        view: CameraView,
        depth_m: NDArray[np.float32],
        streaks: Streaks,
        light: Array,
    ) -> None:
        """Draw exposed streaks over exposed light (H, W, 4), in place."""
        canvas, count = self._drawn(depth_m, _seen_by(view, streaks, light))
        over_light(image.reshape(-1, 4), canvas.light, canvas.touched, count)

    def _drawn(
        self,
        depth_m: NDArray[np.float32],
        seen: _Seen,
        image: NDArray[np.uint8] = _UNKNOWN,
        unseen: Array = _NOTHING_UNSEEN,
    ) -> tuple[_Canvas, int]:
        """Buffers with the streaks in them, and the number of pixels that show them."""
        size = (depth_m.shape[0], depth_m.shape[1])
        if size not in self._canvases:
            pixels = size[0] * size[1]
            self._canvases[size] = _Canvas(
                light=np.zeros((pixels, 4), np.float32), touched=np.zeros(pixels, np.int32)
            )
        canvas = self._canvases[size]
        count = streak_pixels(canvas.light, canvas.touched, depth_m, *seen, image, _LIGHT_OF_CODE, unseen)
        return canvas, count


class _Seen(NamedTuple):
    """Streaks in the optical frame, as the kernels take them."""

    begin_m: Array
    end_m: Array
    diameter_m: Array
    light: Array
    """Light and opacity, shape (N, 4)."""
    intrinsics: Array
    """Focal lengths and principal point [px], shape (4,)."""

    def take(self, which: NDArray[np.bool_]) -> _Seen:
        """Some of them."""
        begin, end, diameter, light, intrinsics = self
        return _Seen(begin[which], end[which], diameter[which], light[which], intrinsics)


def _seen_by(view: CameraView, streaks: Streaks, light: Array) -> _Seen:
    # Written out: sums over the last axis of three take NumPy three times as long.
    R, begin_m = view.R_camera_world.T, streaks.begin_m
    if streaks.flakes:
        # A flake as wide as its way is long is a disc rather than a line: it reaches on by its width.
        way = streaks.end_m - begin_m
        long_m = np.maximum(np.sqrt(np.sum(way * way, axis=1)), 1e-6)
        begin_m = streaks.end_m - way * (1.0 + streaks.diameter_m / long_m)[:, None]
    begin, end = (
        place[:, :1] * R[0] + place[:, 1:2] * R[1] + place[:, 2:] * R[2] for place in (begin_m, streaks.end_m)
    )
    c = view.camera
    return _Seen(
        begin_m=begin,
        end_m=end,
        diameter_m=streaks.diameter_m,
        light=np.column_stack([light, streaks.opacity]),
        intrinsics=np.array([c.fx_px, c.fy_px, c.cx_px, c.cy_px]),
    )


def developed(light: Array) -> Array:
    """sRGB value 0–1 of exposed light, with the soft shoulder of ``fog.glsl``."""
    over = np.maximum(light - TONE_SHOULDER, 0.0)
    toned = np.minimum(light, TONE_SHOULDER) + TONE_ROOM * (1.0 - np.exp(-over / TONE_ROOM))
    bright = 1.055 * np.maximum(toned, 1e-9) ** (1.0 / 2.4) - 0.055
    return np.asarray(np.where(toned < 0.0031308, 12.92 * toned, bright), dtype=np.float64)


def undeveloped(code: Array) -> Array:
    """Exposed light of an sRGB value 0–1, the inverse of `developed`."""
    toned = np.where(code < 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    # White is any light that is bright enough; three quarters of a step below it stands for all.
    over = np.minimum((toned - TONE_SHOULDER) / TONE_ROOM, 1.0 - 0.25 / 255.0)
    bright = TONE_SHOULDER - TONE_ROOM * np.log1p(-np.maximum(over, 0.0))
    return np.asarray(np.where(toned > TONE_SHOULDER, bright, toned))


def _unseen(electrons: float, read_noise_e: float) -> Array:
    """Largest change of exposed light that stays invisible at every code, shape (256,)."""
    step = np.diff(_LIGHT_OF_CODE, append=_LIGHT_OF_CODE[-1:])
    if electrons <= 0.0:
        return UNSEEN_STEP * step
    noise = np.sqrt(_LIGHT_OF_CODE * electrons + read_noise_e**2) / electrons
    return np.asarray(np.maximum(UNSEEN_STEP * step, UNSEEN_NOISE * noise))


_LIGHT_OF_CODE = undeveloped(np.arange(256) / 255.0)
"""Exposed light of every code, shape (256,)."""
_CODE_OF_ROOT = developed((np.arange(_STEPS + 2) / _STEPS * 2.0) ** 2)
"""Values at the squares of 0 … 2 in `_STEPS` even steps."""
