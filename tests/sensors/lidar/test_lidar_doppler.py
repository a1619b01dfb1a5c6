"""Rates of range: of things at rest by the sensor's own motion, of a car by its relative speed."""

from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.lidar_scans import MOUNT, sweep

from carlaloc_env.core import transforms
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.sensors.lidar_config import LidarConfig

pytest.importorskip("open3d", reason="open3d is not installed")


def aeries(**changes: Any) -> LidarConfig:
    values = {**LidarConfig.preset_values("aeries2"), "mount": MOUNT, "columns": 400, **changes}
    return LidarConfig(**values)


def test_things_at_rest_read_the_sensors_own_velocity(scenery: Any) -> None:
    """−u·v in a lively bend, lever arm included, to the noise of 0.03 m/s, in both clouds."""
    world = scenery.world([scenery.ground(), scenery.box([60, -90, 0], [61, 90, 60])])
    drive = scenery.drive(scenery.weaving, 1.0)
    cloud, labelled = sweep(world, drive, aeries(), 300_000_000)
    assert cloud.doppler_mps is not None
    assert np.array_equal(cloud.doppler_mps, labelled.doppler_mps)
    motion = drive.ego_motion(300_000_000 + cloud.offset_ns.astype(np.int64)).at_mount(MOUNT.T_base_sensor)
    points = cloud.points_xyz_m.astype(np.float64)
    along = transforms.quat_rotate(motion.quat_xyzw, points / np.linalg.norm(points, axis=1)[:, None])
    error = cloud.doppler_mps - -np.sum(along * motion.velocity_world_mps, axis=1)
    assert error.std() == pytest.approx(0.03, rel=0.02)
    assert abs(error.mean()) < 5 * 0.03 / np.sqrt(len(error))
    assert cloud.doppler_mps.min() < -11.0, "what lies ahead comes nearer"


@pytest.mark.parametrize("speed", [15.0, -4.0])
def test_a_car_reads_its_relative_speed(scenery: Any, speed: float) -> None:
    """A car straight ahead that drives away at 15 m/s, or comes at 4, before a sensor at 6 m/s."""
    model = scenery.box([-2.3, -0.9, 0.1], [2.3, 0.9, 3.0])
    world = scenery.world([scenery.ground()], {"saloon": model})

    def frame_at(t: float) -> Any:
        return scenery.frame([[30.0 + speed * t, 1.0, 0.0]], [0.0], abs(speed))

    drive = scenery.drive(scenery.straight(6.0), 0.5, scenery.catalog(["saloon"]), frame_at)
    _, cloud = sweep(world, drive, aeries(doppler_noise_mps=0.0), 200_000_000)
    assert cloud.instance is not None
    assert cloud.doppler_mps is not None
    car = cloud.instance == EGO_INSTANCE + 1
    assert np.count_nonzero(car) > 100
    ahead = cloud.points_xyz_m[:, 0] / np.linalg.norm(cloud.points_xyz_m, axis=1)
    relative = np.where(car, speed - 6.0, -6.0)
    assert np.abs(cloud.doppler_mps - relative * ahead).max() < 1e-4


def test_a_turning_bus_reads_its_turn(scenery: Any) -> None:
    """ω × arm of its corners: a long box that turns on the spot by 0.5 rad/s."""
    world = scenery.world([], {"saloon": scenery.box([-6, -1.2, 0.1], [6, 1.2, 3.0])})

    def frame_at(t: float) -> Any:
        return scenery.frame([[15.0, 0.0, 0.0]], [np.pi / 2 + 0.5 * t], 0.0)

    drive = scenery.drive(scenery.straight(), 0.5, scenery.catalog(["saloon"]), frame_at)
    cloud, _ = sweep(world, drive, aeries(doppler_noise_mps=0.0, range_noise_m=0.0), 200_000_000)
    assert cloud.doppler_mps is not None
    points = cloud.points_xyz_m.astype(np.float64)
    arm = points + np.array(MOUNT.position_m) - np.array([15.0, 0.0, 0.0])
    turning = 0.5 * np.stack([-arm[:, 1], arm[:, 0], 0 * arm[:, 0]], axis=1)
    expected = np.sum(points * turning, axis=1) / np.linalg.norm(points, axis=1)
    assert np.abs(expected).max() > 2.0
    assert np.abs(cloud.doppler_mps - expected).max() < 1e-3


def test_the_own_body_stands_still(scenery: Any) -> None:
    body = scenery.box([-0.95, -0.92, 0.2], [3.75, 0.92, 1.45])
    world = scenery.world([scenery.ground()], {"ego": body})
    config = aeries(ego_returns=True, doppler_noise_mps=0.0, elevations_deg=(-30.0, -20.0), range_min_m=0.1)
    _, cloud = sweep(world, scenery.drive(scenery.straight(9.0), 0.5), config, 100_000_000)
    assert cloud.instance is not None
    assert cloud.doppler_mps is not None
    own = cloud.instance == EGO_INSTANCE
    assert np.count_nonzero(own) > 50
    assert np.all(cloud.doppler_mps[own] == 0.0)
