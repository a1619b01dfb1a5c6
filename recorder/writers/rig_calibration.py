"""The calibration of a rig: mounts, intrinsics and noise of its sensors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Lens, Pinhole
from carlaloc_env.core.errors import WriterError
from carlaloc_env.sensors.base import SensorConfig
from recorder.writers.text_templates import real

BASE_FRAME = "base_link"
"""Frame of the car: FLU, on the ground below the rear axle."""
NOISE_FLOORS = {
    "accelerometer_noise_density": 1e-5, "accelerometer_random_walk": 1e-6,
    "gyroscope_noise_density": 1e-6, "gyroscope_random_walk": 1e-7,
}  # fmt: skip
"""Least noise that calibration states, in the units of `ImuCalibration`; systems divide by it.

The densities are those of navigation-grade IMUs, 1 µg/√Hz and 0.003 °/√h; the walks are a third of the
tactical grade's or less.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraCalibration:
    """A camera."""

    name: str
    """Name of the camera; its colour stream is ``rgb_`` + name."""
    T_base_camera: Array
    """Maps the optical frame to `base_link`, shape (4, 4)."""
    pinhole: Pinhole
    """Intrinsics."""
    lens: Lens = field(default_factory=Lens)
    """Distortion."""
    rate_hz: float = 20.0
    """Images per second [Hz]."""
    frame_id: str = ""
    """Name of the optical frame; empty: ``camera_`` + name."""
    readout_ms: float = 0.0
    """Time from the first row's exposure to the last row's [ms]; 0 = global shutter."""

    @property
    def line_delay_s(self) -> float:
        """Time between the exposures of two neighbouring rows [s]."""
        return 1e-3 * self.readout_ms / max(self.pinhole.height_px - 1, 1)

    @property
    def frame(self) -> str:
        """Name of the optical frame."""
        return self.frame_id or f"camera_{self.name}"

    @property
    def stream(self) -> str:
        """Name of the colour stream."""
        return f"rgb_{self.name}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuCalibration:
    """An IMU with continuous-time noise in Kalibr's convention, at least that of `NOISE_FLOORS`."""

    name: str = "imu"
    """Name of the sensor, its stream and its frame."""
    T_base_imu: Array = field(default_factory=lambda: np.eye(4))
    """Maps the IMU frame to `base_link`, shape (4, 4)."""
    rate_hz: float = 200.0
    """Measurements per second [Hz]."""
    accelerometer_noise_density: float = 2e-3
    """White noise of the specific force [m/s²/√Hz]."""
    accelerometer_random_walk: float = 3e-3
    """Diffusion of the accelerometer's bias [m/s³/√Hz]."""
    gyroscope_noise_density: float = 2e-4
    """White noise of the body rate [rad/s/√Hz]."""
    gyroscope_random_walk: float = 2e-5
    """Diffusion of the gyroscope's bias [rad/s²/√Hz]."""
    raised: tuple[str, ...] = ()
    """A line for each figure that was raised to its floor."""

    def __post_init__(self) -> None:
        for name, floor in NOISE_FLOORS.items():
            value = getattr(self, name)
            if not value >= floor:
                note = f"{name}: the rig has {real(value)}; raised to a floor, since less stops systems"
                object.__setattr__(self, "raised", (*self.raised, note))
                object.__setattr__(self, name, floor)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LidarCalibration:
    """A LiDAR."""

    name: str = "lidar"
    """Name of the sensor, its plain stream and its frame."""
    T_base_lidar: Array = field(default_factory=lambda: np.eye(4))
    """Maps the LiDAR frame to `base_link`, shape (4, 4)."""
    rate_hz: float = 20.0
    """Revolutions per second [Hz]."""
    elevations_deg: tuple[float, ...] = (-30.0, 10.0)
    """Elevation of each beam, lowest first [deg]; of a pattern, before its optics."""
    columns: int = 2078
    """Firings of all beams in one revolution, the most of one."""
    is_spinning: bool = True
    """Whether beams of constant elevation go all round."""
    doppler: bool = False
    """Whether points have the rate of their range."""
    range_min_m: float = 1.0
    """Nearest return [m]."""
    range_max_m: float = 120.0
    """Farthest return [m]."""
    near_m: float = 2.0
    """Distance from which returns are not of the car itself [m]."""

    @property
    def rings(self) -> int:
        """Number of beams."""
        return len(self.elevations_deg)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigCalibration:
    """All sensors of a car."""

    cameras: tuple[CameraCalibration, ...] = ()
    """Cameras; of a stereo pair the left one comes first."""
    imu: ImuCalibration | None = None
    """The IMU, body of visual-inertial systems."""
    lidar: LidarCalibration | None = None
    """The LiDAR."""
    frames: Mapping[str, Array] = field(default_factory=dict)
    """For every sensor frame, the map to `base_link`, shape (4, 4)."""
    more_imus: tuple[ImuCalibration, ...] = ()
    """Further IMUs, whose noise messages state."""
    sensors: tuple[SensorConfig, ...] = ()
    """The configurations that it was made of; drivers' messages need more of them."""

    def T(self, to_frame: str, from_frame: str) -> Array:
        """Maps coordinates of one frame to another, shape (4, 4).

        Raises:
            WriterError: a frame is unknown.
        """
        return transforms.invert(self._T_base(to_frame)) @ self._T_base(from_frame)

    def _T_base(self, frame: str) -> Array:
        if frame == BASE_FRAME:
            return np.eye(4)
        if frame not in self.frames:
            raise WriterError(
                f"no frame '{frame}' in the rig; it has {', '.join([BASE_FRAME, *self.frames])}"
            )
        return self.frames[frame]

    @classmethod
    def of(
        cls,
        *,
        cameras: Iterable[CameraCalibration] = (),
        imu: ImuCalibration | None = None,
        lidar: LidarCalibration | None = None,
        others: Mapping[str, Array] | None = None,
        more_imus: Iterable[ImuCalibration] = (),
    ) -> RigCalibration:
        """Rig whose frames are those of the sensors given, and some others."""
        cameras = tuple(cameras)
        frames = {camera.frame: camera.T_base_camera for camera in cameras}
        if imu is not None:
            frames[imu.name] = imu.T_base_imu
        if lidar is not None:
            frames[lidar.name] = lidar.T_base_lidar
        frames |= others or {}
        return cls(cameras=cameras, imu=imu, lidar=lidar, frames=frames, more_imus=tuple(more_imus))

    @classmethod
    def from_configs(cls, configs: Iterable[SensorConfig]) -> RigCalibration:
        """Calibration of a rig's sensor configurations; the first IMU and LiDAR count."""
        configs = tuple(configs)
        cameras = [_camera(config) for config in configs if config.kind == "camera"]
        imus = [_imu(config) for config in configs if config.kind == "imu"]
        lidar = next((_lidar(config) for config in configs if config.kind == "lidar"), None)
        made = cls.of(cameras=cameras, imu=imus[0] if imus else None, lidar=lidar, more_imus=imus[1:])
        frames = {config.frame_id: config.mount.T_base_sensor for config in configs}
        return replace(made, frames={**made.frames, **frames}, sensors=configs)


