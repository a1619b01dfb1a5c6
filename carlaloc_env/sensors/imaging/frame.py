"""One drawn picture of a camera, through its lens."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.camera_model import Lens, LensView, Pinhole
from carlaloc_env.weather.parameters import WeatherParameters

if TYPE_CHECKING:
    from carlaloc_env.render.geometry.gbuffer import GBuffer
    from carlaloc_env.render.rain_drops import Streaks
    from carlaloc_env.render.renderer import SceneRenderer


class Optics:
    """Intrinsics and lens of a camera; what is drawn so that every pixel's ray is in it."""

    def __init__(self, pinhole: Pinhole, lens: Lens) -> None:
        self.pinhole = pinhole
        self.lens = lens

    @cached_property
    def view(self) -> LensView | None:
        """Map from the drawn picture to the camera's; None: they are the same."""
        return None if self.lens.is_plain else LensView.of(self.pinhole, self.lens)

    @cached_property
    def rays(self) -> NDArray[np.float64] | None:
        """Rays of the pixels, x and y at z = 1, shape (H, W, 2); None: those of the pinhole."""
        return None if self.lens.is_plain else self.lens.rays(self.pinhole)

    @property
    def drawn(self) -> Pinhole:
        """Intrinsics to draw with."""
        return self.pinhole if self.view is None else self.view.pinhole


class Frame:
    """A drawn picture; numbers are read back when first asked for."""

    def __init__(self, gbuffer: GBuffer, renderer: SceneRenderer, view: LensView | None) -> None:
        self._gbuffer, self._renderer, self._view = gbuffer, renderer, view
        self._radiance: dict[WeatherParameters, F32] = {}

    @cached_property
    def depth_m(self) -> F32:
        """Planar depth [m], 0 = sky, shape (H, W); of the nearest ray, never between two."""
        depth = self._gbuffer.depth_m()
        return depth if self._view is None else self._view.pick(depth)

    @cached_property
    def labels(self) -> tuple[NDArray[np.uint8], NDArray[np.uint32]]:
        """Tag and instance of the nearest ray, shape (H, W)."""
        tag, instance = self._gbuffer.labels()
        if self._view is None:
            return tag, instance
        return self._view.pick(tag), self._view.pick(instance)

    @cached_property
    def normal(self) -> F32:
        """Normals in the optical frame, shape (H, W, 3)."""
        normal = self._gbuffer.normals()
        return normal if self._view is None else self._view.pick(normal)

    def rgbs(
        self, weathers: Sequence[WeatherParameters], stamp_ns: int, seed: int
    ) -> list[NDArray[np.uint8]]:
        """The renderer's own pictures under some weathers, sRGB, each of shape (H, W, 3)."""
        rgbs = self._renderer.shade_all(self._gbuffer, weathers, stamp_ns=stamp_ns, seed=seed)
        if self._view is None:
            return rgbs
        return [np.asarray(self._bent(rgb), dtype=np.uint8) for rgb in rgbs]

    def radiance_cd_m2(self, weather: WeatherParameters) -> F32:
        """Linear BT.709 colour [cd/m²], shape (H, W, 3)."""
        if weather not in self._radiance:
            radiance = self._renderer.radiance_cd_m2(self._gbuffer, weather)
            self._radiance[weather] = radiance if self._view is None else self._bent(radiance)
        return self._radiance[weather]

    def imaged_cd_m2(self, weather: WeatherParameters) -> F32:
        """Linear colour [cd/m²] with the lens' blur that the renderer's quality gives colour pictures."""
        radiance = self.radiance_cd_m2(weather)
        if self._renderer.quality != "medium":
            return radiance
        blurred = cv2.GaussianBlur(radiance, (3, 3), 0.5, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(blurred, dtype=np.float32)

    def rained_cd_m2(
        self, light: F32, weather: WeatherParameters, *, stamp_ns: int, exposure_s: float, seed: int
    ) -> F32:
        """Light with falling drops before it; as it is where none fall.

        Args:
            light: Linear colour [cd/m²], shape (H, W, 3).
            weather: Rain.
            stamp_ns: Time of the picture [ns].
            exposure_s: Exposure time [s].
            seed: Seed of the rain.
        """
        if not weather.falls:
            return light
        rain = self._renderer.rain_cd_m2(
            self._gbuffer, weather, stamp_ns=stamp_ns, exposure_s=exposure_s, seed=seed
        )
        rain = rain if self._view is None else self._bent(rain)
        return np.asarray(light * (1 - rain[..., 3:]) + rain[..., :3], dtype=np.float32)

    def falling(
        self, weather: WeatherParameters, *, stamp_ns: int, span_s: float, seed: int
    ) -> tuple[Streaks, Array]:
        """Drops or flakes before the picture in a span that ends with it, see `SceneRenderer.falling`."""
        return self._renderer.falling(self._gbuffer, weather, stamp_ns=stamp_ns, span_s=span_s, seed=seed)

    @property
    def is_blurred(self) -> bool:
        """Whether the radiance has the lens' blur already."""
        return self._renderer.quality == "high"

    def _bent(self, picture: NDArray[Any]) -> NDArray[Any]:
        assert self._view is not None
        return np.asarray(cv2.remap(picture, self._view.column_px, self._view.row_px, cv2.INTER_LINEAR))
