"""Views of cameras: from the world to the picture, what a camera can see, and names of render qualities.

It imports no OpenGL, so that a wrong quality is reported before anything is drawn.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.core.jit import compiled

NEAR_M = 0.2
"""Nearest distance drawn [m]."""
FAR_M = 1500.0
"""Farthest distance drawn [m]."""
QUALITIES = ("low", "medium", "high")
"""One sample per pixel; the same with a lens blur of 0.5 px; 2×2 samples resolved before shading."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraView:
    """One camera at one instant, ready for the shaders."""

    camera: Pinhole
    position_m: Array
    """Optical centre in the world [m], shape (3,)."""
    R_camera_world: Array
    """Rotates world axes into optical axes, shape (3, 3)."""
    subsamples: int = 1
    """Samples per output pixel along each axis."""
    velocity_mps: Array = field(default_factory=lambda: np.zeros(3))
    """Velocity of the camera in the world, shape (3,); slants streaks of rain."""

    @classmethod
    def of(
        cls,
        camera: Pinhole,
        T_world_camera: ArrayLike,
        subsamples: int = 1,
        velocity_mps: ArrayLike = (0.0, 0.0, 0.0),
    ) -> CameraView:
        """View of a camera at a pose (4, 4)."""
        T = np.asarray(T_world_camera, dtype=np.float64)
        return cls(
            camera=camera,
            position_m=T[:3, 3].copy(),
            R_camera_world=T[:3, :3].T.copy(),
            subsamples=subsamples,
            velocity_mps=np.array(velocity_mps, dtype=np.float64),
        )

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the drawn grid of samples."""
        return self.camera.width_px * self.subsamples, self.camera.height_px * self.subsamples

    @property
    def unproject(self) -> tuple[float, float, float, float]:
        """(ax, ay, bx, by): pixel (u, v) looks along the ray (ax · u + bx, ay · v + by, 1)."""
        c = self.camera
        return 1 / c.fx_px, 1 / c.fy_px, -c.cx_px / c.fx_px, -c.cy_px / c.fy_px

    @property
    def clip_scale(self) -> tuple[float, float, float, float]:
        """(sx, sy, ox, oy): clip.xy = s · (x, y) + o · z of a point in the optical frame.

        Row 0 of the target is the top row of the picture, so that nothing has to be flipped after
        reading back. A pixel (u, v) has its centre at integers: sample k·u of the drawn grid falls
        on it exactly, for any number k of subsamples.
        """
        c, k = self.camera, self.subsamples
        return (
            2.0 * c.fx_px / c.width_px,
            2.0 * c.fy_px / c.height_px,
            (2.0 * c.cx_px + 1.0 / k) / c.width_px - 1.0,
            (2.0 * c.cy_px + 1.0 / k) / c.height_px - 1.0,
        )

    def planes(self) -> Array:
        """Inward side planes of the view's pyramid (4, 4): n·X + d ≥ 0 inside, world frame."""
        sx, sy, ox, oy = self.clip_scale
        inward = np.array([[sx, 0, ox + 1], [-sx, 0, 1 - ox], [0, sy, oy + 1], [0, -sy, 1 - oy]])
        normals = np.sum(inward[:, :, None] * self.R_camera_world[None], axis=1)
        normals /= np.sqrt(np.sum(normals**2, axis=1, keepdims=True))
        return np.concatenate([normals, -np.sum(normals * self.position_m, axis=1, keepdims=True)], axis=1)

    def visible(self, low_m: Array, high_m: Array) -> tuple[NDArray[np.intp], Array]:
        """Indices of boxes (N, 3), (N, 3) that may be seen, nearest first, and their distances [m]."""
        planes = self.planes()
        forward = self.R_camera_world[2]
        normals = np.concatenate([planes[:, :3], forward[None]])
        offsets = np.append(planes[:, 3], -float(np.sum(forward * self.position_m)) - NEAR_M)
        distance = np.empty(len(low_m))
        low_m, high_m = np.ascontiguousarray(low_m), np.ascontiguousarray(high_m)
        _distances(distance, low_m, high_m, normals, offsets, self.position_m)
        seen = np.flatnonzero(distance < FAR_M)
        seen = seen[np.argsort(distance[seen], kind="stable")]
        return seen, distance[seen]


@compiled
def _distances(out: Array, low_m: Array, high_m: Array, normals: Array, offsets: Array, eye_m: Array) -> None:
    """Distances of boxes from the eye, infinite for those that lie outside of a plane."""
    for n in range(len(out)):
        inside = True
        for k in range(len(offsets)):
            total = 0.0
            for axis in range(3):
                corner = high_m[n, axis] if normals[k, axis] > 0.0 else low_m[n, axis]
                total += normals[k, axis] * corner
            if total + offsets[k] < 0.0:
                inside = False
                break
        far2 = 0.0
        for axis in range(3):
            gap = max(max(low_m[n, axis] - eye_m[axis], eye_m[axis] - high_m[n, axis]), 0.0)
            far2 += gap * gap
        out[n] = np.sqrt(far2) if inside else np.inf


def check_quality(quality: str) -> str:
    """The quality, if there is one of that name.

    Raises:
        ConfigError: it is none of `QUALITIES`.
    """
    if quality not in QUALITIES:
        raise ConfigError(unknown_name("render quality", quality, QUALITIES))
    return quality
