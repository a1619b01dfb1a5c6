"""What the environment tells about other road users joins to what its sensors see of them."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from shared_fixtures.drives.straight_drives import MakeEnv
from shared_fixtures.worlds.render_scenes import need_opengl

from carlaloc_env.core import transforms
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.envs.carlaloc_env import CarlaLocEnv
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import ObjectList, PointCloud, SemanticImage
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.camera_config import CameraConfig
from carlaloc_env.sensors.lidar_config import LidarConfig

GO = np.array([0.0, 0.6], np.float32)


@pytest.fixture(scope="module")
def steps() -> Iterator[list[dict[str, Any]]]:
    """What is told of some seconds among traffic, seen by a LiDAR and a small camera."""
    pytest.importorskip("open3d", reason="open3d is not installed")
    need_opengl()
    paper = rig_by_name("paper").sensors
    lidar = next(config for config in paper if isinstance(config, LidarConfig))
    left = next(config for config in paper if isinstance(config, CameraConfig))
    camera = CameraConfig(
        name="left", mount=left.mount, pinhole=Pinhole.from_fov(160, 90, 90.0), outputs=("semantic",)
    )
    rig = SensorRig(name="both", sensors=(lidar, camera))
    env = CarlaLocEnv(rig=rig, info=("samples", "truth", "visibility"))
    env.reset(seed=7)
    yield [env.step(GO)[4] for _ in range(60)][20::2]
    env.close()


def samples_of(info: dict[str, Any], kind: type) -> list[Any]:
    return [sample for sample in info["samples"] if isinstance(sample, kind)]


def test_points_and_pixels_carry_ids_of_listed_objects(steps: list[dict[str, Any]]) -> None:
    """Every actor's point and pixel has a listed id, and the class that the list gives it."""
    seen = {PointCloud: 0, SemanticImage: 0}
    for info in steps:
        objects: ObjectList = info["objects"]
        tag_of = dict(zip(objects.id.tolist(), objects.tag.tolist(), strict=True))
        assert len(tag_of) == len(objects.id)
        for kind in seen:
            for sample in samples_of(info, kind):
                if sample.instance is None:
                    continue
                actors = sample.instance > EGO_INSTANCE
                pairs = set(zip(sample.instance[actors].tolist(), sample.tag[actors].tolist(), strict=True))
                assert all(
                    Tag.RIDER in (tag, tag_of[instance]) or tag == tag_of[instance] for instance, tag in pairs
                )
                seen[kind] += len(pairs)
    assert min(seen.values()) > 10


def test_points_lie_in_the_box_of_their_object(steps: list[dict[str, Any]]) -> None:
    """Carried by the object's velocity to the time of the list, LiDAR points fill its box."""
    shares = []
    lidar = next(config for config in rig_by_name("paper").sensors if isinstance(config, LidarConfig))
    T_base_lidar = lidar.mount.T_base_sensor
    for info in steps:
        objects: ObjectList = info["objects"]
        cloud = next(c for c in samples_of(info, PointCloud) if c.instance is not None)
        truth = info["truth"]
        for k, instance in enumerate(objects.id):
            mine = cloud.instance == instance
            if np.count_nonzero(mine) < 30:
                continue
            late = 1e-9 * (info["stamp_ns"] - cloud.stamp_ns - cloud.offset_ns[mine].astype(np.float64))
            base = truth.position_m - late[:, None] * truth.velocity_world_mps
            on_car = transforms.apply(T_base_lidar, cloud.points_xyz_m[mine])
            attitude = np.broadcast_to(truth.quat_xyzw, (len(on_car), 4))
            world = base + transforms.quat_rotate(attitude, on_car) + late[:, None] * objects.velocity_mps[k]
            back = np.broadcast_to(transforms.quat_conjugate(objects.quat_xyzw[k]), (len(world), 4))
            local = np.abs(transforms.quat_rotate(back, world - objects.position_m[k]))
            shares.append(np.mean(np.all(local < 0.5 * objects.size_m[k] + 0.25, axis=-1)))
    assert len(shares) > 10
    assert np.median(shares) > 0.99


def test_what_the_lidar_sees_counts_as_visible(steps: list[dict[str, Any]]) -> None:
    """Objects with many points are visible, near objects without any are mostly hidden."""
    with_points, without = [], []
    for info in steps:
        objects: ObjectList = info["objects"]
        cloud = next(c for c in samples_of(info, PointCloud) if c.instance is not None)
        count = np.array([np.count_nonzero(cloud.instance == instance) for instance in objects.id])
        near = objects.distance_m < 60.0
        with_points += objects.visible[near & (count > 50)].tolist()
        without += objects.visible[near & (count == 0)].tolist()
        assert np.isnan(objects.visible[objects.distance_m > 120.0]).all()
    assert len(with_points) > 5
    assert min(with_points) > 0.05
    assert np.mean(without) < 0.1
    assert np.mean(with_points) > 0.5


def test_visibility_is_unknown_unless_asked_for(make_env: MakeEnv) -> None:
    """Without the option no ray is cast: all else is told."""
    env = make_env(map="Town03", traffic="dynamic", info=("objects",))
    _, info = env.reset(seed=3)
    objects = info["objects"]
    assert len(objects.id) > 50
    assert np.isnan(objects.visible).all()
    assert np.isfinite(objects.velocity_mps).all()
    assert objects.stamp_ns == info["stamp_ns"]
