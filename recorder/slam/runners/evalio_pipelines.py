"""The pipelines of evalio (github.com/contagon/evalio): LOAM, LIO-SAM, DLIO, CT-ICP, MAD-ICP, FORM and more.

They get full sweeps, in which a ray without a return is a point at the origin, and all inertial samples up to
their ends. Their settings are evalio's, but motion compensation is on, and MAD-ICP may take its time.
"""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core.array_types import GRAVITY_MPS2
from carlaloc_env.core.errors import EvaluationError
from recorder.dataset.scans import Scan
from recorder.dataset.sequence import SlamSequence
from recorder.slam.system import FrameClock, StampedPose

_POINT = np.dtype(
    [
        ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("t", "<u4"), ("range", "<u4"),
        ("row", "<u2"),
    ]
)  # fmt: skip
"""A point of a bag's cloud, as evalio reads it; times in nanoseconds, ranges in millimetres."""


def run_pipeline(sequence: SlamSequence, clock: FrameClock, pipeline: str) -> list[StampedPose]:
    """Poses of the IMU by one of evalio's pipelines, by the name of its class.

    Raises:
        EvaluationError: the LiDAR does not spin.
    """
    from evalio import pipelines, types

    if not sequence.lidar.is_spinning:
        raise EvaluationError(f"{pipeline} takes rows of beams that go all round; give a spinning LiDAR")
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
        num_rows=sequence.lidar.rings,
        num_columns=sequence.lidar.columns_most,
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


def lidar_measurement(scan: Scan, sequence: SlamSequence, types: Any) -> Any:
    """A full grid of beams and columns, row by row."""
    if scan.ring is None or scan.intensity is None:
        raise ValueError("the clouds have no ring or intensity")
    lidar = sequence.lidar
    rows, columns = lidar.rings, lidar.columns_most
    column_s = 1e-9 * lidar.sweep_ns / float(lidar.columns_per_sweep)
    # Times are float32: one that falls a breath before its column must not take the cell of the last.
    column = np.clip((scan.time_s / column_s + 1e-2).astype(int), 0, columns - 1)
    grid = np.zeros((rows, columns), _POINT)
    grid["t"] = np.rint(np.arange(columns) * column_s * 1e9)
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
