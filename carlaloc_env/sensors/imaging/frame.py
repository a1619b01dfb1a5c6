"""One drawn picture through the lens, and its motion to the next.

Drops on the lens: an option, off in the paper's rig, whose cameras look through a wiped pane.

The motion of everything between two pictures of a camera, in both directions.

Which surface passes in front of a tile of the picture at some time between two pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import F32
from carlaloc_env.core.camera_model import Lens, LensView, Pinhole
from carlaloc_env.core.cores import over_bands
from carlaloc_env.core.jit import compiled
from carlaloc_env.sensors.imaging.motion_field import SKY_M, SURFACE_RATIO, TILE_PX, ScenePoses, motion_field
from carlaloc_env.weather.parameters import WeatherParameters

if TYPE_CHECKING:
    from carlaloc_env.render.geometry.gbuffer import GBuffer
    from carlaloc_env.render.renderer import SceneRenderer


class Optics:
    """Intrinsics and lens of a camera; what is drawn so that every pixel's ray is in it."""

    def __init__(self, pinhole: Pinhole, lens: Lens) -> None:
        self.pinhole = pinhole
        self.lens = lens

    @cached_property
    def view(self) -> LensView | None:
        """How to take the picture from the drawn one; None: they are the same."""
        return None if self.lens.is_plain else LensView.of(self.pinhole, self.lens)

    @cached_property
    def rays(self) -> NDArray[np.float64] | None:
        """What the pixels look along, x and y at z = 1, shape (H, W, 2); None: as the pinhole says."""
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
        """The same with the blur of the lens that the renderer's quality gives colour pictures."""
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
        if weather.precipitation <= 0.0:
            return light
        rain = self._renderer.rain_cd_m2(
            self._gbuffer, weather, stamp_ns=stamp_ns, exposure_s=exposure_s, seed=seed
        )
        rain = rain if self._view is None else self._bent(rain)
        return np.asarray(light * (1 - rain[..., 3:]) + rain[..., :3], dtype=np.float32)

    @property
    def is_blurred(self) -> bool:
        """Whether the radiance has the lens' blur already."""
        return self._renderer.quality == "high"

    def _bent(self, picture: NDArray[Any]) -> NDArray[Any]:
        assert self._view is not None
        return np.asarray(cv2.remap(picture, self._view.column_px, self._view.row_px, cv2.INTER_LINEAR))


MOST = 90
"""Drops on the lens in rain of 50 mm/h."""
LIFE_NS = 3_000_000_000
"""How long a drop stays before another takes its place [ns]."""


