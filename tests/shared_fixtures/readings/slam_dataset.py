"""A dataset in closed form: a LiDAR that drives a curve in a box, with a tenth of its points on a car."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from shared_fixtures.readings.bag_samples import cloud_of, imu

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Imu, PointCloud
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from recorder.dataset.checksums import write_checksums
from recorder.dataset.layout import SequenceFolder
from recorder.dataset.manifest import SequenceDescription, write_manifest
from recorder.evaluation.trajectory import Trajectory
from recorder.evaluation.trajectory_files import write_tum
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer

ROOM_M = np.array([24.0, 16.0, 5.0])
ELEVATIONS_DEG = tuple(float(e) for e in range(-24, 24, 3))
COLUMNS, SWEEP_NS = 240, 100_000_000
CAR_SHARE = 0.1


def rig(*, with_imu: bool = False) -> SensorRig:
    lidar = LidarConfig(
        mount=Mount(position_m=(1.0, 0.0, 1.8)), rate_hz=10.0, columns=COLUMNS, elevations_deg=ELEVATIONS_DEG
    )
    return SensorRig(name="box", sensors=(lidar, ImuConfig()) if with_imu else (lidar,))


def pose(t_s: Array) -> tuple[Array, Array]:
    """Positions [m] and attitudes of the LiDAR on an ellipse whose speed swells and falls."""
    angle = 0.25 * t_s + 0.1 * np.sin(t_s)
    position = np.stack([6 * np.cos(angle), 4 * np.sin(angle), 2.0 + 0 * angle], axis=-1)
    return position, transforms.rpy_to_quat(0 * angle, 0 * angle, angle + np.pi / 2)


def sweep(stamp_ns: int) -> PointCloud:
    """A sweep in which every ray is cast from where the LiDAR is at that very time."""
    column = np.repeat(np.arange(COLUMNS), len(ELEVATIONS_DEG))
    ring = np.tile(np.arange(len(ELEVATIONS_DEG)), COLUMNS)
    offset_ns = (column * SWEEP_NS) // COLUMNS
    position, quat = pose((stamp_ns + offset_ns) * 1e-9)
    azimuth, elevation = -2 * np.pi * column / COLUMNS, np.radians(ELEVATIONS_DEG)[ring]
    ray = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    world = transforms.quat_rotate(quat, ray)
    faces = np.sign(world) * 0.5 * ROOM_M + [0.0, 0.0, 0.5 * ROOM_M[2]]
    distance = ((faces - position) / np.where(world == 0, 1e-9, world)).min(axis=1)
    draw = np.random.default_rng(stamp_ns)
    car = draw.random(len(ray)) < CAR_SHARE
    distance = distance + draw.normal(0.0, 0.005, len(ray)) - np.where(car, 0.5, 0.0)
    return cloud_of(
        ray * distance[:, None], stamp_ns, sweep_ns=SWEEP_NS, intensity=0.5, ring=ring, offset_ns=offset_ns,
        tag=np.where(car, Tag.CAR, Tag.BUILDING), instance=np.where(car, 300_000, 1), cos_incidence=1.0,
    )  # fmt: skip


def inertial(sweeps: int, factor: float) -> list[Imu]:
    """Samples of an IMU at the LiDAR's place and axes, of 200 Hz, whose specific forces have a factor."""
    t_s = np.arange(0, sweeps * SWEEP_NS, 5_000_000) * 1e-9
    position, quat = pose(t_s)
    acceleration = np.gradient(np.gradient(position, t_s, axis=0), t_s, axis=0)
    acceleration[:, 2] += 9.81
    force = factor * transforms.quat_rotate(transforms.quat_conjugate(quat), acceleration)
    rate = 0.25 + 0.1 * np.cos(t_s)
    return [imu(round(t * 1e9), f, (0, 0, w)) for t, f, w in zip(t_s.tolist(), force, rate, strict=True)]


