"""Our own stereo baseline: corners, tracks and PnP of OpenCV, and adjustment of a window of keyframes.

Corners (Shi and Tomasi 1994) are tracked from image to image and into the right image (Lucas and Kanade,
pyramids after Bouguet). A landmark is the mean of all of its stereo sightings, each weighted by its
information on depth, ~ 1/z⁴; the pose is that of its landmarks' sightings by PnP with RANSAC, then Levenberg
and Marquardt. The last keyframes are adjusted together (`keyframe_window`). It closes no loops and knows
no weather: a floor to stand on, not a competitor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import cv2 as untyped_cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import U8, Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.sensors.camera_config import CameraConfig
from recorder.dataset.readings import StereoPair
from recorder.dataset.sequence import SlamSequence
from recorder.slam.bundle_adjustment import StereoCamera
from recorder.slam.keyframe_window import KeyframeWindow
from recorder.slam.system import FrameClock, StampedPose

CORNERS, CORNERS_MIN, SPACING_PX = 700, 350, 9
"""Corners at most, tracks below which new ones are looked for, and least distance of two [px]."""
DEPTH_MAX_BASELINES = 120.0
"""Landmarks further away than so many baselines show too little of the motion."""
RANSAC_PX, INLIERS_MIN = 1.5, 12
"""Error of an inlier [px], and inliers below which a pose is not believed."""
KEYFRAME_PX, KEYFRAME_SHARE = 12.0, 0.8
"""A keyframe is taken when landmarks have moved by so many pixels, or less of the last one's are left."""
cv2: Any = untyped_cv2
"""OpenCV, whose stubs know arrays of one type only."""
_WINDOW = {"winSize": (15, 15), "maxLevel": 3}


@dataclass(slots=True)
class _Tracks:
    """Landmarks that are being followed."""

    pixel: NDArray[np.float32]
    """Where they are in the last left image [px], shape (N, 2)."""
    position_m: Array
    """Where they are in the world [m], shape (N, 3)."""
    weight: Array
    """Information gathered on each, shape (N,)."""
    label: NDArray[np.int64]
    """Numbers that are never used twice, increasing, shape (N,)."""

    def take(self, rows: NDArray[np.bool_]) -> _Tracks:
        return _Tracks(self.pixel[rows], self.position_m[rows], self.weight[rows], self.label[rows])


