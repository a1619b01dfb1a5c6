"""A fifth of a second of every kind of sample, the rig they come from, and bags read back by rosbags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader

from carlaloc_env.core.geometry import transforms as geometry
from carlaloc_env.core.geometry.camera_model import Pinhole
from carlaloc_env.samples import (
    DepthImage,
    GnssFix,
    Image,
    Imu,
    Odometry,
    PointCloud,
    Sample,
    SemanticImage,
    Speed,
)
from carlaloc_env.sensors.base import Mount
from recorder.writers.rig_calibration import (
    CameraCalibration,
    ImuCalibration,
    LidarCalibration,
    RigCalibration,
)

PINHOLE = Pinhole(width_px=32, height_px=24, fx_px=16.0, fy_px=16.0, cx_px=16.0, cy_px=12.0)


def rig() -> RigCalibration:
    return RigCalibration.of(
        cameras=[
            CameraCalibration(
                name=side,
                T_base_camera=Mount(position_m=(1.8, y, 1.4), axes="optical").T_base_sensor,
                pinhole=PINHOLE,
            )
            for side, y in (("left", 0.2), ("right", -0.2))
        ],
        imu=ImuCalibration(T_base_imu=Mount(position_m=(1.5, 0, 1), axes="paper_imu").T_base_sensor),
        lidar=LidarCalibration(T_base_lidar=Mount(position_m=(1.2, 0, 1.8)).T_base_sensor),
    )


def cloud(stamp_ns: int, labelled: bool) -> PointCloud:
    rng = np.random.default_rng(stamp_ns)
    return PointCloud(
        sensor="lidar_semantic" if labelled else "lidar",
        frame_id="lidar",
        stamp_ns=stamp_ns,
        points_xyz_m=rng.normal(size=(50, 3)).astype(np.float32),
        intensity=rng.random(50, dtype=np.float32),
        ring=np.arange(50, dtype=np.uint16),
        offset_ns=np.arange(50, dtype=np.uint32) * 1_000_000,
        sweep_ns=50_000_000,
        tag=np.arange(50, dtype=np.uint8) if labelled else None,
        instance=np.arange(50, dtype=np.uint32) * 100_000 if labelled else None,
        cos_incidence=np.ones(50, np.float32) if labelled else None,
    )


def drive() -> list[Sample]:
    """A fifth of a second of every kind of sample, in the order of their stamps."""
    rng = np.random.default_rng(0)
    samples: list[Sample] = []
    for stamp in range(0, 200_000_000, 5_000_000):
        samples.append(
            Imu(
                sensor="imu",
                frame_id="imu",
                stamp_ns=stamp,
                specific_force_mps2=rng.normal(size=3),
                angular_rate_radps=rng.normal(size=3),
            )
        )
        quat = geometry.rpy_to_quat(0.1, -0.2, 1.0 + stamp * 1e-9)
        samples.append(
            Odometry(
                sensor="truth",
                frame_id="imu",
                stamp_ns=stamp,
                position_m=rng.normal(size=3),
                quat_xyzw=quat,
                velocity_world_mps=geometry.quat_rotate(quat, (5.0, 0.0, 0.5)),
                angular_rate_radps=np.array([0.0, 0.0, 1.0]),
            )
        )
        if stamp % 50_000_000 == 0:
            for side in ("left", "right"):
                frame = f"camera_{side}"
                rgb = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
                tag = rng.integers(0, 29, (24, 32), dtype=np.uint8)
                samples += [
                    Image(sensor=f"rgb_{side}", frame_id=frame, stamp_ns=stamp, rgb=rgb),
                    DepthImage(
                        sensor=f"depth_{side}",
                        frame_id=frame,
                        stamp_ns=stamp,
                        depth_m=rng.random((24, 32), dtype=np.float32),
                    ),
                    SemanticImage(
                        sensor=f"semantic_{side}",
                        frame_id=frame,
                        stamp_ns=stamp,
                        tag=tag,
                        instance=tag.astype(np.uint32),
                    ),
                ]
            samples += [cloud(stamp, False), cloud(stamp, True)]
            samples.append(Speed(sensor="speed", frame_id="base_link", stamp_ns=stamp, speed_mps=-1.5))
        if stamp == 0:
            samples.append(
                GnssFix(
                    sensor="gnss",
                    frame_id="gnss",
                    stamp_ns=stamp,
                    latitude_deg=49.1,
                    longitude_deg=8.2,
                    altitude_m=110.0,
                    covariance_enu_m2=np.diag([9.0, 9.0, 25.0]),
                )
            )
    return samples


def read(path: Path) -> tuple[dict[str, tuple[str, str]], dict[str, list[tuple[int, Any]]]]:
    """Type and md5 of every topic, and its messages with their times."""
    with AnyReader([path]) as reader:
        types = {c.topic: (c.msgtype, c.digest) for c in reader.connections}
        messages: dict[str, list[tuple[int, Any]]] = {topic: [] for topic in types}
        for connection, time_ns, data in reader.messages():
            messages[connection.topic].append((time_ns, reader.deserialize(data, connection.msgtype)))
    return types, messages
