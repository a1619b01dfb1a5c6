"""KITTI's odometry layout with SemanticKITTI's labels: one sequence in one folder (Geiger et al., CVPR 2012).

Points lie where they were seen at the time of the frame: the exact motion moves each from the time of its
measurement to the beginning of its sweep.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import Image, ObjectList, PointCloud, Sample
from recorder.writers.base import Encoder, Piece, png_of
from recorder.writers.formats.ego_path import POSE, FollowingWriter, is_pose, pose_piece
from recorder.writers.formats.semantic_kitti import semantic_kitti_labels
from recorder.writers.formats.sweep_points import POINT, point_rows
from recorder.writers.rig_calibration import RigCalibration

MOVING_FROM_MPS = 0.5
"""Speed from which a road user counts as moving [m/s]."""
T_LIDAR_CAMERA_AXES: Array = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""A camera's axes (right, down, forward) at the LiDAR, for rigs without a camera."""


class KittiEncoder(Encoder):
    """Images, clouds, poses and moving objects of a KITTI folder.

    Args:
        calibration: The rig; it must have a LiDAR.

    Raises:
        WriterError: the rig has no LiDAR.
    """

    def __init__(self, calibration: RigCalibration) -> None:
        if calibration.lidar is None:
            raise WriterError("the KITTI format needs a LiDAR; add one to the rig")
        self.calibration = calibration
        self.lidar = calibration.lidar
        self.images = {camera.stream: f"image_{2 + k}" for k, camera in enumerate(calibration.cameras[:2])}

    def encode(self, sample: Sample) -> list[Piece]:
        """Images as PNG; clouds, poses and moving objects as rows of numbers, to be put together in order."""
        stamp_ns = sample.stamp_ns
        if isinstance(sample, ObjectList):
            speed = np.linalg.norm(sample.velocity_mps, axis=1)
            moving = sample.id[speed > MOVING_FROM_MPS].astype("<u4")
            return [Piece(stamp_ns, "moving", "", moving.tobytes())]
        if is_pose(sample):
            return [pose_piece(sample)]
        if isinstance(sample, PointCloud) and sample.frame_id == self.lidar.name and sample.tag is not None:
            # The plain cloud has the same points, without labels.
            return [Piece(stamp_ns, "cloud", str(sample.sweep_ns), point_rows(sample))]
        if isinstance(sample, Image) and sample.sensor in self.images:
            png = png_of(cv2.cvtColor(sample.rgb, cv2.COLOR_RGB2BGR), sample.sensor)
            return [Piece(stamp_ns, self.images[sample.sensor], "png", png)]
        return []


