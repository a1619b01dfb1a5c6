"""The pinhole camera: intrinsics in OpenCV's convention, optical frame x right, y down, z forward."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.errors import ConfigError


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