def plain(cloud: PointCloud) -> PointCloud:
    """A cloud without labels."""
    return replace(cloud, sensor="lidar", tag=None, instance=None, cos_incidence=None)


def half(cloud: PointCloud, name: str) -> PointCloud:
    """Every second point of a cloud, as a sensor of another name sees it."""
    names = ("points_xyz_m", "intensity", "ring", "offset_ns")
    points = {name: getattr(cloud, name)[::2].copy() for name in names}
    return replace(plain(cloud), sensor=name, frame_id=name, **points)


def write_dataset(
    root: Path,
    *,
    sweeps: int = 25,
    conditions: tuple[str, ...] = ("ClearNoon_dynamic",),
    labelled: bool = True,
    imu_factor: float | None = None,
    second: str | None = None,
) -> Path:
    """A dataset of some conditions, named weather_traffic, as replay lays it out.

    With a factor of specific forces, it has an IMU. A second LiDAR at the same place, with the layout of
    Velodyne's driver, has every second point.

    Without labels the bag has plain clouds, as ``--topics slam`` leaves them, though both were made.
    """
    folder, sensors = root / "Box", rig(with_imu=imu_factor is not None)
    if second is not None:
        extra = replace(sensors.of_kind("lidar")[0], name=second, layout="velodyne", outputs=("cloud",))
        sensors = replace(sensors, sensors=(*sensors.sensors, extra))
    t_ns = np.arange(0, sweeps * SWEEP_NS + 1, 5_000_000)
    position, quat = pose(t_ns * 1e-9)
    truth = Trajectory(stamp_ns=t_ns + DEFAULT_EPOCH_NS, position_m=position, quat_xyzw=quat, name="lidar")
    for name in ("lidar", "base_link", second or "lidar"):
        write_tum(folder / "ground_truth" / f"{name}.tum", truth)
    for condition in conditions:
        path = folder / condition
        path.mkdir()
        calibration = RigCalibration.from_configs(sensors.sensors)
        stream = "lidar_semantic" if labelled else "lidar"
        bag = SequenceFolder(path).place("rosbag1")
        inertials = [] if imu_factor is None else inertial(sweeps, imu_factor)
        clouds = (sweep(k * SWEEP_NS) for k in range(sweeps))
        clouds = (cloud if labelled else plain(cloud) for cloud in clouds)
        others = [half(sweep(k * SWEEP_NS), second) for k in range(sweeps)] if second else []
        streams = {stream, "imu", second or stream}
        with Rosbag1Writer(bag, Ros1Encoder(calibration, streams=streams)) as writer:
            for sample in sorted([*clouds, *others, *inertials], key=lambda one: one.stamp_ns):
                writer.write(sample)
        samples = {"lidar": sweeps, "lidar_semantic": sweeps, "imu": len(inertials)}
        samples |= {second: sweeps} if second else {}
        describe(path, sensors, samples={k: n for k, n in samples.items() if n}, movers=CAR_SHARE)
    list_dataset(root, sensors, topics="standard" if labelled else "slam")
    return root


def describe(folder: Path, rig: SensorRig, *, samples: dict[str, int], movers: float = 0.0) -> None:
    """Describe a sequence's folder, named weather_traffic, as replay does."""
    weather, traffic = folder.name.split("_")
    described = SequenceDescription(
        name=folder.name,
        weather={"name": weather},
        traffic={"name": traffic},
        rig=rig.name,
        epoch_ns=DEFAULT_EPOCH_NS,
        samples=samples,
        movers={"lidar_semantic": movers},
    )
    SequenceFolder(folder).description.write_text(described.to_yaml())
    write_checksums(folder)


def list_dataset(root: Path, rig: SensorRig, *, topics: str = "standard") -> None:
    """Describe a dataset of one drive."""
    town = next(path.name for path in sorted(root.iterdir()) if path.is_dir())
    write_manifest(root, {town: {"topics": topics, "rig": yaml.safe_load(rig.to_yaml())}}, None)
