"""Radar: signs, the radar equation, Swerling's detection probability, cells, ghosts, ego velocity."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from shared_fixtures.readings.radar_scans import HEIGHT, STEP, config, frames

from carlaloc_env.core import transforms
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.radar_detector import CLUTTER, GHOST, THING

pytest.importorskip("open3d", reason="open3d is not installed")


def test_doppler_is_positive_when_the_distance_grows(scenery: Any) -> None:
    """Driving at 10 m/s towards a wall reads −10; a car that leaves at 6 m/s while we stand reads +6."""
    world = scenery.world([scenery.box([60, -20, -5], [61, 20, 15])])
    (scan,) = frames(world, scenery.drive(scenery.straight(10.0), 0.3), config(), 1)
    wall = (np.abs(scan.azimuth_rad) < 0.05) & (np.abs(scan.elevation_rad) < 0.05)
    assert np.count_nonzero(wall) >= 3
    # −v·cos of the angle to the axis, which is above 1 − 3e-3 here.
    assert scan.doppler_mps[wall] == pytest.approx(-10.0, abs=0.1)

    world = scenery.world([], {"saloon": scenery.box([-2, -1, 0], [2, 1, 1.5])})
    drive = scenery.drive(
        scenery.straight(), 0.3, scenery.catalog(["saloon"]),
        lambda t: scenery.frame([[20 + 6 * t, 0, 0]], [0.0], 6.0),
    )  # fmt: skip
    (scan,) = frames(world, drive, config(), 1)
    assert len(scan.range_m) > 0
    assert np.all(scan.instance == EGO_INSTANCE + 1)
    assert np.all(scan.doppler_mps > 5.0)


def test_doppler_is_the_rate_of_the_true_distance(scenery: Any) -> None:
    """A small thing passing aslant: Doppler against the difference of distances over 50 ms."""
    world = scenery.world([], {"saloon": scenery.box([-0.1, -0.1, 0], [0.1, 0.1, 1.5])})
    velocity = np.array([-7.0, 5.0, 0.0])

    def place(t: float) -> Any:
        return np.array([[40.0, -12.0, 0.0]]) + t * velocity

    catalog = dataclasses.replace(scenery.catalog(["saloon"]), size_m=np.full((1, 3), 0.2, np.float32))
    heading = math.atan2(5, -7)
    drive = scenery.drive(
        scenery.straight(8.0), 1.0, catalog, lambda t: scenery.frame(place(t), [heading], math.hypot(7, 5))
    )
    seen = []
    for k, scan in enumerate(frames(world, drive, config(reference_pd=0.999), 15), start=1):
        gap = [np.linalg.norm(place(t)[0] - [8 * t, 0, 0]) for t in (k * 0.05 - 1e-4, k * 0.05 + 1e-4)]
        truth = (gap[1] - gap[0]) / 2e-4
        seen += list(scan.doppler_mps - truth)
    assert len(seen) >= 10
    assert np.abs(np.mean(seen)) < 0.1
    assert np.max(np.abs(seen)) < 0.5


def test_angles_are_left_and_up(scenery: Any) -> None:
    """What stands left and high has positive azimuth and elevation, and the points lie on it."""
    box = scenery.box([30, 9.5, 4], [31, 10.5, 5], Material.METAL_PAINTED, Tag.TRAFFIC_SIGN)
    scans = frames(scenery.world([box]), scenery.drive(scenery.straight(), 0.6), config(), 8)
    points = np.concatenate([scan.points_xyz_m for scan in scans])
    assert len(points) > 5
    assert np.concatenate([s.azimuth_rad for s in scans]).min() > 0
    assert np.concatenate([s.elevation_rad for s in scans]).min() > 0
    assert np.median(points, axis=0) == pytest.approx([30.0, 10.0, 4.5 - HEIGHT], abs=0.5)


def test_a_hidden_car_is_silent_and_a_half_hidden_one_weaker(scenery: Any) -> None:
    """A wall before the whole car, and one before its left half."""
    models = {"saloon": scenery.box([-2.3, -0.95, 0.0], [2.3, 0.95, 1.5])}
    catalog = dataclasses.replace(scenery.catalog(["saloon"]), size_m=np.array([[4.6, 1.9, 1.5]], np.float32))
    drive = scenery.drive(scenery.straight(), 3.2, catalog, lambda t: scenery.frame([[40, 0, 0]], [0.0]))
    walls = {"none": [], "half": [[30, 0, 0], [30.2, 3, 3]], "all": [[30, -3, 0], [30.2, 3, 3]]}
    total = {}
    for name, wall in walls.items():
        static = [scenery.box(*wall)] if wall else []
        scans = frames(scenery.world(static, models), drive, config(), 60)
        mine = [10 ** (0.1 * s.rcs_dbsm[s.instance == EGO_INSTANCE + 1].astype(float)) for s in scans]
        total[name] = sum(float(values.sum()) for values in mine)
    assert total["all"] == 0.0
    assert total["half"] / total["none"] == pytest.approx(0.5, abs=0.2)


def test_clutter_is_poisson_and_looks_like_the_world_at_rest(scenery: Any) -> None:
    drive = scenery.drive(scenery.straight(12.0), 20.3)
    scans = frames(scenery.world(), drive, config(clutter_mean=4.0), 400)
    counts = np.array([len(scan.range_m) for scan in scans])
    assert counts.mean() == pytest.approx(4.0, abs=3 * 2 / 20)
    assert counts.var() == pytest.approx(4.0, rel=0.25)
    azimuth, elevation, doppler, origin = (
        np.concatenate([getattr(s, n) for s in scans])
        for n in ("azimuth_rad", "elevation_rad", "doppler_mps", "origin")
    )
    assert np.all(origin == CLUTTER)
    rest = doppler + 12.0 * np.cos(azimuth) * np.cos(elevation)
    assert rest.std() == pytest.approx(0.2, rel=0.1)


def test_ghosts_are_mirror_images(scenery: Any) -> None:
    """A car on the left, a wall on the right at y = −8: its image lies at −16 − y and moves along."""
    wall = scenery.box([0, -9, -1], [80, -8, 8], Material.CONCRETE, Tag.WALL)
    world = scenery.world([wall], {"saloon": scenery.box([-2, -1, 0.2], [2, 1, 1.6])})
    catalog = dataclasses.replace(scenery.catalog(["saloon"]), size_m=np.array([[4, 2, 1.6]], np.float32))
    drive = scenery.drive(
        scenery.straight(), 3.2, catalog, lambda t: scenery.frame([[15 + 4 * t, 5, 0]], [0.0], 4.0)
    )
    scans = frames(world, drive, config(ghosts=True), 50)
    hits = 0
    for k, scan in enumerate(scans, start=1):
        ghost = scan.origin == GHOST
        hits += np.count_nonzero(ghost)
        if not ghost.any():
            continue
        x, y, _ = scan.points_xyz_m[ghost].T
        assert np.all(np.abs(y - (-21.0)) < 2.5)
        assert np.all(np.abs(x - (15 + 4 * k * 0.05)) < 3.0)
        expected = 4.0 * x / np.linalg.norm(scan.points_xyz_m[ghost], axis=-1)
        assert scan.doppler_mps[ghost] == pytest.approx(expected, abs=0.5)
        assert np.all(scan.instance[ghost] == 0)
    assert hits > 20
    gone = frames(scenery.world([], {"saloon": world.library.meshes[0]}), drive, config(ghosts=True), 50)
    assert not any(np.any(scan.origin == GHOST) for scan in gone), "no mirror, no image"


def test_ego_velocity_from_detections_at_rest(scenery: Any) -> None:
    """Least squares of v_r = −û·v over three radars against the truth: within 0.05 m/s in every frame."""
    rng = np.random.default_rng(6)
    static = [scenery.ground()]
    for _ in range(60):
        x, y = rng.uniform(-20, 80), rng.choice([-1, 1]) * rng.uniform(8, 25)
        static.append(scenery.box([x, y, 0], [x + 3, y + 3, rng.uniform(3, 9)]))
    world = scenery.world(static)
    drive = scenery.drive(scenery.weaving, 2.0)
    place = (1.2, 0.0, 1.85)
    radars = [
        config(name=name, mount=Mount(position_m=place, rpy_deg=(0, 0, yaw)), clutter_mean=4.0, ghosts=True)
        for name, yaw in (("front", 0.0), ("left", 120.0), ("right", -120.0))
    ]
    scans = [frames(world, drive, radar, 30) for radar in radars]
    for k in range(30):
        rows, speeds = [], []
        motion = drive.ego_motion([(k + 1) * STEP])
        at_mount = motion.at_mount(transforms.from_rotation(np.eye(3), place))
        for radar, mine in zip(radars, scans, strict=True):
            scan = mine[k]
            rest = scan.origin == THING
            points = scan.points_xyz_m[rest].astype(float)
            unit = points / np.linalg.norm(points, axis=-1, keepdims=True)
            rows.append(unit @ radar.mount.T_base_sensor[:3, :3].T)
            speeds.append(-scan.doppler_mps[rest])
        estimate = np.linalg.lstsq(np.concatenate(rows), np.concatenate(speeds), rcond=None)[0]
        truth = transforms.quat_rotate(
            transforms.quat_conjugate(at_mount.quat_xyzw), at_mount.velocity_world_mps
        )[0]
        assert np.abs(estimate - truth)[:2].max() < 0.05
