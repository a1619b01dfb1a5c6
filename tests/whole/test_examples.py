"""Every example runs, and what it shows is true."""

import importlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.readings.raw_gnss import in_a_street, write

from carlaloc_env.core.errors import RaycastError, RenderError
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples.gnss_signals import IN_SIGHT
from carlaloc_env.sensors.lidar_config import LidarConfig
from carlaloc_env.sensors.registry import SENSOR_KINDS
from recorder.episode.episode import Episode
from recorder.evaluation.metrics import Metric
from recorder.evaluation.trajectory_files import read_tum
from recorder.replaying.replay import replay
from recorder.verification.verify import verify
from recorder.writers.ros.messages import ENCODERS

VSLAM_RIG = """
name: two_eyes
sensors:
- {kind: imu, mount: {position_m: [1.5, 0.0, 1.2]}}
- {kind: camera, name: left, mount: {position_m: [1.8, 0.2, 1.6], axes: optical}, outputs: [rgb],
   pinhole: {width_px: 64, height_px: 40, fx_px: 32, fy_px: 32, cx_px: 32, cy_px: 20}}
- {kind: camera, name: right, mount: {position_m: [1.8, -0.2, 1.6], axes: optical}, outputs: [rgb],
   pinhole: {width_px: 64, height_px: 40, fx_px: 32, fy_px: 32, cx_px: 32, cy_px: 20}}
"""
EXAMPLES = Path(__file__).parents[2] / "examples"
PARTS = {path for name in ("learning", "own_sensors", "splatting") for path in EXAMPLES.glob(f"{name}/*.py")}
"""Parts of examples, without a `main` of their own."""


def load(name: str) -> ModuleType:
    """An example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def _small_town03(straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A straight road instead of the town that examples name."""
    (tmp_path / "maps" / "Town03").mkdir(parents=True)
    shutil.copy(straight_map, tmp_path / "maps" / "Town03" / "town.xodr")
    monkeypatch.setenv("CARLALOC_MAPS", str(tmp_path / "maps"))


@pytest.mark.parametrize("path", sorted(PARTS.union(EXAMPLES.rglob("*.py"))), ids=lambda path: path.name)
def test_examples_are_short_and_callable(path: Path) -> None:
    """Sixty lines at most, with a `main` to call."""
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    if path not in PARTS:
        assert "\ndef main(" in text


def test_the_env_is_driven_along_its_route() -> None:
    """Three seconds of full attention bring the car forward, not off the road."""
    distance_m = load("01_step_the_env").main(steps=60, rig=rig_by_name("state"))
    assert 2.0 < distance_m < 30.0


@pytest.mark.usefixtures("_small_town03")
def test_a_rig_of_yaml_is_used(tmp_path: Path) -> None:
    """The file's four sensors are built, the LiDAR with changed columns, and the picture is not blank."""
    out = tmp_path / "rear.png"
    try:
        rig = load("02_custom_rig").main(out=out)
    except (RenderError, RaycastError) as error:
        pytest.skip(str(error))
    assert [sensor.name for sensor in rig.sensors] == ["rear", "roof", "imu", "gnss"]
    assert rig.of_kind("lidar") == (
        LidarConfig(
            name="roof",
            mount=rig.sensors[1].mount,
            rate_hz=10.0,
            elevations_deg=(-20.0, -15.0, -10.0, -7.5, -5.0, -2.5, 0.0, 2.5),
            columns=450,
            outputs=("cloud",),
        ),
    )
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.shape == (180, 320, 3)
    assert picture.std() > 5.0


@pytest.mark.usefixtures("_small_town03")
def test_a_device_of_ones_own_drives_and_its_drive_is_replayed(tmp_path: Path) -> None:
    """Counts are rate × time, and the device's name stands in the episode."""
    counts = load("03_drive_and_replay").main(out=tmp_path / "cruise", duration_s=3.0, rig="state")
    assert counts["/imu/data"] == pytest.approx(600, abs=2)
    assert counts["/gnss/fix"] == pytest.approx(15, abs=1)
    assert "/lidar/points" not in counts
    episode = Episode.load(tmp_path / "cruise" / "drive.mcap")
    assert episode.header.device == "cruise"
    assert episode.ego["speed_mps"].max() == pytest.approx(2.0, abs=0.3)


