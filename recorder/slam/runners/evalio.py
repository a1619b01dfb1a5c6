"""Our sequences as a data set of evalio, so that all of its pipelines and commands run on them.

``CARLALOC_DATA=data EVALIO_CUSTOM=recorder.slam.runners.evalio evalio run -d carla_loc/* -p kiss -o out``
calls sequences by their place below the folder, such as ``town03_clearnoon_dynamic``.
"""

import functools
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from evalio import types
from evalio.datasets import Dataset
from evalio.datasets.loaders import RawDataIter
from evalio.types import SE3, SO3, ImuMeasurement, ImuParams, LidarParams, Stamp, Trajectory

from recorder.dataset.layout import sequences_below
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.runners.evalio_pipelines import imu_params, lidar_measurement, lidar_params

DATA = "CARLALOC_DATA"
"""Environment variable: folder with sequences."""


def _folders() -> dict[str, Path]:
    """Folders of all sequences below `DATA`, by their names in evalio."""
    return _folders_below(Path(os.environ.get(DATA, ".")))


@functools.cache
def _folders_below(root: Path) -> dict[str, Path]:
    """Folders of all sequences below any folder, which is searched once."""
    folders = [sequence.path for sequence in sequences_below(root)]
    return {"_".join(folder.relative_to(root).parts).lower(): folder for folder in folders}


@functools.cache
def _sequence(folder: Path) -> SlamSequence:
    """A sequence, whose descriptions are read once: evalio asks for it again and again."""
    return SlamSequence(folder)


class _Sequences(Dataset):  # type: ignore[misc]  # unknown where evalio is not installed
    """Sequences as evalio reads them; the members are made of the sequences in the folder."""

    @property
    def sequence(self) -> SlamSequence:
        """The sequence, as our own systems read it."""
        return _sequence(_folders()[self.value])

    def data_iter(self) -> RawDataIter:
        """Sweeps with a cell for every ray, and inertial samples."""
        sequence = self.sequence
        sweeps = (lidar_measurement(scan, sequence, types) for scan in sequence.scans())
        inertial = (
            ImuMeasurement(Stamp.from_nsec(s.stamp_ns), s.angular_velocity_radps, s.acceleration_mps2)
            for s in sequence.imu_samples()
        )
        return RawDataIter(sweeps, inertial, sequence.frames("lidar"))

    def ground_truth_raw(self) -> Trajectory[Any]:
        """True poses of the IMU."""
        truth = read_tum(self.sequence.truth_file("imu"))
        rows = zip(truth.stamp_ns.tolist(), truth.quat_xyzw.tolist(), truth.position_m, strict=True)
        stamps, poses = [], []
        for stamp_ns, (x, y, z, w), position_m in rows:
            stamps.append(Stamp.from_nsec(stamp_ns))
            poses.append(SE3(SO3(qx=x, qy=y, qz=z, qw=w), position_m))
        return Trajectory(stamps=stamps, poses=poses)

    def imu_T_lidar(self) -> SE3:
        """Maps coordinates of the LiDAR to the IMU."""
        return SE3.from_mat(np.asfortranarray(self.sequence.T("imu", "lidar")))

    def imu_T_gt(self) -> SE3:
        """Identity: the truth is that of the IMU."""
        return SE3.identity()

    def imu_params(self) -> ImuParams:
        """Noise of the IMU."""
        params: ImuParams = imu_params(self.sequence, types)
        return params

    def lidar_params(self) -> LidarParams:
        """Beams, columns and range of the LiDAR."""
        params: LidarParams = lidar_params(self.sequence, types)
        return params

    def files(self) -> Sequence[str | Path]:
        """The bag and the truth."""
        return [self.sequence.bag, self.sequence.truth_file("imu")]

    def quick_len(self) -> int:
        """Number of sweeps."""
        return self.sequence.frames("lidar")

    def environment(self) -> str:
        """Kind of place."""
        return "Simulated town"

    def vehicle(self) -> str:
        """Vehicle that carries the sensors."""
        return "Simulated car"


CarlaLoc = _Sequences("CarlaLoc", {name.upper(): name for name in _folders()})  # type: ignore[call-arg]
"""Data set of all sequences below the folder that `DATA` names."""
