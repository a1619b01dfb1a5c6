"""The pipelines of evalio (github.com/contagon/evalio): LOAM, LIO-SAM, DLIO, CT-ICP, MAD-ICP, FORM and more.

They get a full sweep, beam by beam, in which a ray without a return is a point at the origin, and all
inertial samples up to its end; their settings are evalio's own, but motion compensation is switched on,
and MAD-ICP may take its time, so that its result does not depend on the machine.

Our sequences as a data set of evalio, so that all of its pipelines and commands run on them.

``CARLALOC_DATA=data EVALIO_CUSTOM=recorder.slam.runners.evalio evalio run -d carla_loc/* -p kiss -o out``

Sequences are called by their place below the folder, such as ``town03_clearnoon_dynamic``.
"""

import functools
import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from evalio import types
from evalio.datasets import Dataset
from evalio.datasets.loaders import RawDataIter
from evalio.types import SE3, SO3, ImuMeasurement, ImuParams, LidarParams, Stamp, Trajectory
from numpy.typing import NDArray

from carlaloc_env.core.array_types import GRAVITY_MPS2
from recorder.dataset.layout import sequences_below
from recorder.dataset.scans import Scan
from recorder.dataset.sequence import SlamSequence
from recorder.evaluation.trajectory_files import read_tum
from recorder.slam.system import FrameClock, StampedPose


def run_pipeline(sequence: SlamSequence, clock: FrameClock, pipeline: str) -> list[StampedPose]:
    """Poses of the IMU by one of evalio's pipelines, by the name of its class."""
    from evalio import pipelines, types

    system = getattr(pipelines, pipeline)()
    system.set_lidar_params(lidar_params(sequence, types))
    system.set_imu_params(imu_params(sequence, types))
    system.set_imu_T_lidar(types.SE3.from_mat(np.asfortranarray(sequence.T("imu", "lidar"))))
    settings = dict(system.default_params())
    # Settings that are not handed over are empty in some pipelines, whatever their defaults are.
    wanted = {"deskew": True, "realtime": False}
    system.set_params(settings | {name: value for name, value in wanted.items() if name in settings})
    system.initialize()
    inertial = list(sequence.imu_samples())
    fed = 0
    for scan in sequence.scans():
        end_ns = scan.stamp_ns + sequence.lidar.sweep_ns
        measurement = lidar_measurement(scan, sequence, types)
        with clock.frame():
            while fed < len(inertial) and inertial[fed].stamp_ns <= end_ns:
                sample = inertial[fed]
                stamp = types.Stamp.from_nsec(sample.stamp_ns)
                system.add_imu(
                    types.ImuMeasurement(stamp, sample.angular_velocity_radps, sample.acceleration_mps2)
                )
                fed += 1
            system.add_lidar(measurement)
    return [(stamp.to_nsec(), np.array(pose.to_mat())) for stamp, pose in system.saved_estimates()]


def lidar_params(sequence: SlamSequence, types: Any) -> Any:
    """Beams, columns, rate and the range that is used, as evalio wants them."""
    return types.LidarParams(
        num_rows=len(sequence.lidar.elevations_deg),
        num_columns=sequence.lidar.columns,
        min_range=sequence.lidar.near_m,
        max_range=100.0,
        rate=sequence.lidar.rate_hz,
    )


def imu_params(sequence: SlamSequence, types: Any) -> Any:
    """Noise of the IMU as evalio wants it; noise of zero would make its filters divide by it."""
    imu = sequence.imu
    return types.ImuParams(
        gyro=max(imu.gyro_noise_density, 1e-6),
        accel=max(imu.accel_noise_density, 1e-6),
        gyro_bias=max(imu.gyro_random_walk, 1e-8),
        accel_bias=max(imu.accel_random_walk, 1e-8),
        gravity=np.array([0.0, 0.0, -GRAVITY_MPS2]),
        rate=imu.rate_hz,
    )


_POINT = np.dtype(
    [
        ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4"), ("range", "<u4"),
        ("row", "<u2"),
    ]
)  # fmt: skip
"""A point of a bag's cloud, as evalio reads it; times in nanoseconds, ranges in millimetres."""