class StereoOdometry:
    """Stereo odometry of rectified images.

    Args:
        focal_px: Focal length [px].
        centre_px: Principal point [px], shape (2,).
        baseline_m: Distance of the cameras [m].
    """

    def __init__(self, focal_px: float, centre_px: Array, baseline_m: float) -> None:
        self._focal_px, self._centre_px, self._baseline_m = focal_px, centre_px, baseline_m
        self._K = np.array([[focal_px, 0, centre_px[0]], [0, focal_px, centre_px[1]], [0, 0, 1.0]])
        self._last: U8 | None = None
        self._tracks = _Tracks(
            np.zeros((0, 2), np.float32), np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64)
        )
        self._labels = 0
        camera = StereoCamera(focal_px=focal_px, centre_px=centre_px, baseline_m=baseline_m)
        self._window = KeyframeWindow(camera)
        self.pose: Array = np.eye(4)
        """Maps the left camera to the world, shape (4, 4)."""
        self._step: Array = np.eye(4)

    def add(self, pair: StereoPair) -> bool:
        """Take the next images; whether the pose is a measured one, not the last step once more."""
        is_measured = self._last is None
        if self._last is not None:
            self._tracks = self._followed(self._last, pair)
            before = self.pose
            pose = self._solved(before @ self._step)
            is_measured = pose is not None
            self.pose = pose if pose is not None else before @ self._step
            self._step = np.linalg.inv(before) @ self.pose
        if not is_measured:
            self._window.clear()
        self._see(pair)
        self._last = pair.left
        return is_measured

    def _followed(self, last: U8, pair: StereoPair) -> _Tracks:
        if not len(self._tracks.pixel):
            return self._tracks
        moved, good = _flow(last, pair.left, self._tracks.pixel)
        if pair.left_mover is not None:
            column, row = np.where(good[:, None], moved, 0).astype(int).T
            good &= ~pair.left_mover[row, column]
        tracks = self._tracks
        return _Tracks(moved, tracks.position_m, tracks.weight, tracks.label).take(good)

    def _solved(self, guess: Array) -> Array | None:
        tracks = self._tracks
        if len(tracks.pixel) < INLIERS_MIN:
            return None
        inverse: Any = np.linalg.inv(guess)
        rotation, shift = cv2.Rodrigues(inverse[:3, :3])[0], inverse[:3, 3:].copy()
        pixels: Any = tracks.pixel.astype(np.float64)
        cv2.setRNGSeed(0)
        good, rotation, shift, inliers = cv2.solvePnPRansac(
            tracks.position_m, pixels, self._K, None, rotation, shift, True, 200, RANSAC_PX, 0.999
        )
        if not good or inliers is None or len(inliers) < INLIERS_MIN:
            return None
        rows = np.zeros(len(pixels), bool)
        rows[inliers.ravel()] = True
        self._tracks = tracks.take(rows)
        rotation, shift = cv2.solvePnPRefineLM(
            self._tracks.position_m, pixels[rows], self._K, None, rotation, shift
        )
        T: Any = np.eye(4)
        T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], shift.ravel()
        pose: Array = np.asarray(np.linalg.inv(T), np.float64)
        return pose

    def _see(self, pair: StereoPair) -> None:
        """Measure all landmarks in both images; at a keyframe add new ones and adjust the window."""
        tracks = self._tracks
        right = np.zeros(0)
        if len(tracks.pixel):
            measured, weight, good, right = self._triangulated(pair, tracks.pixel)
            share = np.where(good, weight / (weight + tracks.weight), 0.0)[:, None]
            tracks.position_m += (
                share * (np.where(good[:, None], measured, 0.0) - tracks.position_m) * (share > 0)
            )
            tracks.weight += np.where(good, weight, 0.0)
        if not self._is_keyframe():
            return
        right = np.concatenate([right, self._add_corners(pair)])
        if len(self._tracks.pixel):
            tracks = self._tracks
            seen = np.column_stack([tracks.pixel, right])
            self.pose, tracks.position_m = self._window.add(self.pose, tracks.label, seen, tracks.position_m)

    def _is_keyframe(self) -> bool:
        """Whether the view has changed enough, or too few landmarks are left."""
        tracks = self._tracks
        last = self._window.newest
        if last is None:
            return len(tracks.pixel) < CORNERS_MIN
        if len(tracks.pixel) < KEYFRAME_SHARE * min(len(last.label), CORNERS_MIN):
            return True
        _, here, there = np.intersect1d(tracks.label, last.label, assume_unique=True, return_indices=True)
        moved_px = np.linalg.norm(tracks.pixel[here] - last.pixel[there, :2], axis=1)
        return bool(np.median(moved_px) > KEYFRAME_PX)

    def _add_corners(self, pair: StereoPair) -> Array:
        """Look for landmarks where there are none; columns of the new ones in the right image [px]."""
        tracks = self._tracks
        mask = np.full(pair.left.shape, 255, np.uint8)
        if pair.left_mover is not None:
            mask[pair.left_mover] = 0
        for x, y in tracks.pixel.astype(int).tolist():
            cv2.circle(mask, (x, y), SPACING_PX, 0, -1)
        wanted = CORNERS - len(tracks.pixel)
        corners = cv2.goodFeaturesToTrack(pair.left, wanted, 0.005, SPACING_PX, mask=mask) if wanted else None
        if corners is None:
            return np.zeros(0)
        pixel = corners.reshape(-1, 2).astype(np.float32)
        position, weight, good, right = self._triangulated(pair, pixel)
        label = np.arange(self._labels, self._labels + int(good.sum()))
        self._labels += len(label)
        self._tracks = _Tracks(
            np.concatenate([tracks.pixel, pixel[good]]),
            np.concatenate([tracks.position_m, position[good]]),
            np.concatenate([tracks.weight, weight[good]]),
            np.concatenate([tracks.label, label]),
        )
        return right[good]

    def _triangulated(
        self, pair: StereoPair, pixel: NDArray[np.float32]
    ) -> tuple[Array, Array, NDArray[np.bool_], Array]:
        """World positions [m] of the left pixels, their information, which are good, and right columns."""
        right, good = _flow(pair.left, pair.right, pixel)
        disparity = (pixel[:, 0] - right[:, 0]).astype(np.float64)
        good &= (np.abs(pixel[:, 1] - right[:, 1]) < 1.0) & (disparity > self._focal_px / DEPTH_MAX_BASELINES)
        depth = self._focal_px * self._baseline_m / np.where(good, disparity, 1.0)
        ray = np.column_stack([(pixel - self._centre_px) / self._focal_px, np.ones(len(pixel))])
        position: Array = (ray * depth[:, None]) @ self.pose[:3, :3].T + self.pose[:3, 3]
        return position, 1.0 / depth**4, good, np.where(good, right[:, 0], np.nan)