def test_raw_gnss_scores_what_its_noise_says(short_drive: Path) -> None:
    """σ of 3, 3, 5 m give an APE of √43 = 6.56 m, and steps √2 times that."""
    results = [load("04_evaluate").main(short_drive, seed=seed) for seed in range(3)]
    ape, rpe = (
        np.sqrt(np.mean([result.statistics[metric].rmse ** 2 for result in results]))
        for metric in (Metric.APE_TRANSLATION, Metric.RPE_PAPER)
    )
    # Three draws of 31 fixes: four standard errors of an RMS of 3 × 93 numbers.
    assert ape == pytest.approx(np.sqrt(43.0), rel=0.2)
    assert rpe == pytest.approx(np.sqrt(86.0), rel=0.3)


def test_a_sensor_from_outside(short_drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The barometer can be named in a rig, and reads the standard atmosphere at 116 m above the ellipsoid."""
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.delitem(SENSOR_KINDS, "barometer", raising=False)
    readings = load("05_new_sensor").main(short_drive)
    assert len(readings) == pytest.approx(61, abs=1)
    pressure_pa = np.array([reading.pressure_pa for reading in readings])
    # ISO 2533: 101 325 Pa at sea level, 12.0 Pa less per metre; the noise is 2 Pa.
    assert pressure_pa.mean() == pytest.approx(101325.0 - 12.0 * 116.0, abs=15.0)
    assert 1.2 < np.diff(pressure_pa).std() / np.sqrt(2) < 3.0
    monkeypatch.delitem(SENSOR_KINDS, "barometer")
    text = (EXAMPLES / "02_custom_rig.yaml").read_text(encoding="utf-8")
    assert SensorRig.from_yaml(text).name == "roof_and_rear"


def test_one_sweep_gives_the_cars_velocity(short_drive: Path) -> None:
    """Ahead to 2 cm/s; sideways to 10, since the field of ±60° sees little of it, and the car turns."""
    pytest.importorskip("open3d", reason="open3d is not installed")
    measured, truth = load("21_speed_from_one_sweep").main(short_drive, at_s=5.5)
    assert truth[0] > 1.0
    assert measured[0] == pytest.approx(truth[0], abs=0.02)
    assert measured[1] == pytest.approx(truth[1], abs=0.1)


def test_positions_gain_where_reflections_are_dropped(tmp_path: Path) -> None:
    """In a street, RTKLIB is nearer to the antenna without them; the labels drop just what was reflected."""
    pytest.importorskip("open3d", reason="open3d is not installed")
    if shutil.which("rnx2rtkp") is None:
        pytest.skip("rnx2rtkp is not installed; apt-get install rtklib")
    rig = SensorRig.load(EXAMPLES / "23_drop_reflections.yaml")
    (receiver,) = rig.of_kind("gnss")
    _, _, samples = in_a_street(60.0, 12.0, 15.0, base=receiver.receiver.base, date=receiver.receiver.date)
    folder = write(tmp_path / "gnss", samples)
    errors = load("23_drop_reflections").main(folder)
    for mode, share in (("single", 0.8), ("rtk", 0.1)):
        everything, kept = errors[mode, "gnss.obs"], errors[mode, "gnss_kept.obs"]
        assert len(kept) >= len(everything) > 20
        assert np.median(kept) < share * np.median(everything)
    lines = (folder / "gnss_kept.obs").read_text().splitlines()
    counts = [int(line[32:35]) for line in lines if line[:1] == ">"]
    in_sight = [len(set(raw.satellite[raw.way() == IN_SIGHT])) for raw in samples["gnss_raw"]]
    assert counts == in_sight


def test_a_sensor_of_ones_own_reaches_a_bag(
    short_drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two workers know sensor, message and topic: every scan of a rig's file is in both bags.

    The wall of the town and the open road give finite and infinite ranges.
    """
    pytest.importorskip("open3d", reason="open3d is not installed")
    monkeypatch.syspath_prepend(EXAMPLES)
    monkeypatch.setitem(ENCODERS, "laser_scan", None)  # type: ignore[arg-type]
    monkeypatch.delitem(ENCODERS, "laser_scan")
    data = load("06_extend").main(short_drive, tmp_path / "bumper")
    assert verify(data).findings == ()
    sequence = data / "Town03" / "ClearNoon_dynamic"
    for bag in (sequence / f"{sequence.name}.bag", sequence / f"{sequence.name}_ros2"):
        with AnyReader([bag]) as reader:
            (connection,) = [c for c in reader.connections if c.topic == "/laser/scan"]
            assert connection.msgtype == "sensor_msgs/msg/LaserScan"
            scans = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages([connection])]
        assert len(scans) == pytest.approx(60, abs=1)
    ranges = np.array([scan.ranges for scan in scans])
    assert ranges.shape[1] == 360
    assert 1.0 < ranges.min() < 60.0
    assert np.isinf(ranges).any()
    assert scans[0].header.frame_id == "laser"


