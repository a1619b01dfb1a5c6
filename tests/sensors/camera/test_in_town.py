"""Cameras in Town03: depth against rays, labels against the LiDAR, disparity, rates of events."""

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures.worlds.render_scenes import need_opengl, rays_z1
from shared_fixtures.worlds.scenes import Scenery

from carlaloc_env.core import transforms
from carlaloc_env.core.array_types import Array
from carlaloc_env.core.camera_model import Pinhole
from carlaloc_env.core.clock import TICK_S
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensor_stage import SensorStage
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.camera_config import CameraConfig, EventConfig
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.timeline.ego_spline import EgoTrack
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.town.town import Town
from carlaloc_env.weather.presets import PRESETS

pytestmark = pytest.mark.soak
SMALL = Pinhole.from_fov(640, 360, 90.0)
SPEED_MPS = 10.0
STAMPS_NS = (0, 6_000_000_000, 14_000_000_000)
CARS = ("saloon", "van", "bus", "saloon")


@pytest.fixture(scope="module")
def stage(town03: Town) -> Iterator[SensorStage]:
    pytest.importorskip("open3d", reason="open3d is not installed")
    need_opengl()
    stage = SensorStage(town03, seed=5, weather=PRESETS["ClearNoon"])
    stage.renderer()
    yield stage
    stage.close()


