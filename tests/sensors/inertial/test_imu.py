"""The IMU: gravity's sign, lever arm, re-integration, and noise of the promised densities."""

import itertools
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.imu_readings import QUIET, quiet_imu, read, rows

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.clock import STEP_NS, TICK_NS
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Imu
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.imu import ImuConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.vehicle import SpeedConfig


def test_gravity_reads_upwards_at_rest(scenery: Any) -> None:
    """(0, 0, +9.81) in FLU; along +x in the paper's axes (up, right, forward); a sign slip reads −9.81."""
    rest = read(scenery, scenery.straight(0.0), 0.5, **QUIET)
    assert np.allclose(rest, [0, 0, 9.81, 0, 0, 0], atol=1e-12)
    paper = read(scenery, scenery.straight(0.0), 0.5, mount=Mount(axes="paper_imu"), **QUIET)
    assert np.allclose(paper, [9.81, 0, 0, 0, 0, 0], atol=1e-12)


def test_slope_at_rest(scenery: Any) -> None:
    """Parked nose up by 5°: the forward axis feels +g·sin 5°."""

    def slope(t: Array) -> tuple[Array, Array]:
        return np.zeros((len(t), 3)), np.stack([0 * t, np.full(len(t), -np.radians(5)), 0 * t], axis=-1)

    rest = read(scenery, slope, 0.2, **QUIET)
    assert np.allclose(
        rest[:, :3], [9.81 * np.sin(np.radians(5)), 0, 9.81 * np.cos(np.radians(5))], atol=1e-9
    )


def turn(t: Array) -> tuple[Array, Array]:
    """Circle of 25 m to the left at 10 m/s."""
    a = 0.4 * t
    return np.stack([25 * np.sin(a), 25 * (1 - np.cos(a)), 0 * a], axis=-1), np.stack(
        [0 * a, 0 * a, a], axis=-1
    )


def test_constant_turn(scenery: Any) -> None:
    """A left turn reads +v·ω to the left and +ω about up, in both conventions of axes."""
    flu = read(scenery, turn, 3.0, **QUIET)[10:]
    assert np.allclose(flu, [0, 10 * 0.4, 9.81, 0, 0, 0.4], atol=1e-4)
    paper = read(scenery, turn, 3.0, mount=Mount(axes="paper_imu"), **QUIET)[10:]
    assert np.allclose(paper, [9.81, -10 * 0.4, 0, 0.4, 0, 0], atol=1e-4)


def test_lever_arm(scenery: Any) -> None:
    """1.5 m ahead and 0.4 m left of the axle, the turn adds ω²·l towards the axle."""
    mount = Mount(position_m=(1.5, 0.4, 1.2))
    arm = read(scenery, turn, 3.0, mount=mount, **QUIET)[10:]
    assert np.allclose(arm[:, :3], [-1.5 * 0.16, 4.0 - 0.4 * 0.16, 9.81], atol=2e-4)


def test_free_fall_reads_nothing(scenery: Any) -> None:
    def fall(t: Array) -> tuple[Array, Array]:
        return np.stack([0 * t, 0 * t, -0.5 * 9.81 * t**2], axis=-1), np.zeros((len(t), 3))

    assert np.allclose(read(scenery, fall, 1.0, **QUIET)[5:], 0, atol=1e-8)


def test_reintegration_returns_the_drive(scenery: Any) -> None:
    """Mid-point integration of 60 s of noise-free readings: 0.05 m and 0.01° from the truth."""

    def lively(t: Array) -> tuple[Array, Array]:
        position = np.stack([60 * np.sin(0.2 * t), 40 * np.sin(0.4 * t), 0.03 * np.sin(6 * t)], axis=-1)
        yaw = np.unwrap(np.arctan2(16 * np.cos(0.4 * t), 12 * np.cos(0.2 * t)))
        return position, np.stack([0.03 * np.sin(2 * t), 0.02 * np.cos(3 * t), yaw], axis=-1)

    mount = Mount(position_m=(1.5, 0.0, 1.2), axes="paper_imu")
    drive = scenery.drive(lively, 61.0)
    stamps = [k * TICK_NS for k in range(2, 2 + 60 * 200)]
    r = rows(ImuConfig(mount=mount, **QUIET).build(scenery.world()).measure(drive, stamps))
    truth = drive.ego_motion(stamps).at_mount(mount.T_base_sensor)
    q, v, p = truth.quat_xyzw[0], truth.velocity_world_mps[0].copy(), truth.position_m[0].copy()
    g, dt = np.array([0, 0, -9.81]), 0.005
    for a, b in itertools.pairwise(r):
        following = transforms.quat_multiply(q, transforms.rotvec_to_quat(0.5 * (a[3:] + b[3:]) * dt))
        force = 0.5 * (transforms.quat_rotate(q, a[:3]) + transforms.quat_rotate(following, b[:3])) + g
        p += v * dt + 0.5 * force * dt**2
        v += force * dt
        q = following
    error = transforms.quat_to_rotvec(
        transforms.quat_multiply(transforms.quat_conjugate(q), truth.quat_xyzw[-1])
    )
    assert np.linalg.norm(p - truth.position_m[-1]) < 0.05
    assert np.degrees(np.linalg.norm(error)) < 0.01