def test_fog_of_a_schedule_takes_the_contrast(short_drive: Path, tmp_path: Path) -> None:
    try:
        noon, fog = load("08_weather_schedule").main(short_drive, tmp_path / "fog", seconds=0.2)
    except RenderError as error:
        pytest.skip(str(error))
    assert fog < 0.6 * noon


def test_sequences_in_the_layout_of_vslam_lab(straight_drive: StraightDrive, tmp_path: Path) -> None:
    """Its own requirements are met: images, their list, calibration; the truth is the left camera's."""
    rig = SensorRig.from_yaml(VSLAM_RIG, where="here")
    (tmp_path / "rig.yaml").write_text(rig.to_yaml())
    config = straight_drive.config(
        tmp_path / "data", rig=str(tmp_path / "rig.yaml"), duration_s=0.5, preview=False
    )
    try:
        replay(config)
    except RenderError as error:
        pytest.skip(str(error))
    (out,) = load("10_vslam_lab").main(tmp_path / "data", tmp_path / "lab")
    rows = (out / "rgb.csv").read_text().splitlines()
    assert rows[0] == "ts_rgb_0 (ns),path_rgb_0,ts_rgb_1 (ns),path_rgb_1"
    assert all((out / name).is_file() for row in rows[1:] for name in row.split(",")[1::2])
    calibration = yaml.safe_load((out / "calibration.yaml").read_text().split("---")[1])
    T = [np.reshape(camera["T_BS"], (4, 4)) for camera in calibration["cameras"]]
    assert np.allclose((np.linalg.inv(T[0]) @ T[1])[:3, 3], [0.4, 0.0, 0.0])
    assert calibration["cameras"][0]["image_dimension"] == [64, 40]
    truth = np.loadtxt(out / "groundtruth.csv", delimiter=",", skiprows=1)
    assert np.array_equal(truth[:, 1:4], read_tum(next(out.parents[1].rglob("camera_left.tum"))).position_m)


def test_a_pupil_rides_with_the_driver_and_learns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of the three is scored; whoever has learned a ride comes nearer to what was taught in it."""
    pytest.importorskip("torch", reason="learning needs the extra `learn`")
    monkeypatch.syspath_prepend(EXAMPLES)
    example, out = load("11_learn_from_the_driver"), tmp_path / "pupil.pt"
    found = example.main(out, shown=1, beside=1, scored=1, time_limit_s=8.0)
    assert list(found) == ["copy", "pupil", "teacher"]
    assert 0.005 < found["teacher"] < 0.1
    assert out.stat().st_size < 300_000
    env = example.make_env(8.0)
    taught = example.ride(env, 3, None)
    pupil = example.Pupil.load(out)
    errors = []
    for passes in (1, 60):
        pupil.learn([taught], passes)
        errors.append(np.abs([pupil(seen) for seen in taught.seen] - taught.taught).mean())
    assert errors[1] < 0.7 * errors[0]
    env.close()


def test_a_clone_learns_from_a_data_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight seconds of driving become a data set; whoever learns from it does the same, once it drives."""
    pytest.importorskip("torch", reason="learning needs the extra `learn`")
    pytest.importorskip("minari", reason="data sets need the extra `minari`")
    monkeypatch.syspath_prepend(EXAMPLES)
    example = load("12_clone_from_minari")
    example.main(tmp_path, drives=1, scored=1, passes=150, duration_s=8.0)
    data = example.minari.MinariDataset(tmp_path / "town01-scripted-v0" / "data")
    (drive,) = data.iterate_episodes()
    clone = example.Pupil.load(tmp_path / "clone.pt")
    wrong = np.abs([clone(seen) for seen in drive.observations[:-1]] - drive.actions)[15:]
    assert np.all(wrong.mean(axis=0) < 0.5 * drive.actions.std(axis=0))