def _camera(config: Any) -> CameraCalibration:
    return CameraCalibration(
        name=config.name,
        T_base_camera=config.mount.T_base_sensor,
        pinhole=config.pinhole,
        lens=config.lens,
        rate_hz=config.rate_hz,
        frame_id=config.frame_id,
        readout_ms=config.shutter.readout_ms if config.shutter is not None else 0.0,
    )


def _imu(config: Any) -> ImuCalibration:
    return ImuCalibration(
        name=config.name,
        T_base_imu=config.mount.T_base_sensor,
        rate_hz=config.rate_hz,
        accelerometer_noise_density=config.accel_noise_density,
        accelerometer_random_walk=config.accel_random_walk,
        gyroscope_noise_density=config.gyro_noise_density,
        gyroscope_random_walk=config.gyro_random_walk,
    )


def _lidar(config: Any) -> LidarCalibration:
    return LidarCalibration(
        name=config.name,
        T_base_lidar=config.mount.T_base_sensor,
        rate_hz=config.rate_hz,
        elevations_deg=tuple(e + config.elevation_offset_deg for e in config.elevations_deg),
        columns=config.columns_most,
        is_spinning=config.is_spinning,
        doppler=config.doppler,
        range_min_m=config.range_min_m,
        range_max_m=config.range_max_m,
        near_m=config.near_m,
    )
