"""The motion of everything between two pictures of a camera, in both directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import F32
from carlaloc_env.core.jit import over_bands
from carlaloc_env.sensors.imaging.frame import Frame, Optics
from carlaloc_env.sensors.imaging.motion_field import ScenePoses, motion_field
from carlaloc_env.sensors.imaging.occluders import passing_surfaces


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