def lidar_measurement(scan: Scan, sequence: SlamSequence, types: Any) -> Any:
    """A full grid of beams and columns, row by row."""
    if scan.ring is None or scan.intensity is None:
        raise ValueError("the clouds have no ring or intensity")
    rows, columns = len(sequence.lidar.elevations_deg), sequence.lidar.columns
    sweep_s = sequence.lidar.sweep_ns * 1e-9
    # Times are float32: one that falls a breath before its column must not take the cell of the last.
    column = np.clip((scan.time_s / sweep_s * columns + 1e-2).astype(int), 0, columns - 1)
    grid = np.zeros((rows, columns), _POINT)
    grid["t"] = np.rint(np.arange(columns) * sweep_s / columns * 1e9)
    points = np.zeros(len(column), _POINT)
    points["x"], points["y"], points["z"] = scan.points_xyz_m.T
    points["intensity"] = scan.intensity
    points["t"] = np.rint(scan.time_s * 1e9)
    points["range"] = np.linalg.norm(scan.points_xyz_m, axis=1) * 1000
    grid[scan.ring, column] = points
    grid["row"] = np.arange(rows)[:, None]
    return _from_bytes(grid, types.Stamp.from_nsec(scan.stamp_ns))


def _from_bytes(grid: NDArray[np.void], stamp: Any) -> Any:
    """A measurement by the function with which evalio reads bags: a call a point takes eight times longer."""
    from evalio._cpp.helpers import DataType, Field, PointCloudMetadata, fill_col_row_major, pc2_to_evalio

    kinds = {"<f4": DataType.FLOAT32, "<u4": DataType.UINT32, "<u2": DataType.UINT16}
    layout = dict(_POINT.fields or {})
    fields = [
        Field(name=name, datatype=kinds[kind.str], offset=offset)
        for name, (kind, offset, *_) in layout.items()
    ]
    rows, columns = grid.shape
    about = PointCloudMetadata(
        stamp=stamp, height=rows, width=columns, point_step=_POINT.itemsize,
        row_step=columns * _POINT.itemsize, is_bigendian=0, is_dense=1,
    )  # fmt: skip
    measurement = pc2_to_evalio(about, fields, grid.tobytes())
    fill_col_row_major(measurement)
    return measurement


loam = partial(run_pipeline, pipeline="LOAM")
"""LOAM as re-written by McGann."""
lio_sam = partial(run_pipeline, pipeline="LioSAM")
"""LIO-SAM (Shan et al. 2020) without loop closures."""
dlio = partial(run_pipeline, pipeline="DLIO")
"""DLIO (Chen et al. 2023)."""
ct_icp = partial(run_pipeline, pipeline="CTICP")
"""CT-ICP (Dellenbach et al. 2022)."""
mad_icp = partial(run_pipeline, pipeline="MadICP")
"""MAD-ICP (Ferrari et al. 2024)."""
form = partial(run_pipeline, pipeline="FORM")
"""FORM (Potokar and Kaess 2025)."""


DATA = "CARLALOC_DATA"
"""Environment variable: folder with sequences."""


def _folders() -> dict[str, Path]:
    """Folders of all sequences below `DATA`, by their names in evalio."""
    return _folders_below(Path(os.environ.get(DATA, ".")))


@functools.cache
def _folders_below(root: Path) -> dict[str, Path]:
    """The same of any folder, which is searched once."""
    found = [sequence.path for sequence in sequences_below(root)]
    return {"_".join(folder.relative_to(root).parts).lower(): folder for folder in found}


@functools.cache
def _sequence(folder: Path) -> SlamSequence:
    """A sequence, whose descriptions are read once: evalio asks for it again and again."""
    return SlamSequence(folder)


class _Sequences(Dataset):
    """What evalio asks of a sequence; the members are made of what lies in the folder."""

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
        found: ImuParams = imu_params(self.sequence, types)
        return found

    def lidar_params(self) -> LidarParams:
        """Beams, columns and range of the LiDAR."""
        found: LidarParams = lidar_params(self.sequence, types)
        return found

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
        """What carries the sensors."""
        return "Simulated car"


CarlaLoc = _Sequences("CarlaLoc", {name.upper(): name for name in _folders()})  # type: ignore[call-arg]
"""Data set of all sequences below the folder that `DATA` names."""