def with_lens_drops(
    rgb: NDArray[np.uint8], weather: WeatherParameters, *, stamp_ns: int, seed: int, camera: str
) -> NDArray[np.uint8]:
    """The picture as seen through drops that cling to the lens and slide down.

    A drop is a small lens: it shows the scene upside down and smaller. Where the drops are
    follows from seed, camera and time alone, so both eyes differ and any picture can be made alone.

    Args:
        rgb: Picture, sRGB, shape (H, W, 3).
        weather: How much it rains.
        stamp_ns: Time of the picture [ns].
        seed: Seed of the drops.
        camera: Name of the camera.
    """
    height, width = rgb.shape[:2]
    count = math.ceil(MOST * weather.precipitation / 100.0)
    v, u = np.mgrid[:height, :width].astype(np.float32)
    blur = np.zeros((height, width), np.float32)
    for k in range(count):
        age_ns = stamp_ns + k * LIFE_NS // max(count, 1)
        draw = clock.stream(seed, f"{camera}/lens/{k}", age_ns // LIFE_NS)
        x, y, size, speed = draw.random(4)
        age_s = age_ns % LIFE_NS * 1e-9
        radius = (3.0 + 11.0 * size**2) * width / 1280.0
        cx, cy = x * width, y * height + (5.0 + 35.0 * speed) * age_s * size * width / 1280.0
        low_u, high_u = max(int(cx - radius), 0), min(int(cx + radius) + 2, width)
        low_v, high_v = max(int(cy - radius), 0), min(int(cy + radius) + 2, height)
        box = np.s_[low_v:high_v, low_u:high_u]
        if not blur[box].size:
            continue
        dv, du = np.mgrid[low_v:high_v, low_u:high_u].astype(np.float32)
        du, dv = du - np.float32(cx), dv - np.float32(cy)
        r2 = (du * du + dv * dv) / np.float32(radius * radius)
        inside = r2 < 1.0
        # Upside down, and the more so towards the rim (Lagarde's lens: 1.6 times the offset and more).
        bend = np.float32(-6.0) * (1 + 2 * r2)
        u[box] = np.where(inside, np.float32(cx) + bend * du, u[box])
        v[box] = np.where(inside, np.float32(cy) + bend * dv, v[box])
        blur[box] = np.where(inside, np.maximum(blur[box], np.minimum(4 * (1 - r2), 1)), blur[box])
    bent = cv2.remap(rgb, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    share = blur[..., None]
    return np.asarray(rgb * (1 - share) + bent * share + np.float32(0.5), dtype=np.uint8)


_RIM_PX = np.float32(0.6)
"""A pixel shows what is half a pixel beside it, and a little more for roundings [px]."""


def passing_surfaces(field: F32) -> F32:
    """Nearest surface that is over each tile at some time between the pictures, shape (h, w, 4).

    A pole that sweeps past within one period is found by no pixel that sees neither its beginning
    nor its end: the tiles along its way remember it. Same four numbers as the field.
    """
    shape = -(-field.shape[0] // TILE_PX), -(-field.shape[1] // TILE_PX)
    found, best = np.zeros((*shape, 4), np.float32), np.full(shape, np.float32(2 * SKY_M))
    _fill_passing(field, found, best)
    return found


@compiled
def _fill_passing(field: Any, found: Any, best: Any) -> None:
    rows, columns = best.shape
    size, one = np.float32(TILE_PX), np.float32(1)
    for row in range(rows):
        for column in range(columns):
            y0, x0 = row * TILE_PX, column * TILE_PX
            y1, x1 = min(y0 + TILE_PX, field.shape[0]), min(x0 + TILE_PX, field.shape[1])
            # The nearest surface of the tile.
            y, x, depth = y0, x0, field[y0, x0, 3]
            for j in range(y0, y1):
                for i in range(x0, x1):
                    if field[j, i, 3] < depth:
                        y, x, depth = j, i, field[j, i, 3]
            if depth >= np.float32(SKY_M):
                continue
            left, right, top, bottom = x1, x0, y1, y0
            du, dv, ratio = field[y, x, 0], field[y, x, 1], field[y, x, 2]
            du_low, du_high, dv_low, dv_high = du, du, dv, dv
            for j in range(y0, y1):
                for i in range(x0, x1):
                    if field[j, i, 3] < np.float32(SURFACE_RATIO) * depth:
                        left, right, top, bottom = min(left, i), max(right, i), min(top, j), max(bottom, j)
                        du_low, du_high = min(du_low, field[j, i, 0]), max(du_high, field[j, i, 0])
                        dv_low, dv_high = min(dv_low, field[j, i, 1]), max(dv_high, field[j, i, 1])
            length = max(max(-du_low, du_high), max(-dv_low, dv_high))
            steps = min(int(length / (0.5 * TILE_PX)) + 1, 1024)
            tau_before, scale_before = np.float32(0), one
            for k in range(1, steps + 1):
                s = np.float32(k) / np.float32(steps)
                scale = (one - s) + s * ratio
                tau = s * ratio / scale
                # All that lies between where it was one step before and where it is now.
                west = left - _RIM_PX + min(tau * du_low, tau_before * du_low)
                east = right + _RIM_PX + max(tau * du_high, tau_before * du_high)
                north = top - _RIM_PX + min(tau * dv_low, tau_before * dv_low)
                south = bottom + _RIM_PX + max(tau * dv_high, tau_before * dv_high)
                near = depth * min(scale_before, scale)
                tau_before, scale_before = tau, scale
                q0, q1 = int(np.floor(north / size)), int(np.floor(south / size))
                p0, p1 = int(np.floor(west / size)), int(np.floor(east / size))
                for q in range(max(q0, 0), min(q1 + 1, rows)):
                    for p in range(max(p0, 0), min(p1 + 1, columns)):
                        if near < best[q, p]:
                            best[q, p] = near
                            found[q, p, 0], found[q, p, 1] = du, dv
                            found[q, p, 2], found[q, p, 3] = ratio, depth


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameGeometry:
    """What one picture shows: where everything was, how far away, and which thing."""

    poses: ScenePoses
    """Where everything was."""
    depth_m: F32
    """Planar depth [m], 0 = sky, shape (H, W)."""
    instance: NDArray[np.uint32]
    """Instance ids, shape (H, W)."""

    @classmethod
    def of(cls, frame: Frame, poses: ScenePoses) -> FrameGeometry:
        """Geometry of a drawn picture."""
        return cls(poses=poses, depth_m=frame.depth_m, instance=frame.labels[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameMotion:
    """How everything moves between two pictures, see `motion_field`."""

    forward: F32
    """Field of the first picture, towards the second, shape (H, W, 4)."""
    backward: F32
    """Field of the second picture, towards the first, shape (H, W, 4)."""
    passing: F32
    """Surfaces that pass over tiles, of the first picture, shape (h, w, 4)."""

    @classmethod
    def none(cls, shape: tuple[int, int]) -> FrameMotion:
        """Nothing moves: intensities change linearly."""
        field = np.zeros((*shape, 4), np.float32)
        field[..., 2:] = 1.0
        return cls(forward=field, backward=field, passing=passing_surfaces(field))


def motion_between(optics: Optics, before: FrameGeometry, after: FrameGeometry) -> FrameMotion:
    """How everything moves between two pictures of a camera."""

    def field(now: FrameGeometry, then: FrameGeometry) -> F32:
        seen = now.depth_m, now.instance, now.poses
        return motion_field(optics.pinhole, *seen, then.poses, lens=optics.lens, rays=optics.rays)

    forward = field(before, after)
    # In parallel, since neither job can share all of its work among threads.
    jobs = (lambda: passing_surfaces(forward), lambda: field(after, before))
    passing, backward = over_bands(lambda job, _: jobs[job](), len(jobs), 1)
    return FrameMotion(forward=forward, backward=backward, passing=passing)
