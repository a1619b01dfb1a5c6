"""A fifth of a second of every kind of sample, the rig they come from, and bags read back by rosbags."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.highlevel import AnyReader

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.samples import (
    DepthImage,
    Events,
    GnssFix,
    Image,
    Imu,
    ObjectList,
    Odometry,
    PointCloud,
    Sample,
    SemanticImage,
    Speed,
)
from carlaloc_env.sensors.base import Mount
from recorder.writers.base import Writer
from recorder.writers.rig_calibration import (
    CameraCalibration,
    ImuCalibration,
    LidarCalibration,
    RigCalibration,
)

PINHOLE = Pinhole(width_px=32, height_px=24, fx_px=16.0, fy_px=16.0, cx_px=16.0, cy_px=12.0)


def rig() -> RigCalibration:
    mounts = {
        side: Mount(position_m=(1.8, y, 1.4), axes="optical") for side, y in (("left", 0.2), ("right", -0.2))
    }
    return RigCalibration.of(
        cameras=[
            CameraCalibration(name=side, T_base_camera=mount.T_base_sensor, pinhole=PINHOLE)
            for side, mount in mounts.items()
        ],
        imu=ImuCalibration(T_base_imu=Mount(position_m=(1.5, 0, 1), axes="paper_imu").T_base_sensor),
        lidar=LidarCalibration(T_base_lidar=Mount(position_m=(1.2, 0, 1.8)).T_base_sensor),
    )


def imu(stamp_ns: int = 0, force_mps2: ArrayLike = (0, 0, 0), rate_radps: ArrayLike = (0, 0, 0)) -> Imu:
    force, rate = np.array(force_mps2, float), np.array(rate_radps, float)
    return Imu(
        sensor="imu", frame_id="imu", stamp_ns=stamp_ns, specific_force_mps2=force, angular_rate_radps=rate
    )


def truth(
    stamp_ns: int, position_m: ArrayLike, quat_xyzw: ArrayLike = (0, 0, 0, 1), frame_id: str = "base_link",
    velocity_mps: ArrayLike = (0, 0, 0), rate_radps: ArrayLike = (0, 0, 0), **others: Any,
) -> Odometry:  # fmt: skip
    position, quat, velocity, rate = (
        np.array(values, float) for values in (position_m, quat_xyzw, velocity_mps, rate_radps)
    )
    return Odometry(
        sensor="truth", frame_id=frame_id, stamp_ns=stamp_ns, position_m=position, quat_xyzw=quat,
        velocity_world_mps=velocity, angular_rate_radps=rate, **others,
    )  # fmt: skip


def batch_of(
    rows: NDArray[Any], stamp_ns: int = 0, size_px: tuple[int, int] = (1280, 720),
    period_ns: int = 50_000_000, side: str = "left",
) -> Events:  # fmt: skip
    """Events of one camera; its size is (width, height)."""
    return Events(
        sensor=f"events_{side}", frame_id=f"camera_{side}", stamp_ns=stamp_ns, events=rows,
        width_px=size_px[0], height_px=size_px[1], period_ns=period_ns,
    )  # fmt: skip


def cloud_of(
    points_xyz_m: NDArray[Any], stamp_ns: int = 0, labelled: bool = True, sweep_ns: int = 50_000_000,
    **columns: ArrayLike,
) -> PointCloud:  # fmt: skip
    """A sweep of given points; columns that are not named are 0, and without labels there are none."""
    kinds: dict[str, type] = {"intensity": np.float32, "ring": np.uint16, "offset_ns": np.uint32}
    if labelled:
        kinds |= {"tag": np.uint8, "instance": np.uint32, "cos_incidence": np.float32}
    values = {name: np.full(len(points_xyz_m), columns.get(name, 0), kind) for name, kind in kinds.items()}
    return PointCloud(
        sensor="lidar_semantic" if labelled else "lidar", frame_id="lidar", stamp_ns=stamp_ns,
        points_xyz_m=np.asarray(points_xyz_m, np.float32), sweep_ns=sweep_ns, **values,
    )  # fmt: skip


def cloud(stamp_ns: int, labelled: bool) -> PointCloud:
    rng, k = np.random.default_rng(stamp_ns), np.arange(50)
    points, intensity = rng.normal(size=(50, 3)), rng.random(50, dtype=np.float32)
    columns = {"tag": k, "instance": k * 100_000, "cos_incidence": np.ones(50)}
    return cloud_of(
        points, stamp_ns, labelled, intensity=intensity, ring=k, offset_ns=k * 1_000_000, **columns
    )


def write_all(writer: Writer, samples: Iterable[Sample]) -> Path:
    """The target, which is there when all samples are written and not before."""
    with writer:
        for sample in samples:
            writer.write(sample)
        assert not writer.target.exists()
    return writer.target


def drive() -> list[Sample]:
    """A fifth of a second of every kind of sample, in the order of their stamps."""
    rng = np.random.default_rng(0)
    samples: list[Sample] = []
    for stamp in range(0, 200_000_000, 5_000_000):
        samples.append(imu(stamp, rng.normal(size=3), rng.normal(size=3)))
        quat = transforms.rpy_to_quat(0.1, -0.2, 1.0 + stamp * 1e-9)
        velocity = transforms.quat_rotate(quat, (5.0, 0.0, 0.5))
        samples.append(truth(stamp, rng.normal(size=3), quat, "imu", velocity, (0.0, 0.0, 1.0)))
        if stamp % 50_000_000 == 0:
            for side in ("left", "right"):
                at: dict[str, Any] = {"frame_id": f"camera_{side}", "stamp_ns": stamp}
                rgb = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
                tag = rng.integers(0, 29, (24, 32), dtype=np.uint8)
                depth_m = rng.random((24, 32), dtype=np.float32)
                samples += [
                    Image(sensor=f"rgb_{side}", rgb=rgb, **at),
                    DepthImage(sensor=f"depth_{side}", depth_m=depth_m, **at),
                    SemanticImage(sensor=f"semantic_{side}", tag=tag, instance=tag.astype(np.uint32), **at),
                ]
            samples += [cloud(stamp, False), cloud(stamp, True)]
            samples.append(Speed(sensor="speed", frame_id="base_link", stamp_ns=stamp, speed_mps=-1.5))
        if stamp == 0:
            samples.append(
                GnssFix(
                    sensor="gnss", frame_id="gnss", stamp_ns=stamp, latitude_deg=49.1, longitude_deg=8.2,
                    altitude_m=110.0, covariance_enu_m2=np.diag([9.0, 9.0, 25.0]),
                )
            )  # fmt: skip
    return samples


def read(path: Path) -> tuple[dict[str, tuple[str, str]], dict[str, list[tuple[int, Any]]]]:
    """Type and md5 of every topic, and its messages with their times."""
    with AnyReader([path]) as reader:
        types = {c.topic: (c.msgtype, c.digest) for c in reader.connections}
        messages: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in types}
        for connection, time_ns, data in reader.messages():
            messages[connection.topic].append((time_ns, reader.deserialize(data, connection.msgtype)))
    return types, messages


def two_objects(stamp_ns: int = 0) -> ObjectList:
    """A car and a walker."""
    return ObjectList(
        sensor="objects", frame_id="world", stamp_ns=stamp_ns, id=np.array([2**23 + 1, 2**23 + 2], np.uint32),
        tag=np.array([14, 12], np.uint8), position_m=np.array([[1.0, 2.0, 0.7], [5.0, 6.0, 0.9]]),
        heading_rad=np.array([np.pi / 2, 0.0]), pitch_rad=np.array([0.0, 0.0]), roll_rad=np.array([0.0, 0.0]),
        size_m=np.array([[4.5, 1.8, 1.4], [0.6, 0.6, 1.8]]),
        velocity_mps=np.array([[0.0, 9.0, 0.0], [1.2, 0.0, 0.0]]), yaw_rate_radps=np.array([0.1, 0.0]),
        visible=np.array([0.5, np.nan]), distance_m=np.array([10.0, 130.0]),
    )  # fmt: skip
