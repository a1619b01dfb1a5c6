"""Metrics beside real recordings: of sweeps, shakes and pictures whose metrics follow from their making."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.drives.rough_drives import motion_at, motion_on
from shared_fixtures.readings.dressed_clouds import Dressing, message_of
from shared_fixtures.readings.pose_bags import Messages

from carlaloc_env.core.array_types import Array
from carlaloc_env.core.errors import EvaluationError
from carlaloc_env.sensors.imu import ideal
from recorder.cli.main import main
from recorder.dataset.scans import Scan
from recorder.verification.imu_metrics import ImuLog, imu_metrics
from recorder.verification.lidar_metrics import is_like_hdl32e, lidar_metrics, sweeps_of
from recorder.verification.real_ranges import REAL_IMU, REAL_LIDAR
from recorder.verification.realism import RealismMetric, measure_realism

ELEVATION_DEG = -92.0 / 3.0 + 4.0 / 3.0 * np.arange(32)
COLUMNS, PERIOD_S, HEIGHT_M, WALL_M = 1085, 0.05, 1.9, 25.0
FIRST_NS = 1_700_000_000_000_000_000


def street(seed: int = 0, noise_m: float = 0.005, exponent: float = 0.5, columns: int = COLUMNS) -> Scan:
    """A level road and a round wall; posts of 20 columns stand 8 m away.

    Points on the road have the intensity 30·cosᵏ of their incidence, those on the wall 8, both ± 10 %.
    """
    draw = np.random.default_rng(seed)
    column, ring = (part.ravel() for part in np.indices((columns, 32)))
    azimuth, elevation = -2 * np.pi * column / columns, np.radians(ELEVATION_DEG[ring])
    road = HEIGHT_M / np.maximum(np.sin(-elevation), 1e-6)
    wall = WALL_M / np.cos(elevation)
    r = np.minimum(road, wall)
    posts = (column % 120 >= 100) & (r > 9.0)
    r = np.where(posts, 8.0, r)
    intensity = np.where(road < wall, 30.0 * np.sin(-elevation).clip(1e-3) ** exponent, 8.0)
    intensity = intensity * (1.0 + 0.1 * draw.standard_normal(len(r)))
    r = r + noise_m * draw.standard_normal(len(r))
    flat = r * np.cos(elevation)
    points = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), r * np.sin(elevation)], axis=1)
    time_s = column * (PERIOD_S / columns) + ring * 1.152e-6
    return Scan(stamp_ns=FIRST_NS, points_xyz_m=points, time_s=time_s, ring=ring, intensity=intensity)


def test_noise_of_ranges_is_found_on_road_and_wall() -> None:
    """5 mm of white noise: residuals of 5 mm; the fit of a parabola correlates neighbours below 0."""
    found = lidar_metrics([street(0), street(1)])
    assert found["road residual, 1.5 m [cm]"] == pytest.approx(0.5, rel=0.05)
    assert found["shot noise, 0.55 m, p50 [cm]"] == pytest.approx(0.5, rel=0.05)
    assert -0.2 < found["neighbours' correlation on the road"] < 0.0
    assert found["ground intensity exponent"] == pytest.approx(0.5, abs=0.02)
    assert found["intensity variation in a road window"] == pytest.approx(0.1, rel=0.1)


def test_a_rough_road_correlates_neighbours() -> None:
    """A moving mean over three columns has the correlation 2/3, less the share of the fit."""
    scan = street(0, noise_m=0.0)
    draw = np.random.default_rng(5).standard_normal((COLUMNS + 2, 32)) * 0.005 / math.sqrt(3.0)
    texture = (draw[:-2] + draw[1:-1] + draw[2:]).ravel()
    r = np.linalg.norm(scan.points_xyz_m, axis=1)
    rough = replace(scan, points_xyz_m=scan.points_xyz_m * ((r + texture) / r)[:, None])
    assert 0.4 < lidar_metrics([rough])["neighbours' correlation on the road"] < 0.67


def test_missing_and_mixed_returns_at_edges_are_counted() -> None:
    """Two triples of columns see each edge, one where its point is missing or lies in between."""
    scan = street(0)
    column, ring = (part.ravel() for part in np.indices((COLUMNS, 32)))
    r = np.linalg.norm(scan.points_xyz_m, axis=1)
    edge = (column % 120 == 99) & (r > 8.5)
    lost, mixed = edge & (ring % 5 == 0), edge & (ring > 19) & (ring % 5 == 1)
    points = scan.points_xyz_m.copy()
    points[mixed] *= (14.0 / r[mixed])[:, None]
    found = lidar_metrics([replace(scan, points_xyz_m=points).take(~lost)])
    jumps = 4 * edge.sum() - lost.sum() - mixed.sum()
    assert found["dropouts at range discontinuities"] == pytest.approx(lost.sum() / jumps, rel=1e-6)
    assert found["mixed pixels at range discontinuities"] == pytest.approx(mixed.sum() / jumps, rel=1e-6)
    assert lidar_metrics([scan])["dropouts at range discontinuities"] == 0.0


def test_returns_of_the_own_car_and_silent_rings() -> None:
    scan = street(0)
    ring = np.asarray(scan.ring)
    near = (ring < 7) & (np.arange(len(ring)) % 4 == 0)
    points = scan.points_xyz_m.copy()
    points[near] *= (0.8 / np.linalg.norm(points[near], axis=1))[:, None]
    found = lidar_metrics([replace(scan, points_xyz_m=points).take((ring < 20) | (ring > 22))])
    assert found["own car: share below 2.5 m"] == pytest.approx(near.sum() / (29 * COLUMNS), rel=1e-6)
    assert found["no return, rings at -4 to -1 deg"] == 1.0
    assert found["no return, rings below -22 deg"] == 0.0


@pytest.mark.parametrize("without", ["ring", "time", "both"])
def test_clouds_without_rings_or_times_give_the_same_metrics(without: str) -> None:
    scan = street(0)
    bare = scan if without == "time" else replace(scan, ring=None)
    bare = bare if without == "ring" else replace(bare, time_s=np.zeros(len(scan.time_s)))
    whole = lidar_metrics([scan])
    for name, value in lidar_metrics([bare]).items():
        assert value == pytest.approx(whole[name], rel=0.05, abs=0.02), name


def test_slow_sensors_are_thinned_to_the_density_of_the_real_one() -> None:
    assert next(sweeps_of([street(0, columns=2 * COLUMNS)])).range_m.shape == (COLUMNS, 32)


def test_sensors_of_other_sizes_are_named(bag: Path) -> None:
    """The ranges are an HDL-32E's: rings at its angles have them, others have none; a Livox has no rings."""
    assert is_like_hdl32e(ELEVATION_DEG)
    assert not is_like_hdl32e(np.linspace(-22.0, 21.0, 64))
    assert not is_like_hdl32e(np.linspace(15.0, -16.0, 32))
    line = np.arange(32 * COLUMNS) % 4
    with pytest.raises(EvaluationError, match="as a Livox's"):
        lidar_metrics([replace(street(0), ring=line)])


