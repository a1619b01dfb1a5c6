"""Truth of road users: boxes, velocities, visibility, and ids that join with points."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core.transforms import quat_rotate
from carlaloc_env.samples import PointCloud
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.ground_truth import objects_at, truth_at

pytest.importorskip("open3d", reason="open3d is not installed")
lidar = pytest.importorskip("carlaloc_env.sensors.lidar.lidar")

BODY = ([-2.3, -0.9, 0.0], [2.3, 0.9, 1.5])


def scene(scenery: Any, static: list[Any], frame_at: Any, count: int = 1, seconds: float = 1.0) -> Any:
    world = scenery.world(static, {"saloon": scenery.box(*BODY)})
    size = np.tile(np.array([4.6, 1.8, 1.5], np.float32), (count, 1))
    catalog = dataclasses.replace(scenery.catalog(["saloon"] * count), size_m=size)
    return world, scenery.drive(scenery.straight(), seconds, catalog, frame_at)


def test_velocity_and_yaw_rate_are_those_of_the_shown_motion(scenery: Any) -> None:
    """A car on a circle of 20 m at 10 m/s, at steps and between them."""

    def frame_at(t: float) -> Any:
        a = 0.5 * t
        return scenery.frame([[20 * math.sin(a), 20 * (1 - math.cos(a)), 0.0]], [a], 10.0)

    _, drive = scene(scenery, [], frame_at)
    for stamp in (500_000_000, 525_000_000, 530_000_000):
        found = objects_at(drive, stamp)
        begin = (stamp - 1) // 50_000_000 * 0.05
        a = 0.5 * (begin + 0.025)
        assert found.velocity_mps[0] == pytest.approx([10 * math.cos(a), 10 * math.sin(a), 0], abs=0.01)
        assert found.yaw_rate_radps[0] == pytest.approx(0.5, abs=1e-3)
        ahead = quat_rotate(found.quat_xyzw, np.array([[1.0, 0.0, 0.0]]))[0]
        heading = 0.5 * stamp * 1e-9
        assert ahead == pytest.approx([math.cos(heading), math.sin(heading), 0], abs=1e-3)
    first = objects_at(drive, 0)
    assert first.velocity_mps[0] == pytest.approx([10.0, 0.0, 0.0])
    assert np.isnan(first.visible[0]), "without rays visibility is unknown"


def test_boxes_hold_the_points_that_carry_their_ids(scenery: Any) -> None:
    """Points of a cloud, put back into the world, lie on the box of their id at their own time."""

    def frame_at(t: float) -> Any:
        return scenery.frame([[10, 4 + 3 * t, 0], [18, -5, 0.2]], [1.3, -0.4], [3.0, 0.0], [0.0, 0.05])

    world, drive = scene(scenery, [scenery.ground()], frame_at, count=2)
    mount = Mount(position_m=(1.2, 0, 1.85))
    cloud = lidar.LidarConfig(mount=mount, range_noise_m=0.0).build(world).measure(drive, [200_000_000])[1]
    assert isinstance(cloud, PointCloud)
    for k in range(2):
        mine = cloud.instance == EGO_INSTANCE + 1 + k
        assert np.count_nonzero(mine) > 100
        times = cloud.stamp_ns + cloud.offset_ns[mine].astype(np.int64)
        box = objects_at(drive, int(np.median(times)))
        assert box.id[k] == EGO_INSTANCE + 1 + k
        points = cloud.points_xyz_m[mine] + np.array([1.2, 0, 1.85]) - box.position_m[k]
        back = box.quat_xyzw[k] * [-1, -1, -1, 1]
        local = np.abs(quat_rotate(np.broadcast_to(back, (len(points), 4)), points)) / (0.5 * box.size_m[k])
        assert local.max() < 1.06, "3 m/s over a few milliseconds at most"
        assert np.abs(local.max(axis=-1) - 1.0).max() < 0.06


@pytest.mark.parametrize(
    ("wall", "expected"),
    [(None, 1.0), ([[20, 0, -1], [20.2, 3, 4]], 0.5), ([[20, -4, -1], [20.2, 4, 4]], 0.0)],
)
def test_visible_share(scenery: Any, wall: Any, expected: float) -> None:
    """Free, its left half behind a wall, and all of it; seen square on."""
    static = [scenery.ground()] + ([scenery.box(*wall)] if wall else [])
    world, drive = scene(scenery, static, lambda t: scenery.frame([[40, 0, 0]], [math.pi / 2]))
    found = objects_at(drive, 100_000_000, rays=world.rays())
    assert found.visible[0] == pytest.approx(expected, abs=0.15)
    assert found.distance_m[0] == pytest.approx(math.hypot(38.8, 1.1), abs=0.01)


def test_far_objects_are_listed_without_visibility(scenery: Any) -> None:
    world, drive = scene(scenery, [], lambda t: scenery.frame([[300, 0, 0]], [0.0]))
    found = objects_at(drive, 0, rays=world.rays())
    assert len(found.id) == 1
    assert np.isnan(found.visible[0])
    assert found.tag[0] == Tag.CAR


def test_truth_holds_the_acceleration(scenery: Any) -> None:
    """Uniform circular motion: v²/r towards the centre."""

    def circle(t: Any) -> Any:
        a = 0.4 * t
        position = np.stack([25 * np.sin(a), 25 * (1 - np.cos(a)), 0 * a], axis=-1)
        return position, np.stack([0 * a, 0 * a, a], axis=-1)

    (truth,) = truth_at(scenery.drive(circle, 2.0), [1_000_000_000], np.eye(4))
    assert truth.acceleration_world_mps2 == pytest.approx(
        [-4 * math.sin(0.4), 4 * math.cos(0.4), 0], abs=1e-3
    )