def run(sequence: SlamSequence, clock: FrameClock) -> list[StampedPose]:
    """Poses of the left camera; an image in which too little is recognised has none.

    Images through a lens are undistorted first, within the time of their frame.

    Raises:
        EvaluationError: the cameras are not parallel and side by side.
    """
    left, right = sequence.stereo
    T = np.linalg.inv(left.mount.T_base_sensor) @ right.mount.T_base_sensor
    if not np.allclose(T[:3, :3], np.eye(3), atol=1e-6) or np.abs(T[1:3, 3]).max() > 1e-6:
        raise EvaluationError("stereo-vo takes two parallel cameras side by side; use such a rig")
    eye = left.pinhole
    undistort = [_undistortion(camera, eye) for camera in (left, right)]
    odometry = StereoOdometry(eye.fx_px, np.array([eye.cx_px, eye.cy_px]), float(T[0, 3]))
    poses: list[StampedPose] = []
    for pair in sequence.stereo_pairs():
        with clock.frame():
            movers = None if pair.left_mover is None else undistort[0](pair.left_mover.astype(np.uint8)) > 0
            seen = replace(
                pair, left=undistort[0](pair.left), right=undistort[1](pair.right), left_mover=movers
            )
            is_measured = odometry.add(seen)
        if is_measured:
            poses.append((pair.stamp_ns, odometry.pose.copy()))
    return poses


def _undistortion(camera: CameraConfig, pinhole: Pinhole) -> Callable[[U8], U8]:
    """Makes images of a camera those that a pinhole without a lens would give; its border repeats beyond."""
    if camera.pinhole == pinhole and camera.lens.is_plain:
        return lambda image: image
    column, row = camera.lens.undistortion_px(camera.pinhole, pinhole)
    return lambda image: cv2.remap(image, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _flow(first: U8, second: U8, pixel: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Places of one image's pixels in another, and whether the way back ends where it began."""
    there, tracked, _ = cv2.calcOpticalFlowPyrLK(first, second, pixel.reshape(-1, 1, 2), None, **_WINDOW)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None, **_WINDOW)
    there, back = there.reshape(-1, 2), back.reshape(-1, 2)
    good = (tracked.ravel() > 0) & (returned.ravel() > 0) & (np.abs(back - pixel).max(axis=1) < 0.5)
    height, width = first.shape
    good &= (there >= 0).all(axis=1) & (there[:, 0] < width) & (there[:, 1] < height)
    return there, good