def write_wall(folder: Path) -> None:
    """Pictures of a smooth wall, 10 m away, along a path beside it; a dark square passes before it."""
    frames = []
    row, column = np.mgrid[:48, :64]
    for k in range(12):
        x_m = (column - 31.5) / 6.4 + 0.2 * k
        wall = 128 + 60 * np.stack([np.sin(x_m), np.cos(1.3 * x_m + row / 9), np.sin(row / 7)], axis=-1)
        hides = (np.abs(row - 24) < 9) & (np.abs(column - 8 - 4 * k) < 7)
        pictures = {
            "file_path": np.where(hides[..., None], 10, wall).astype(np.uint8),
            "clean_plate_path": wall.astype(np.uint8),
            "mask_path": np.where(hides, 0, 255).astype(np.uint8),
            "depth_file_path": np.where(hides, 5000, 10000).astype(np.uint16),
        }
        T = np.eye(4)
        T[0, 3], T[1, 1], T[2, 2] = 0.2 * k, -1.0, -1.0
        frame = {"w": 64, "h": 48, "fl_x": 64.0, "cx": 32.0, "cy": 24.0, "transform_matrix": T.tolist()}
        for name, picture in pictures.items():
            frame[name] = f"{name}/left/{k}.png"
            (folder / name / "left").mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / frame[name]), picture)
        frames.append(frame)
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))


def test_masks_bring_splats_nearer_to_the_clean_plate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On held-out views, above all where a square hid the wall that other views show."""
    pytest.importorskip("jax", reason="splats need the extra `splats`")
    pytest.importorskip("optax", reason="splats need the extra `splats`")
    write_wall(tmp_path)
    monkeypatch.syspath_prepend(EXAMPLES)
    found = load("13_splats").main(tmp_path, shrink=1, rounds=1, steps=100, every=4)
    assert found["with masks"][0] > 26.0
    assert found["with masks"][1] > 24.0
    assert found["with masks"][1] > found["without masks"][1] + 3.0


def test_the_pupil_that_comes_along_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a minute among traffic of an unseen seed brings it a good way along the route, without a touch."""
    pytest.importorskip("torch", reason="learning needs the extra `learn`")
    monkeypatch.syspath_prepend(EXAMPLES)
    example = load("11_learn_from_the_driver")
    env = example.make_env(30.0)
    pupil = example.Pupil.load(EXAMPLES / "learning" / "town01_pupil.pt")
    ride = example.ride(env, 10_000, pupil, traffic="dynamic,green_wave=true")
    assert ride.ended_by == "time"
    assert ride.completion > 0.15
    env.close()


def test_the_agent_that_comes_along_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a minute among traffic of an unseen seed brings it a good way along the route, without a touch."""
    pytest.importorskip("stable_baselines3", reason="learning needs the extra `learn`")
    monkeypatch.syspath_prepend(EXAMPLES)
    beside = load("20_drive_unseen_towns")
    env = beside.drive_env(["Town01"], traffic="dynamic,green_wave=true", task={"time_limit_s": 30.0})
    agent = beside.new_agent(beside.DummyVecEnv([lambda: env]))
    beside.load(agent, EXAMPLES / "learning" / "town01_agent.pt")
    ride = beside.by_agent(env, lambda seen: beside.act(agent, seen), 10_000)
    assert ride.ended_by == "time"
    assert ride.completion > 0.08
    env.close()


FEW = {"abreast": 2, "steps": 32, "n_steps": 16, "time_limit_s": 2.0, "scored": 1}
"""Arguments of example 19 for one update."""


def test_an_agent_learns_from_nothing_and_goes_on(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its file is small and holds all of it; an agent that goes on from it, in two towns, begins as it."""
    torch = pytest.importorskip("torch", reason="learning needs the extra `learn`")
    pytest.importorskip("stable_baselines3", reason="learning needs the extra `learn`")
    monkeypatch.syspath_prepend(EXAMPLES)
    example = load("19_learn_from_nothing")
    few = {"towns": (straight_map,), **FEW}
    assert 0.0 < example.main(tmp_path / "first", **few) < 0.5
    path = tmp_path / "first" / "agent.pt"
    assert path.stat().st_size < 200_000
    assert "route_completion" in (tmp_path / "first" / "rides_0.monitor.csv").read_text()
    other = shutil.copytree(straight_map.parent, tmp_path / "other") / straight_map.name
    held = {"begin_with": path, "learning_rate": 0.0, "towns": (straight_map, other), "route": "random"}
    example.main(tmp_path / "held", **{**few, **held})
    before, after = (torch.load(name, weights_only=True) for name in (path, tmp_path / "held" / "agent.pt"))
    assert all(torch.equal(value, after["policy"][name]) for name, value in before["policy"].items())
    # The inputs' mean and variance go on where they were: 32 more are counted.
    assert after["own"]["count"] - before["own"]["count"] == pytest.approx(33, abs=2)
    # Beside the scripted driver, which is some 30 m on by then.
    beside = load("20_drive_unseen_towns")
    agent, driver = beside.main(path, [straight_map], route="town", scored=1, time_limit_s=8.0)[straight_map]
    assert 0.0 < agent < 0.5
    assert 0.02 < driver < 0.3


