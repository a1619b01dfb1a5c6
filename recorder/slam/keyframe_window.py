"""The last keyframes of a stereo odometry and their landmarks, adjusted together."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.transforms import apply, invert
from recorder.slam.bundle_adjustment import Sightings, StereoCamera, adjust

KEYFRAMES = 8
"""Keyframes of a window; the oldest is held."""
SIGHTINGS_MIN, LANDMARKS_MIN = 2, 12
"""Keyframes that must see a landmark for it to count, and least number of such landmarks."""


@dataclass(slots=True)
class _Keyframe:
    """One of the window's images."""

    pose: Array
    """Maps the left camera to the world, shape (4, 4)."""
    label: NDArray[np.int64]
    """Labels of the landmarks that it sees, increasing, shape (N,)."""
    pixel: Array
    """Where, as `Sightings.pixel`, shape (N, 3)."""
    position_m: Array
    """Where they are [m], world, shape (N, 3)."""


class KeyframeWindow:
    """Keyframes that are adjusted whenever one is added.

    Args:
        camera: The cameras.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self._camera = camera
        self._frames: deque[_Keyframe] = deque(maxlen=KEYFRAMES)

    @property
    def newest(self) -> _Keyframe | None:
        """The last keyframe; None: there is none."""
        return self._frames[-1] if self._frames else None

    def clear(self) -> None:
        """Forget all keyframes: the next ones cannot be tied to them."""
        self._frames.clear()

    def add(
        self, pose: Array, label: NDArray[np.int64], pixel: Array, position_m: Array
    ) -> tuple[Array, Array]:
        """Take a keyframe and adjust all.

        Args:
            pose: Maps the left camera to the world, shape (4, 4).
            label: Labels of its landmarks, increasing, shape (N,).
            pixel: Where it sees them, column and row in the left image, column in the
                right one or NaN [px], shape (N, 3).
            position_m: Where they are thought to be [m], world, shape (N, 3).

        Returns:
            The pose and the positions that fit the whole window best.
        """
        self._frames.append(_Keyframe(pose, label, pixel, position_m.copy()))
        frames = self._frames
        labels = np.concatenate([frame.label for frame in frames])
        image = np.repeat(np.arange(len(frames)), [len(frame.label) for frame in frames])
        # The last row of each landmark has what is newest of it.
        distinct, last, landmark, count = _last_rows(labels)
        wanted = count >= SIGHTINGS_MIN
        if wanted.sum() < LANDMARKS_MIN:
            return pose, position_m
        rows = wanted[landmark]
        number = np.cumsum(wanted) - 1
        seen = Sightings(
            image=image[rows],
            landmark=number[landmark[rows]],
            pixel=np.concatenate([frame.pixel for frame in frames])[rows],
        )
        points = np.concatenate([frame.position_m for frame in frames])[last]
        T = np.stack([invert(frame.pose) for frame in frames])
        T, points[wanted] = adjust(self._camera, T, points[wanted], seen)
        for frame, T_camera_world in zip(frames, T, strict=True):
            frame.pose = invert(T_camera_world)
            frame.position_m = points[np.searchsorted(distinct, frame.label)]
        # New landmarks move with the only image that sees them.
        new = ~wanted[np.searchsorted(distinct, label)]
        moved = frames[-1].position_m
        moved[new] = apply(frames[-1].pose, apply(invert(pose), moved[new]))
        return frames[-1].pose, moved.copy()


def _last_rows(
    labels: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Distinct labels, the last row of each, the number of each row's label, and how often each is there."""
    distinct, first_behind, landmark, count = np.unique(
        labels[::-1], return_index=True, return_inverse=True, return_counts=True
    )
    return distinct, len(labels) - 1 - first_behind, landmark[::-1], count