def test_clouds_that_are_no_sweeps_are_refused_in_one_line() -> None:
    draw = np.random.default_rng(0)
    cloud = replace(street(0), points_xyz_m=draw.normal(size=(32 * COLUMNS, 3)), ring=None)
    with pytest.raises(EvaluationError, match="no field ring"):
        lidar_metrics([cloud])
    flying = replace(street(0), points_xyz_m=street(0).points_xyz_m + np.array([0.0, 0.0, 50.0]))
    with pytest.raises(EvaluationError, match=r"no road 1 to 3\.2 m below"):
        lidar_metrics([flying])


def shaken(seconds: float = 40.0, rate_hz: float = 200.0) -> ImuLog:
    """Tones of known strength at 6 m/s in bends, then rest with white noise; x forward, y left, z up."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    moves = t < 0.75 * seconds
    yaw = 0.3 * np.sin(2 * np.pi * 0.1 * t)
    force = np.stack([0 * t, 6.0 * yaw, 9.81 + 0 * t], axis=1)
    rate = np.stack([0 * t, 0 * t, yaw], axis=1)
    for axis, tone_hz, size in ((2, 2.0, 0.3), (2, 5.0, 0.1), (2, 11.0, 0.05), (1, 5.0, 0.2)):
        force[:, axis] += size * np.sin(2 * np.pi * tone_hz * t)
    rate[:, 0] += 0.02 * np.sin(2 * np.pi * 2.0 * t)
    still = np.random.default_rng(0).normal(scale=0.012, size=force.shape) + np.array([0, 0, 9.81])
    return ImuLog(
        stamp_ns=FIRST_NS + np.round(t * 1e9).astype(np.int64),
        force_mps2=np.where(moves[:, None], force, still),
        rate_radps=rate * moves[:, None],
        speed_mps=np.where(moves, 6.0, 0.0),
    )


def turned(log: ImuLog, R_imu_body: Array) -> ImuLog:
    force, rate = (vectors @ R_imu_body.T for vectors in (log.force_mps2, log.rate_radps))
    return replace(log, force_mps2=force, rate_radps=rate)


@pytest.mark.parametrize("axes", ["flu", "paper", "frd"])
def test_tones_are_found_in_their_bands_in_any_axes(axes: str) -> None:
    """The root mean square of a tone is its size over √2."""
    R = {
        "flu": np.eye(3),
        "paper": np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]]),
        "frd": np.diag([1.0, -1.0, -1.0]),
    }[axes]
    found = imu_metrics(turned(shaken(), R))
    tones = {"a_z 1-3": 0.3, "a_z 3-8": 0.1, "a_z 8-15": 0.05, "a_y 3-8": 0.2, "roll rate 1-3": 0.02}
    for name, size in tones.items():
        assert found[f"{name} Hz at 4-8 m/s"] == pytest.approx(size / math.sqrt(2), rel=0.02), name
    assert found["a_z 15-25 Hz at 4-8 m/s"] < 1e-3
    assert math.isnan(found["a_z 1-3 Hz at 16-20 m/s"])
    assert found["acceleration at rest"] == pytest.approx(0.012, rel=0.05)


def test_the_real_ride_shakes_as_kittis_car_does() -> None:
    """At KITTI's place on class B at 6 m/s, all bands are inside but a_z at 8 to 15 Hz, a fifth above."""
    motion = motion_at(motion_on("B", 100.0, "real", 6.0), -0.05, 0.32, 0.93)
    readings = ideal(motion)
    speed = np.hypot(*motion.velocity_world_mps[:, :2].T)
    found = imu_metrics(
        ImuLog(
            stamp_ns=motion.stamp_ns, force_mps2=readings[:, :3], rate_radps=readings[:, 3:], speed_mps=speed
        )
    )
    for name, value in found.items():
        if name.endswith("4-8 m/s"):
            low, high = REAL_IMU[name]
            assert low < value < (1.25 * high if "8-15" in name else high), name


