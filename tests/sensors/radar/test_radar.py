"""Radar: signs, the radar equation, Swerling's detection probability, cells, ghosts, ego velocity."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from carlaloc_env.core import transforms
from carlaloc_env.core.errors import ConfigError
from carlaloc_env.samples import RadarScan
from carlaloc_env.scene.materials import Material
from carlaloc_env.scene.mesh import EGO_INSTANCE
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Mount
from carlaloc_env.sensors.radar.config import RadarConfig
from carlaloc_env.sensors.radar.cross_sections import actor_rcs_dbsm, texture
from carlaloc_env.sensors.radar.detector import CLUTTER, GHOST, THING
from carlaloc_env.sensors.radar.radar_equation import (
    Echoes,
    detect,
    errors,
    mean_snr,
    merge_cells,
    rain_loss_db_per_m,
    snr_at,
)
from carlaloc_env.weather.parameters import WeatherParameters

pytest.importorskip("open3d", reason="open3d is not installed")

HEIGHT = 0.75
STEP = 50_000_000


def config(**changes: Any) -> RadarConfig:
    """A radar at the origin of the car, without clutter and ghosts."""
    plain = RadarConfig(mount=Mount(position_m=(0.0, 0.0, HEIGHT)), clutter_mean=0.0, ghosts=False)
    return dataclasses.replace(plain, **changes)


def frames(world: Any, drive: Any, radar: RadarConfig, count: int, first: int = 1) -> list[RadarScan]:
    sensor = radar.build(world)
    scans = sensor.measure(drive, [(first + k) * STEP for k in range(count)])
    assert all(isinstance(scan, RadarScan) for scan in scans)
    return scans  # type: ignore[return-value]


def echoes(count: int, **columns: Any) -> Echoes:
    """Echoes of 1 m² on the axis at 50 m, unless said otherwise."""
    values: dict[str, Any] = {
        "range_m": 50.0, "azimuth_rad": 0.0, "elevation_rad": 0.0, "doppler_mps": 0.0, "rcs_m2": 1.0,
        "tag": 0, "instance": 0,
    } | columns  # fmt: skip
    kinds = {"tag": np.uint8, "instance": np.uint32}
    return Echoes(
        **{k: np.broadcast_to(np.asarray(v, kinds.get(k, np.float64)), (count,)).copy()
           for k, v in values.items()}
    )  # fmt: skip


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


def test_reference_and_fourth_power() -> None:
    """Pd at the reference is as configured; twice the distance costs as much as a 1/16 of the target."""
    reference = snr_at(0.9, 1e-6)
    assert 1e-6 ** (1 / (1 + reference)) == pytest.approx(0.9)
    far = mean_snr(
        echoes(3, range_m=[100.0, 200.0, 100.0], rcs_m2=[1.0, 1.0, 1 / 16]),
        at_reference=reference, reference_m=100.0, pattern=np.ones(3),
    )  # fmt: skip
    assert far == pytest.approx(reference * np.array([1, 1 / 16, 1 / 16]))


@pytest.mark.parametrize("snr_db", [5.0, 13.0, 21.0])
def test_detection_probability_is_swerlings(snr_db: float) -> None:
    """Pd = Pfa^(1/(1+S)) over 40 000 fluctuating echoes, three standard errors."""
    snr, pfa, count = 10 ** (0.1 * snr_db), 1e-4, 40_000
    uniform = 1.0 - np.random.default_rng(2).random(count)
    seen, measured = detect(np.full(count, snr), pfa, uniform)
    expected = pfa ** (1 / (1 + snr))
    assert len(seen) / count == pytest.approx(expected, abs=3 * math.sqrt(expected / count))
    # What exceeds the threshold does so by an exponential amount of mean 1 + S.
    assert measured.mean() == pytest.approx(-math.log(pfa) + snr, rel=0.1)


@pytest.mark.parametrize("distance", [65.0, 125.0, 175.0])
def test_a_walker_is_found_as_often_as_theory_says(scenery: Any, distance: float) -> None:
    """The whole chain over 300 frames: rays, shares, cells, antenna, R⁻⁴ and Swerling's probability."""
    radar = config(
        azimuth_resolution_deg=30.0, elevation_resolution_deg=30.0, range_resolution_m=10.0,
        doppler_resolution_mps=5.0, columns=1, rows=1,
        mount=Mount(position_m=(0.0, 0.0, -1.0)),
    )  # fmt: skip
    azimuth = math.radians(15.0)
    place = [distance * math.cos(azimuth), distance * math.sin(azimuth), 0.0]
    world = scenery.world([], {"saloon": scenery.box([-0.25, -0.25, 0], [0.25, 0.25, 1.7])})
    catalog = dataclasses.replace(
        scenery.catalog(["saloon"], Tag.PEDESTRIAN), size_m=np.array([[0.5, 0.5, 1.7]], np.float32)
    )
    drive = scenery.drive(scenery.straight(), 15.2, catalog, lambda t: scenery.frame([place], [azimuth]))
    found = [len(scan.range_m) > 0 for scan in frames(world, drive, radar, 300)]
    rcs = actor_rcs_dbsm(np.array([Tag.PEDESTRIAN], np.uint8), np.array([np.pi]))[0]
    antenna = -6.0 * (15 / 60) ** 2
    snr = snr_at(0.9, 1e-6) * 10 ** (0.1 * (rcs + antenna)) * (100 / distance) ** 4
    expected = 1e-6 ** (1 / (1 + snr))
    assert np.mean(found) == pytest.approx(expected, abs=3.3 * math.sqrt(expected * (1 - expected) / 300))


