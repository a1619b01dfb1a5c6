"""Finds the sensors of a rig that SLAM systems read: the first of each kind."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

from carlaloc_env.core.errors import EvaluationError, unknown_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig


def lidar_of(rig: SensorRig) -> LidarConfig:
    """The LiDAR.

    Raises:
        EvaluationError: the rig has none.
    """
    return cast(LidarConfig, _first(rig, "lidar"))


def with_lidar_first(rig: SensorRig, name: str | None) -> SensorRig:
    """The rig with a LiDAR before all other sensors, so that systems read it; None: as it is.

    Raises:
        EvaluationError: it has no such LiDAR.
    """
    if name is None:
        return rig
    lidars = {lidar.name: lidar for lidar in rig.of_kind("lidar")}
    if name not in lidars:
        raise EvaluationError(f"rig '{rig.name}': {unknown_name('LiDAR', name, lidars)}")
    others = (sensor for sensor in rig.sensors if sensor is not lidars[name])
    return replace(rig, sensors=(lidars[name], *others))


def imu_of(rig: SensorRig) -> ImuConfig:
    """The IMU.

    Raises:
        EvaluationError: the rig has none.
    """
    return cast(ImuConfig, _first(rig, "imu"))


def stereo_of(rig: SensorRig) -> tuple[CameraConfig, CameraConfig]:
    """The first two cameras, the left one first.

    Raises:
        EvaluationError: the rig has fewer.
    """
    cameras = cast(tuple[CameraConfig, ...], rig.of_kind("camera"))
    if len(cameras) < 2:
        raise EvaluationError(f"rig '{rig.name}' has {len(cameras)} cameras; stereo needs two")
    return cameras[0], cameras[1]


def first_camera_of(rig: SensorRig) -> CameraConfig:
    """The first camera.

    Raises:
        EvaluationError: the rig has none.
    """
    return cast(CameraConfig, _first(rig, "camera"))


def _first(rig: SensorRig, kind: str) -> Any:
    sensors = rig.of_kind(kind)
    if not sensors:
        raise EvaluationError(f"rig '{rig.name}' has no {kind}; replay with a rig that has one")
    return sensors[0]