def test_verdicts_are_those_of_the_range() -> None:
    metric = RealismMetric(group="lidar", name="x", value=0.3, low=0.2, high=0.4, source="a car")
    assert metric.verdict == "inside"
    assert replace(metric, value=0.41).verdict == "OUTSIDE"
    assert replace(metric, value=math.nan).verdict == replace(metric, low=None, high=None).verdict == ""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Another project's bag: twelve sweeps with its own names of fields, an IMU, positions and pictures."""
    made = Messages(ros2=True)
    store = get_typestore(Stores.ROS2_HUMBLE)
    entries: list[tuple[str, str, int, Any]] = []
    log = shaken(30.0)
    for number in range(12):
        scan, at = street(number), FIRST_NS + number * 50_000_000
        rows = np.zeros(
            len(scan.time_s), [(n, "<f4") for n in ("x", "y", "z", "intensity", "t")] + [("ring", "<u2")]
        )
        for k, axis in enumerate("xyz"):
            rows[axis] = scan.points_xyz_m[:, k]
        rows["intensity"], rows["t"], rows["ring"] = scan.intensity, scan.time_s, scan.ring
        entries.append(
            ("/velodyne", "sensor_msgs/msg/PointCloud2", at, message_of(store, rows, at, Dressing()))
        )
    for at, force, rate in zip(log.stamp_ns.tolist(), log.force_mps2, log.rate_radps, strict=True):
        imu = made.make["sensor_msgs/msg/Imu"](
            header=made.header(at), orientation=made.make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            orientation_covariance=np.zeros(9), angular_velocity=made.vector(rate.tolist()),
            angular_velocity_covariance=np.zeros(9), linear_acceleration=made.vector(force.tolist()),
            linear_acceleration_covariance=np.zeros(9),
        )  # fmt: skip
        entries.append(("/ins", "sensor_msgs/msg/Imu", at, imu))
    along = np.concatenate([[0.0], np.cumsum(log.speed_mps)[:-1] / 200.0])
    for at, x in zip(log.stamp_ns[::20].tolist(), along[::20].tolist(), strict=True):
        kind = "nav_msgs/msg/Odometry"
        entries.append(("/odom", kind, at, made.pose(kind, at, [x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])))
    picture = cv2.imencode(".png", blocks())[1]
    packed = made.make["sensor_msgs/msg/CompressedImage"](
        header=made.header(FIRST_NS), format="png", data=np.asarray(picture, np.uint8).ravel()
    )
    entries.append(("/front/compressed", "sensor_msgs/msg/CompressedImage", FIRST_NS, packed))
    entries.sort(key=lambda entry: entry[2])
    path: Path = made.write(tmp_path_factory.mktemp("realism") / "strange", entries)
    return path