def test_cells_add_up_and_hold_one_detection_each() -> None:
    """Cross-sections in a cell add; the place is their weighted middle; labels are the strongest's."""
    cell = (0.5, 0.1, 0.1, 0.2)
    merged = merge_cells(
        echoes(4, range_m=[10.1, 10.4, 10.1, 30.0], azimuth_rad=[0.01, 0.05, 0.15, 0.01],
               rcs_m2=[1.0, 3.0, 2.0, 5.0], instance=[7, 8, 9, 10]),
        cell,
    )  # fmt: skip
    assert len(merged) == 3
    order = np.argsort(merged.range_m * 100 + merged.azimuth_rad)
    assert sorted(merged.rcs_m2) == [2.0, 4.0, 5.0]
    first = np.flatnonzero(merged.rcs_m2 == 4.0)[0]
    assert merged.range_m[first] == pytest.approx((10.1 + 3 * 10.4) / 4)
    assert merged.azimuth_rad[first] == pytest.approx((0.01 + 3 * 0.05) / 4)
    assert merged.instance[first] == 8
    assert len(order) == 3


def test_errors_fall_with_the_signal_and_have_a_floor() -> None:
    normal = np.random.default_rng(3).standard_normal(20_000)
    for snr_db, expected in ((0.0, 1 / math.sqrt(2)), (10.0, 1 / math.sqrt(20)), (40.0, 0.1)):
        spread = errors(np.full(20_000, 10 ** (0.1 * snr_db)), 0.5, normal).std()
        assert spread == pytest.approx(0.5 * expected, rel=0.03)


def test_scenery_keeps_its_strength_from_frame_to_frame() -> None:
    """Weibull clutter of shape ½: mean 1, variance 5; the same patch gives the same number."""
    points = np.random.default_rng(4).uniform(-500, 500, (200_000, 3))
    strength = texture(points)
    assert strength.mean() == pytest.approx(1.0, abs=0.03)
    assert strength.var() == pytest.approx(5.0, rel=0.15)
    corner = np.floor(points / 0.5) * 0.5
    assert np.array_equal(texture(corner + 0.05), texture(corner + 0.45))
    assert abs(np.corrcoef(strength, texture(points + np.array([0.5, 0, 0])))[0, 1]) < 0.02


def test_cross_section_by_aspect() -> None:
    """Flanks flash, corners are weak, and the shape is even about the car's axis."""
    car = np.full(5, Tag.CAR, np.uint8)
    front, corner, side, back, other = actor_rcs_dbsm(car, np.radians([0, 45, 90, 180, -90]))
    assert front == pytest.approx(11.0, abs=0.2)
    assert side == pytest.approx(18.0, abs=0.2)
    assert back == pytest.approx(13.0, abs=0.2)
    assert corner < front
    assert other == pytest.approx(side)


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


def test_rain_loss_is_the_recommendations() -> None:
    """k and α against the closed forms of ITU-R P.838-3 at 77 GHz, horizontal polarisation."""
    log_f = math.log10(77.0)

    def bells(a: list[float], b: list[float], c: list[float]) -> float:
        return sum(x * math.exp(-(((log_f - y) / z) ** 2)) for x, y, z in zip(a, b, c, strict=True))

    k = 10 ** (
        bells([-5.33980, -0.35351, -0.23789, -0.94158], [-0.10008, 1.26970, 0.86036, 0.64552],
              [1.13098, 0.45400, 0.15354, 0.16817]) - 0.18961 * log_f + 0.71147
    )  # fmt: skip
    alpha = bells(
        [-0.14318, 0.29591, 0.32177, -5.37610, 16.1721], [1.82442, 0.77564, 0.63773, -0.96230, -3.29980],
        [-0.55187, 0.19822, 0.13164, 1.47828, 3.43990],
    ) + 0.67849 * log_f - 1.95537  # fmt: skip
    for rain in (1.0, 10.0, 50.0):
        assert rain_loss_db_per_m(rain) == pytest.approx(1e-3 * k * rain**alpha, rel=0.02)
    assert rain_loss_db_per_m(0.0) == 0.0


def test_rain_weakens_echoes_when_asked(scenery: Any) -> None:
    """Two-way loss over 150 m in 50 mm/h; the same fluctuation under both weathers."""
    world = scenery.world([scenery.box([150, -60, -40], [151, 60, 60], tag=Tag.GUARD_RAIL)])
    drive = scenery.drive(scenery.straight(), 0.3)
    clear, rain = WeatherParameters(), WeatherParameters(precipitation=100.0)
    sensor = config(weather=True, reference_pd=0.9999, detections_max=5000).build(world)
    (dry,), (wet,) = sensor.measure_conditions(drive, STEP, [clear, rain])
    assert isinstance(dry, RadarScan)
    assert isinstance(wet, RadarScan)
    assert sensor.depends_on_weather
    assert len(wet.range_m) < len(dry.range_m)
    fall = np.mean(10 ** (0.1 * dry.snr_db)) / np.mean(10 ** (0.1 * wet.snr_db))
    assert 10 * math.log10(fall) == pytest.approx(2 * 150 * rain_loss_db_per_m(50.0), abs=1.0)
    assert config().build(world).depends_on_weather is False


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"range_min_m": 0.0}, "range_min_m"),
        ({"pfa": 0.95}, "pfa"),
        ({"azimuth_fov_deg": 200.0}, "azimuth_fov_deg"),
        ({"rays_per_actor": 0}, "rays_per_actor"),
        ({"clutter_mean": -1.0}, "clutter_mean"),
        ({"doppler_resolution_mps": 0.0}, "resolutions"),
    ],
)
def test_wrong_configurations_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config(**wrong)
