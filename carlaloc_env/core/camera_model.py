"""Camera model: a pinhole in OpenCV's convention, and the distortion of its lens.

The optical frame has x right, y down, z forward. Distortion follows Kalibr's two usual models, which are
OpenCV's plain and fisheye ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core import elementary
from carlaloc_env.core.array_types import F32, Array
from carlaloc_env.core.errors import ConfigError, unknown_name

_T = TypeVar("_T", bound=np.generic)
MODELS = ("none", "radtan", "equidistant")
"""Models of distortion."""
_HALF_VIEW_MAX = 3.0
"""Farthest ray that is drawn: x or y at z = 1, 72° off the axis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pinhole:
    """Intrinsics without distortion; pixel (0, 0) has its centre at u = v = 0."""

    width_px: int = 1280
    """Image width [px]."""
    height_px: int = 720
    """Image height [px]."""
    fx_px: float = 640.0
    """Focal length along u [px]."""
    fy_px: float = 640.0
    """Focal length along v [px]."""
    cx_px: float = 640.0
    """Principal point, u [px]; the paper's authors give W/2."""
    cy_px: float = 360.0
    """Principal point, v [px]; the paper's authors give H/2."""

    def __post_init__(self) -> None:
        if min(self.width_px, self.height_px) < 1 or min(self.fx_px, self.fy_px) <= 0:
            raise ConfigError(
                f"camera of {self.width_px}×{self.height_px} px, focal length {self.fx_px:g} px"
            )

    @classmethod
    def from_fov(cls, width_px: int, height_px: int, fov_deg: float) -> Pinhole:
        """Square pixels, centred, with a horizontal field of view [deg]."""
        f = 0.5 * width_px / math.tan(math.radians(fov_deg) / 2)
        return cls(
            width_px=width_px, height_px=height_px, fx_px=f, fy_px=f, cx_px=width_px / 2, cy_px=height_px / 2
        )

    @property
    def K(self) -> NDArray[np.float64]:
        """Camera matrix, shape (3, 3)."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1.0]])

    def project(self, points_camera_m: ArrayLike) -> NDArray[np.float64]:
        """Pixels (u, v) [px] (N, 2) of points in the optical frame [m] (N, 3); NaN behind the camera."""
        p = np.asarray(points_camera_m, dtype=np.float64)
        z = np.where(p[:, 2] > 0, p[:, 2], np.nan)
        return np.stack(
            [self.fx_px * p[:, 0] / z + self.cx_px, self.fy_px * p[:, 1] / z + self.cy_px], axis=-1
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """Distortion: from the direction of a ray to its position in the image."""

    model: str = "none"
    """``none``; ``radtan``: radial and tangential (Brown); ``equidistant``: Kannala and Brandt."""
    coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2 of ``radtan``; k1, k2, k3, k4 of ``equidistant``."""

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise ConfigError(unknown_name("lens model", self.model, MODELS))
        if len(self.coefficients) != 4:
            raise ConfigError(f"lens '{self.model}': {len(self.coefficients)} coefficients; give 4")

    @property
    def is_plain(self) -> bool:
        """Whether there is no distortion."""
        return self.model == "none"

    def distort(self, x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
        """Normalised image coordinates of rays (x, y, 1)."""
        x, y = np.asarray(x, np.float64), np.asarray(y, np.float64)
        if self.is_plain:
            return x.copy(), y.copy()
        a, b, c, d = self.coefficients
        rr = x * x + y * y
        if self.model == "radtan":
            radial = 1 + rr * (a + rr * b)
            return (
                x * radial + 2 * c * x * y + d * (rr + 2 * x * x),
                y * radial + c * (rr + 2 * y * y) + 2 * d * x * y,
            )
        r = np.sqrt(rr)
        theta = elementary.arctan(r)
        tt = theta * theta
        scale = np.where(
            r > 1e-12, theta * (1 + tt * (a + tt * (b + tt * (c + tt * d)))) / np.maximum(r, 1e-12), 1.0
        )
        return x * scale, y * scale

    def undistortion_px(self, own: Pinhole, plain: Pinhole) -> tuple[F32, F32]:
        """Positions in the camera of pixels of an image without distortion, u and v [px], shape (H, W) each.

        Args:
            own: Pinhole of the camera.
            plain: Pinhole of the image without distortion.
        """
        v, u = np.mgrid[: plain.height_px, : plain.width_px].astype(np.float64)
        x, y = self.distort((u - plain.cx_px) / plain.fx_px, (v - plain.cy_px) / plain.fy_px)
        return (own.fx_px * x + own.cx_px).astype(np.float32), (own.fy_px * y + own.cy_px).astype(np.float32)

    def rays(self, pinhole: Pinhole) -> NDArray[np.float64]:
        """Directions (x, y, 1) that the pixels of a camera look along, x and y, shape (H, W, 2).

        Raises:
            ConfigError: the distortion cannot be undone at the image's corners, or looks farther
                than 72° to the side.
        """
        v, u = np.mgrid[: pinhole.height_px, : pinhole.width_px].astype(np.float64)
        xd, yd = (u - pinhole.cx_px) / pinhole.fx_px, (v - pinhole.cy_px) / pinhole.fy_px
        x, y = xd.copy(), yd.copy()
        if self.model == "equidistant":
            rd = np.hypot(xd, yd)
            theta = np.minimum(rd, 1.25)
            a, b, c, d = self.coefficients
            for _ in range(20):
                tt = theta * theta
                value = theta * (1 + tt * (a + tt * (b + tt * (c + tt * d)))) - rd
                slope = 1 + tt * (3 * a + tt * (5 * b + tt * (7 * c + 9 * tt * d)))
                theta = np.clip(theta - value / np.where(np.abs(slope) > 1e-6, slope, 1.0), 0.0, 1.5)
            scale = np.where(rd > 1e-12, elementary.tan(theta) / np.maximum(rd, 1e-12), 1.0)
            x, y = xd * scale, yd * scale
        elif self.model == "radtan":
            for _ in range(60):
                px, py = self.distort(x, y)
                x, y = np.clip(x + xd - px, -4, 4), np.clip(y + yd - py, -4, 4)
        px, py = self.distort(x, y)
        if max(np.abs(px - xd).max(), np.abs(py - yd).max()) > 1e-7:
            raise ConfigError(
                f"lens '{self.model}' {list(self.coefficients)}: the distortion folds the image's corners; "
                "use smaller coefficients"
            )
        if max(np.abs(x).max(), np.abs(y).max()) > _HALF_VIEW_MAX:
            raise ConfigError(
                f"lens '{self.model}' sees more than 72° to the side; use a longer focal length"
            )
        return np.stack([x, y], axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LensView:
    """Resampling of an image without distortion to the image through a lens."""

    pinhole: Pinhole
    """Pinhole of the larger image without distortion that is drawn."""
    column_px: NDArray[np.float32]
    """Where each pixel lies in it, u [px], shape (H, W)."""
    row_px: NDArray[np.float32]
    """Where each pixel lies in it, v [px], shape (H, W)."""
    nearest: NDArray[np.intp]
    """Row-major index there of the nearest pixel, shape (H, W)."""

    @classmethod
    def of(cls, pinhole: Pinhole, lens: Lens) -> LensView:
        """View of a camera; the drawn image has the camera's own resolution on the axis."""
        rays = lens.rays(pinhole)
        left, top = rays.reshape(-1, 2).min(axis=0)
        right, bottom = rays.reshape(-1, 2).max(axis=0)
        cx = float(np.ceil(-left * pinhole.fx_px) + 2)
        cy = float(np.ceil(-top * pinhole.fy_px) + 2)
        drawn = Pinhole(
            width_px=int(np.ceil(right * pinhole.fx_px + cx)) + 3,
            height_px=int(np.ceil(bottom * pinhole.fy_px + cy)) + 3,
            fx_px=pinhole.fx_px,
            fy_px=pinhole.fy_px,
            cx_px=cx,
            cy_px=cy,
        )
        # Rounded, so that the last bits of a machine's tangents do not matter.
        position_px = np.round(rays * [pinhole.fx_px, pinhole.fy_px] + [cx, cy], 4)
        column, row = (
            np.rint(position_px[..., 0]).astype(np.intp),
            np.rint(position_px[..., 1]).astype(np.intp),
        )
        u, v = (np.ascontiguousarray(position_px[..., k], np.float32) for k in range(2))
        return cls(pinhole=drawn, column_px=u, row_px=v, nearest=row * drawn.width_px + column)

    def pick(self, image: NDArray[_T]) -> NDArray[_T]:
        """Nearest pixels of a drawn image (H', W', …), shape (H, W, …)."""
        flat = image.reshape(-1, *image.shape[2:])
        return np.ascontiguousarray(flat[self.nearest])