def test_a_plain_vector_gets_the_library_s_defaults(
    straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here with drives in processes of their own."""
    pytest.importorskip("stable_baselines3", reason="learning needs the extra `learn`")
    monkeypatch.syspath_prepend(EXAMPLES)
    plain = ("starts", "ackermann", "apart", "mild")
    load("19_learn_from_nothing").main(tmp_path, towns=(straight_map,), without=plain, processes=True, **FEW)
    assert (tmp_path / "agent.pt").is_file()
    assert (tmp_path / "rides_1.monitor.csv").is_file()


@pytest.mark.parametrize("sees", ["bev", "nothing"])
def test_an_agent_learns_from_pictures(
    sees: str, straight_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It sees the picture; the blind one gets the same numbers and a black picture."""
    pytest.importorskip("stable_baselines3", reason="learning needs the extra `learn`")
    monkeypatch.syspath_prepend(EXAMPLES)
    few = {"towns": (straight_map,), **FEW}
    load("19_learn_from_nothing").main(tmp_path, sees=sees, **few)
    assert (tmp_path / "agent.pt").is_file()
    env = importlib.import_module("learning.drive_env").drive_env([straight_map], sees=sees)
    seen, _ = env.reset(seed=1)
    assert env.observation_space.contains(seen)
    assert (seen["picture"].max() > 0) == (sees == "bev")
    env.close()


def test_a_score_counts_collisions_by_the_kilometre(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    score = importlib.import_module("learning.score")
    rides = [score.Ride(1.0, 600.0, "goal"), score.Ride(0.5, 400.0, "collision")]
    assert score.report("two", rides) == 0.75
    assert "75.0% of the route, 1.00 collisions a km" in capsys.readouterr().out


def test_env_runners_of_rllib_drive_in_processes_of_their_own() -> None:
    pytest.importorskip("ray", reason="RLlib needs the extra `ray`")
    drove, returns = load("14_rllib").main(runners=2, iterations=1, actions=64)
    assert len(drove) == 2
    assert os.getpid() not in drove
    assert len(returns) == 1


@pytest.mark.parametrize(
    ("name", "extra"),
    [
        ("11_learn_from_the_driver", "learn"),
        ("12_clone_from_minari", "learn,minari"),
        ("13_splats", "splats"),
        ("14_rllib", "ray"),
        ("19_learn_from_nothing", "learn"),
        ("20_drive_unseen_towns", "learn"),
    ],
)
def test_an_example_without_its_library_names_the_extra(name: str, extra: str) -> None:
    lacking = "import sys, runpy; sys.modules.update(dict.fromkeys(('torch', 'minari', 'jax', 'ray')))"
    code = f"{lacking}; sys.path.insert(0, '.'); runpy.run_path('{name}.py', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", code], cwd=EXAMPLES, capture_output=True, text=True)
    (line,) = done.stderr.splitlines()
    assert line.endswith(f"pip install 'carlaloc[{extra}]'")
    assert done.returncode == 1
