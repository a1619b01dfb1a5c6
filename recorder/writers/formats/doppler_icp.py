"""Sequences as Doppler-ICP reads them (Hexsel et al., "DICP", RSS 2022; github.com/aevainc/Doppler-ICP).

Points lie where they were seen at the beginning of their sweep; rates of range are those of their own times.
"""

import json
from pathlib import Path

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import WriterError
from carlaloc_env.samples import PointCloud, Sample
from recorder.evaluation.trajectory_files import tum_text
from recorder.writers.base import Encoder, Piece
from recorder.writers.formats.ego_path import FollowingWriter, is_pose, pose_piece
from recorder.writers.rig_calibration import RigCalibration

_ROW = np.dtype([("xyz", "<f4", 3), ("doppler_mps", "<f4"), ("offset_ns", "<u4")])


class DopplerIcpEncoder(Encoder):
    """Points with their rates of range, and poses.

    Args:
        calibration: The rig; its first LiDAR must measure rates.
        streams: Names of all streams that will come.

    Raises:
        WriterError: it does not.
    """

    def __init__(self, calibration: RigCalibration, streams: tuple[str, ...]) -> None:
        if calibration.lidar is None or not calibration.lidar.doppler:
            raise WriterError("the doppler_icp format needs a LiDAR first that has `doppler: true`")
        self.lidar = calibration.lidar
        self._cloud = self.lidar.name if self.lidar.name in streams else f"{self.lidar.name}_semantic"

    def encode(self, sample: Sample) -> list[Piece]:
        """Clouds and poses as rows of numbers."""
        if is_pose(sample):
            return [pose_piece(sample)]
        if not isinstance(sample, PointCloud) or sample.sensor != self._cloud:
            return []
        rows = np.zeros(len(sample.ring), _ROW)
        rows["xyz"], rows["offset_ns"] = sample.points_xyz_m, sample.offset_ns
        rows["doppler_mps"] = sample.doppler_mps
        return [Piece(sample.stamp_ns, "cloud", str(sample.sweep_ns), rows.tobytes())]


class DopplerIcpWriter(FollowingWriter):
    """Clouds, the LiDAR's place on the car, and its true poses relative to the first.

    Files are ``point_clouds/%05d.bin`` (x, y, z [m], rate of range [m/s, positive = moving away] as float32),
    ``calibration.json`` and ``ref_poses.txt`` (TUM, from 0 s on).
    """

    encoder: DopplerIcpEncoder

    def _begin(self, part: Path) -> None:
        (part / "point_clouds").mkdir(parents=True)
        T, names = self.encoder.lidar.T_base_lidar, "xyzw"
        place = {
            "translation": dict(zip(names, T[:3, 3].tolist(), strict=False)),
            "quaternion": dict(zip(names, transforms.matrix_to_quat(T[:3, :3]).tolist(), strict=True)),
        }
        (part / "calibration.json").write_text(json.dumps({"T_V_to_S": place}, indent=2) + "\n")
        self._stamps_ns: list[int] = []
        self._poses: list[Array] = []

    def _put(self, piece: Piece) -> None:
        T_base_lidar, rows = self.encoder.lidar.T_base_lidar, np.frombuffer(piece.data, _ROW)
        T_world_lidar: Array = self._path.T_world_base(piece.stamp_ns) @ T_base_lidar
        self._stamps_ns.append(piece.stamp_ns)
        self._poses.append(T_world_lidar)
        seen_ns = piece.stamp_ns + rows["offset_ns"].astype(np.int64)
        in_world = self._path.to_world(rows["xyz"].astype(np.float64), seen_ns, T_base_lidar)
        points = transforms.apply(transforms.invert(T_world_lidar), in_world)
        table = np.column_stack([points, rows["doppler_mps"]]).astype("<f4")
        (self._part / "point_clouds" / f"{len(self._poses):05d}.bin").write_bytes(table.tobytes())
        self._path.forget_before(piece.stamp_ns)

    def _finish(self) -> None:
        self._put_last()
        text = ""
        if self._poses:
            T = transforms.invert(self._poses[0]) @ np.array(self._poses)
            after_ns = np.array(self._stamps_ns) - self._stamps_ns[0]
            text = tum_text(after_ns, T[:, :3, 3], transforms.matrix_to_quat(T[:, :3, :3]))
        (self._part / "ref_poses.txt").write_text(text, encoding="utf-8")