class KittiWriter(FollowingWriter):
    """Clouds, their labels, the images of the same instants, and truth; a frame is a LiDAR sweep.

    Files are ``velodyne/%06d.bin`` (x, y, z, remission as float32), ``labels/%06d.label``, ``image_2`` and
    ``image_3``, ``poses.txt`` (of the left camera, relative to its first), ``calib.txt`` and ``times.txt``.
    """

    encoder: KittiEncoder

    def __init__(self, target: str | Path, encoder: KittiEncoder) -> None:
        super().__init__(target, encoder)
        self._calibration = encoder.calibration
        self._lidar = encoder.lidar
        self._moving = np.zeros(0, np.uint32)
        self._moving_at: dict[int, NDArray[np.uint32]] = {}
        """Instance ids of objects that move when a sweep begins, by its stamp [ns]."""
        self._frames: dict[int, int] = {}
        self._early: list[Piece] = []
        self._T_first: Array | None = None

    @property
    def _T_base_camera(self) -> Array:
        """Mount of the left camera; without one, a camera's axes at the LiDAR."""
        if self._calibration.cameras:
            return self._calibration.cameras[0].T_base_camera
        return self._lidar.T_base_lidar @ T_LIDAR_CAMERA_AXES

    def _begin(self, part: Path) -> None:
        for folder in ("velodyne", "labels", *self.encoder.images.values()):
            (part / folder).mkdir(parents=True)
        (part / "calib.txt").write_text(self._calib(), encoding="utf-8")
        for name in ("times.txt", "poses.txt"):
            self._files[name] = (part / name).open("x", encoding="utf-8")

    def _place(self, piece: Piece) -> None:
        if piece.place == "moving":
            self._moving = np.frombuffer(piece.data, "<u4")
        elif piece.place == POSE:
            super()._place(piece)
        else:
            if piece.place == "cloud":
                self._frames[piece.stamp_ns] = len(self._frames)
                self._moving_at[piece.stamp_ns] = self._moving
                super()._place(piece)
            else:
                # A camera may come before the LiDAR of the same instant.
                self._early.append(piece)
            self._put_images()

    def _end_ns(self, piece: Piece) -> int:
        return piece.stamp_ns + int(piece.kind)

    def _put_images(self) -> None:
        """Write images of frames; KITTI cannot hold an image between the beginnings of sweeps."""
        for piece in self._early:
            if piece.stamp_ns in self._frames:
                name = f"{self._frames[piece.stamp_ns]:06d}.png"
                (self._part / piece.place / name).write_bytes(piece.data)
        newest_ns = max((piece.stamp_ns for piece in self._early), default=0)
        self._early = [
            piece
            for piece in self._early
            if piece.stamp_ns == newest_ns and piece.stamp_ns not in self._frames
        ]

    def _put(self, piece: Piece) -> None:
        self._path.forget_before(piece.stamp_ns)
        frame, cloud = self._frames[piece.stamp_ns], np.frombuffer(piece.data, POINT)
        T_world_base = self._path.T_world_base(piece.stamp_ns)
        T_base_lidar = self._lidar.T_base_lidar
        stamps_ns = piece.stamp_ns + cloud["offset_ns"].astype(np.int64)
        in_world = self._path.to_world(cloud["xyz"].astype(np.float64), stamps_ns, T_base_lidar)
        in_lidar = transforms.apply(np.linalg.inv(T_world_base @ T_base_lidar), in_world)
        rows = np.empty((len(in_lidar), 4), "<f4")
        rows[:, :3], rows[:, 3] = in_lidar, cloud["intensity"] / np.float32(255.0)
        (self._part / "velodyne" / f"{frame:06d}.bin").write_bytes(rows.tobytes())
        labels = semantic_kitti_labels(cloud["tag"], cloud["instance"], self._moving_at.pop(piece.stamp_ns))
        (self._part / "labels" / f"{frame:06d}.label").write_bytes(labels.astype("<u4").tobytes())
        T_world_camera = T_world_base @ self._T_base_camera
        if self._T_first is None:
            self._T_first = T_world_camera
        T_first_camera = np.linalg.inv(self._T_first) @ T_world_camera
        self._files["poses.txt"].write(_numbers(T_first_camera[:3]) + "\n")
        self._files["times.txt"].write(f"{piece.stamp_ns / 1e9:.6e}\n")

    def _calib(self) -> str:
        """Projections of the cameras, if any, relative to the left one, and the LiDAR's place in it."""
        T_camera_base = np.linalg.inv(self._T_base_camera)
        lines = []
        cameras = self._calibration.cameras
        for k in range(4 if cameras else 0):
            camera = cameras[k - 2] if 2 <= k < 2 + len(cameras) else cameras[0]
            p = camera.pinhole
            K = np.array([[p.fx_px, 0.0, p.cx_px], [0.0, p.fy_px, p.cy_px], [0.0, 0.0, 1.0]])
            T_camera_left = np.linalg.inv(camera.T_base_camera) @ self._T_base_camera
            lines.append(f"P{k}: {_numbers(K @ T_camera_left[:3])}")
        lines.append(f"Tr: {_numbers((T_camera_base @ self._lidar.T_base_lidar)[:3])}")
        return "\n".join(lines) + "\n"

    def _finish(self) -> None:
        # The last sweep may end after the last pose; a frame needs truth.
        for sweep in self._waiting:
            name = f"{self._frames[sweep.stamp_ns]:06d}.png"
            for folder in self.encoder.images.values():
                (self._part / folder / name).unlink(missing_ok=True)
        self._waiting.clear()
        super()._finish()


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.12e}" for value in np.asarray(values).reshape(-1).tolist())