def blocks() -> Any:
    """A picture of 640 × 360 with grey blocks."""
    draw = np.random.default_rng(0)
    return np.kron(draw.integers(40, 200, (18, 32)), np.ones((20, 20))).astype(np.uint8)


def test_a_strangers_bag_is_measured_as_its_parts_are(bag: Path) -> None:
    result = measure_realism(bag)
    found = {metric.name: metric.value for metric in result.metrics}
    assert list(result.read) == ["lidar", "pictures", "imu"]
    for name, value in lidar_metrics([street(k) for k in range(0, 12, 2)]).items():
        assert found[name] == pytest.approx(value, rel=0.01, abs=1e-3), name
    assert found["a_z 1-3 Hz at 4-8 m/s"] == pytest.approx(0.3 / math.sqrt(2), rel=0.03)
    assert found["acceleration at rest"] == pytest.approx(0.012, rel=0.05)
    judged = {metric.name for metric in result.metrics if metric.low is not None}
    assert set(REAL_LIDAR) | set(REAL_IMU) <= judged


def test_the_command_prints_metrics_ranges_and_verdicts(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["realism", str(bag)]) == 0
    text = capsys.readouterr().out
    line = next(line for line in text.splitlines() if "road residual" in line)
    assert line.split()[-5:] == ["real", "0.3", "to", "0.8", "inside"]
    assert "nuScenes" in text
    assert main(["realism", str(bag), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["judged"] == sum(metric["verdict"] != "" for metric in result["metrics"])
    assert result["inside"] > 0


def test_a_folder_of_pictures_is_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a.png", "b.jpg"):
        cv2.imwrite(str(tmp_path / name), blocks())
    assert main(["realism", str(tmp_path)]) == 0
    assert "2 of 2 files" in capsys.readouterr().out


def test_bad_input_is_one_line(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "x.png").write_bytes(b"no picture")
    wrong = {
        (str(tmp_path / "none.bag"),): "no such bag",
        (str(tmp_path / "bad"),): "no picture",
        (str(bag), "--imu", "/imu"): "/ins",
        (str(bag), "--lidar", "/lidar"): "/velodyne",
    }
    for words, part in wrong.items():
        assert main(["realism", *words]) == 1
        error = capsys.readouterr().err
        assert part in error
        assert error.count("\n") == 1