def test_speed_is_forward_speed(scenery: Any) -> None:
    """Positive ahead, negative backwards, blind to sideways motion."""
    for speed in (12.0, -3.0):
        drive = scenery.drive(scenery.straight(speed), 0.5)
        sample = SpeedConfig().build(scenery.world()).measure(drive, [200_000_000])[0]
        assert sample.speed_mps == pytest.approx(speed, abs=1e-9)  # type: ignore[attr-defined]


def test_rest_reads_gravity_whatever_the_grade(scenery: Any) -> None:
    """‖f‖ at rest is 9.81 m/s² up to turn-on bias and scale, and exactly so without them."""
    for name, limit in (
        ("paper", 5e-3),
        ("adis16448", 0.06),
        ("tactical", 0.03),
        ("rt3003", 0.06),
        ("consumer", 0.9),
    ):
        mean = np.mean(
            [
                np.linalg.norm(read(scenery, scenery.straight(), 2.0, **ImuConfig.preset_values(name))[:, :3]
                               .mean(axis=0))
            ]
        )  # fmt: skip
        assert mean == pytest.approx(9.81, abs=limit), name


def test_scale_and_misalignment_mix_the_axes(scenery: Any) -> None:
    """At rest only the up axis feels force: its scale on its own axis, its tilt on the two others."""
    readings = []
    for seed in range(300):
        imu = quiet_imu(scale_error=0.01, misalignment_rad=0.003).build(scenery.world(seed=seed))
        readings.append(rows(imu.measure(scenery.drive(scenery.straight(), 0.1), [0]))[0, :3] / 9.81)
    spread = np.std(readings, axis=0)
    assert spread == pytest.approx([0.003, 0.003, 0.01], rel=0.13)
    assert np.mean(readings, axis=0) == pytest.approx([0.0, 0.0, 1.0], abs=0.002)


def test_readings_saturate(scenery: Any) -> None:
    """Range of 0.2 rad/s and 3 m/s²: the turn of 0.4 rad/s and 4 m/s² is cut, gravity too."""
    flat = read(scenery, turn, 1.0, accel_range_mps2=3.0, gyro_range_radps=0.2, **QUIET)[10:]
    assert np.allclose(flat, [0, 3.0, 3.0, 0, 0, 0.2], atol=1e-4)


def test_orientation_on_request(scenery: Any) -> None:
    """None by default; the true attitude of the IMU's own axes, or with the noise asked for."""
    drive, stamps = scenery.drive(scenery.weaving, 3.0), [k * TICK_NS for k in range(500)]
    mount = Mount(position_m=(1.5, 0, 1.2), axes="paper_imu")
    world = scenery.world()
    assert quiet_imu(mount=mount).build(world).measure(drive, [0])[0].quat_xyzw is None
    truth = drive.ego_motion(stamps).at_mount(mount.T_base_sensor).quat_xyzw
    exact = quiet_imu(mount=mount, orientation="truth").build(world).measure(drive, stamps)
    assert np.array_equal([s.quat_xyzw for s in exact], truth)
    noisy = quiet_imu(mount=mount, orientation="truth", orientation_noise_rad=0.02).build(world)
    quats = np.array([s.quat_xyzw for s in noisy.measure(drive, stamps)])
    off = transforms.quat_to_rotvec(transforms.quat_multiply(transforms.quat_conjugate(truth), quats))
    assert off.std(axis=0) == pytest.approx([0.02] * 3, rel=0.1)


def test_readings_begin_with_the_drive_and_never_pause(scenery: Any) -> None:
    """Trackers look for the reading before the first picture: no other sample comes before ours begin."""
    pytest.importorskip("open3d", reason="open3d is not installed")
    sensors = (ImuConfig(), LidarConfig(columns=8), SpeedConfig())
    rig = SensorRig(name="three", sensors=sensors).build(scenery.world([scenery.ground()]))
    drive = scenery.drive(scenery.straight(0.0), 1.0)
    samples = [s for k in range(10) for s in rig.measure(drive, k * STEP_NS - (k == 0), (k + 1) * STEP_NS)]
    inertial = [s.stamp_ns for s in samples if isinstance(s, Imu)]
    assert inertial == list(range(0, 10 * STEP_NS + 1, TICK_NS))
    assert min(s.stamp_ns for s in samples if not isinstance(s, Imu)) == 0