@pytest.fixture(scope="module")
def drive(town03: Town) -> Timeline:
    """At 10 m/s along the route, with cars before and beside that keep their distance."""
    ticks = np.arange(int(15.2 / TICK_S))
    way = town03.route.at(60.0 + SPEED_MPS * TICK_S * ticks)
    quat = transforms.rpy_to_quat(np.zeros(len(ticks)), -way.pitch_rad, way.heading_rad)
    catalog = Scenery.catalog(CARS, [Tag.CAR, Tag.CAR, Tag.BUS, Tag.CAR], tint=160)
    timeline = Timeline(catalog, ego=EgoTrack.from_arrays(way.position_m, quat))
    ahead, left = np.array([12.0, 25.0, 45.0, 16.0]), np.array([0.0, -1.0, 0.5, 3.6])
    for step in range(len(ticks) // 10 + 1):
        at = town03.route.at(60.0 + SPEED_MPS * 0.05 * step + ahead)
        aside = np.stack([-np.sin(at.heading_rad), np.cos(at.heading_rad), 0 * left], -1)
        timeline.append_step(
            Scenery.frame(
                at.position_m + left[:, None] * aside,
                heading_rad=at.heading_rad,
                pitch_rad=at.pitch_rad,
                speed_mps=SPEED_MPS,
                travelled_m=SPEED_MPS * 0.05 * step,
            ),
            np.ones(64, np.uint8),
        )
    return timeline


def camera(stage: SensorStage, outputs: tuple[str, ...], y_m: float = 0.2, **changes: object) -> object:
    mount = Mount(position_m=(1.8, y_m, 1.6), axes="optical")
    settings = {"name": "left", "mount": mount, "pinhole": SMALL, "outputs": outputs, **changes}
    return CameraConfig(**settings).build(stage)  # type: ignore[arg-type]


def away_from_edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels whose eight neighbours lie on one plane with them, by inverse depth."""
    inverse = 1.0 / np.where(depth_m > 0, depth_m, 1e6)
    bent = np.zeros_like(inverse)
    for axis in (0, 1):
        one, other = np.roll(inverse, 1, axis), np.roll(inverse, -1, axis)
        bent = np.maximum(bent, np.abs(one + other - 2 * inverse))
    calm = bent < 0.004 * inverse
    calm[[0, -1]] = calm[:, [0, -1]] = False
    whole = calm.copy()
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            whole &= np.roll(calm, (dy, dx), (0, 1))
    return whole


def test_depth_and_labels_are_those_of_rays(stage: SensorStage, drive: Timeline) -> None:
    """A ray through every pixel's centre, town and cars: 1 cm + 0.1 % on 99.9 % away from edges."""
    sensor = camera(stage, ("depth", "semantic"))
    good, same = [], []
    for stamp in STAMPS_NS:
        depth, semantic = sensor.measure(drive, [stamp])  # type: ignore[attr-defined]
        T = drive.ego_motion([stamp]).T_world_frame[0] @ sensor.config.mount.T_base_sensor  # type: ignore[attr-defined]
        along = rays_z1(SMALL).reshape(-1, 3)
        length = np.linalg.norm(along, axis=1)
        directions = (along / length[:, None]) @ T[:3, :3].T
        origins = np.broadcast_to(T[:3, 3], directions.shape)
        hits = stage.rays().cast(origins, directions, np.full(len(along), stamp), drive, 120.0)
        expected = (hits.range_m / length).reshape(depth.depth_m.shape)
        near = np.isfinite(expected) & away_from_edges(depth.depth_m) & (depth.depth_m > 0)
        good.append(np.abs(depth.depth_m - expected)[near] < 0.01 + 0.001 * expected[near])
        same.append((semantic.tag == hits.tag.reshape(near.shape))[near])
    good, same = np.concatenate(good), np.concatenate(same)
    assert len(good) > 200_000
    assert good.mean() >= 0.999
    assert same.mean() >= 0.999


def test_lidar_and_camera_call_things_by_the_same_tags(stage: SensorStage, drive: Timeline) -> None:
    """Points of a sweep of no time, seen in the picture of that time, at the depth that it shows.

    At an outline the middle of a pixel and a point within it may lie on different things: of points in the
    coarser picture, nearly three times as many do.
    """
    pinhole = Pinhole.from_fov(1920, 1080, 90.0)
    rig = rig_by_name("paper")
    mount = rig.of_kind("lidar")[0].mount
    lidar = LidarConfig(mount=mount, range_noise_m=0.0, outputs=("semantic",)).build(stage)
    sensor = camera(stage, ("depth", "semantic"), pinhole=pinhole)
    agree, within = [], []
    square = np.ones((3, 3), np.uint8)
    for stamp in STAMPS_NS:
        (cloud,) = lidar.measure(drive, [stamp])
        # Points that are fired within 1 ms, at the middle of the sweep: straight ahead.
        offset = cloud.offset_ns.astype(np.int64)  # type: ignore[attr-defined]
        for middle in range(10_000_000, 40_000_000, 5_000_000):
            which = np.abs(offset - middle) < 500_000
            points = cloud.points_xyz_m[which]  # type: ignore[attr-defined]
            T = transforms.invert(sensor.config.mount.T_base_sensor) @ mount.T_base_sensor  # type: ignore[attr-defined]
            seen = transforms.apply(T, points)
            depth, semantic = sensor.measure(drive, [stamp + middle])  # type: ignore[attr-defined]
            uv = pinhole.project(seen)
            inside = np.isfinite(uv).all(axis=1) & (uv > 0).all(axis=1)
            inside &= (uv[:, 0] < pinhole.width_px - 1) & (uv[:, 1] < pinhole.height_px - 1)
            u, v = np.rint(uv[inside]).astype(int).T
            z = seen[inside, 2]
            both = np.abs(depth.depth_m[v, u] - z) < 0.02 * z + 0.05
            tag = semantic.tag  # type: ignore[attr-defined]
            agree.append((tag[v, u] == cloud.tag[which][inside])[both])  # type: ignore[attr-defined]
            within.append((cv2.erode(tag, square) == cv2.dilate(tag, square))[v, u][both])
    agree, inner = np.concatenate(agree), np.concatenate(within)
    assert inner.sum() > 3000
    assert inner.mean() > 0.9
    assert agree[inner].mean() >= 0.9995
    assert agree.mean() >= 0.997


def test_disparity_times_depth_is_256(stage: SensorStage, drive: Timeline) -> None:
    """The right picture's depth where the left one's depth says that the point must be."""
    pinhole = Pinhole(width_px=1280, height_px=240, fx_px=640.0, fy_px=640.0, cx_px=640.0, cy_px=60.0)
    left, right = (camera(stage, ("depth",), y_m=y, pinhole=pinhole) for y in (0.2, -0.2))
    found = []
    for stamp in STAMPS_NS:
        a, b = (sensor.measure(drive, [stamp])[0].depth_m for sensor in (left, right))  # type: ignore[attr-defined]
        calm = away_from_edges(a) & (a > 2.0) & (a < 100.0)
        row, column = np.nonzero(calm)
        disparity = 256.0 / a[row, column]
        place = column - disparity
        keep = place > 1
        row, place, disparity = row[keep], place[keep], disparity[keep]
        low = np.floor(place).astype(int)
        inverse = [1.0 / np.maximum(b[row, low + k], 0.1) for k in (0, 1)]
        there = 256.0 * (inverse[0] + (place - low) * (inverse[1] - inverse[0]))
        # A point that another thing hides from the right camera shows that thing, which is nearer.
        hidden = there > disparity * 1.05 + 0.5
        found.append(np.abs(there - disparity)[~hidden] < 0.5)
    found = np.concatenate(found)
    assert len(found) > 100_000
    assert found.mean() > 0.999


def test_event_rate_of_a_drive_at_noon(stage: SensorStage, drive: Timeline) -> None:
    """1 to 60 million events a second of 1280×720 pixels at 10 m/s; standing still none but noise."""
    sensor = camera(stage, ("events",), pinhole=Pinhole.from_fov(320, 180, 90.0))
    batches = sensor.measure(drive, list(range(0, 500_000_001, 50_000_000)))[1:]  # type: ignore[attr-defined]
    rate = 16 * sum(len(batch.events) for batch in batches) / 0.5
    assert 1e6 < rate < 60e6
    ons = np.concatenate([batch.events["p"] for batch in batches])
    assert 0.4 < ons.mean() < 0.6


def test_a_standing_camera_in_a_still_town_is_silent(stage: SensorStage, drive: Timeline) -> None:
    still = Timeline(drive.catalog, ego=EgoTrack.from_arrays(*_held(drive)))
    for _ in range(8):
        still.append_step(drive.actors_at(0), np.ones(64, np.uint8))
    events = EventConfig(leak_hz=0.0, shot_hz=0.0)
    sensor = camera(stage, ("events",), pinhole=Pinhole.from_fov(320, 180, 90.0), events=events)
    batches = sensor.measure(still, [0, 50_000_000, 100_000_000])  # type: ignore[attr-defined]
    assert [len(batch.events) for batch in batches] == [0, 0, 0]


def _held(drive: Timeline) -> tuple[Array, Array]:
    at = drive.ego_motion([0])
    return np.repeat(at.position_m, 100, axis=0), np.repeat(at.quat_xyzw, 100, axis=0)
