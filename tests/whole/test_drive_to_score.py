"""From a drive to a score: what a replay writes, that twins are twins, and that KISS-ICP can be judged."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.drives.drives import small_cameras

from carlaloc_env.core.errors import RenderError, WriterError
from carlaloc_env.rigs.presets import flu_rig
from recorder.dataset.checksums import checksums, read_checksums
from recorder.dataset.manifest import DatasetManifest
from recorder.evaluation.evaluate import evaluate
from recorder.evaluation.metrics import Metric
from recorder.evaluation.trajectory_files import read_tum
from recorder.replaying.replay import ReplayConfig, ReplayResult, replay
from recorder.slam.bag_odometry import run_odometry


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rig in YAML: an HDL-32E with a sixth of its columns, IMU, GNSS, small stereo pair."""
    path = tmp_path_factory.mktemp("rig") / "small.yaml"
    whole = small_cameras(flu_rig())
    (lidar,) = (replace(config, columns=362, cycle_ns=0) for config in whole.of_kind("lidar"))
    few = (lidar, *(s for kind in ("imu", "gnss", "camera") for s in whole.of_kind(kind)))
    path.write_text(replace(whole, sensors=few).to_yaml(), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def data(short_drive: Path, rig_file: Path, tmp_path_factory: pytest.TempPathFactory) -> ReplayResult:
    """Two weathers × two traffic levels; pictures for a fifth of a second, when the car has set off."""
    config = ReplayConfig(
        episode=short_drive,
        out=tmp_path_factory.mktemp("data") / "set",
        weathers=("ClearNoon", "FoggyNoon"),
        traffic=("static", "dynamic"),
        rig=str(rig_file),
        camera_start_s=5.0,
        camera_duration_s=0.2,
        quality="low",
        workers=1,
    )
    try:
        return replay(config)
    except RenderError as error:
        pytest.skip(str(error))


def _sequence(data: ReplayResult, name: str) -> Path:
    return next(path for path in data.sequences if path.name == name)


def _messages(bag: Path, topic: str) -> list[tuple[int, bytes]]:
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return [(stamp, bytes(raw)) for _, stamp, raw in reader.messages(connections=connections)]


def _bag(data: ReplayResult, name: str) -> Path:
    return _sequence(data, name) / f"{name}.bag"


@pytest.mark.parametrize(
    ("topic", "rate_hz", "seconds"),
    [
        ("/imu/data", 200, 6.0),
        ("/lidar/points", 20, 6.0),
        ("/gnss/fix", 5, 6.0),
        ("/camera/left/image_raw", 20, 0.2),
        ("/camera/right/depth", 20, 0.2),
        ("/ground_truth/odometry", 200, 6.0),
    ],
)
def test_every_topic_has_its_number_of_messages(
    data: ReplayResult, topic: str, rate_hz: int, seconds: float
) -> None:
    """Counts are rate × time, stamps lie on the sensor's grid and rise strictly."""
    messages = _messages(_bag(data, "ClearNoon_dynamic"), topic)
    assert len(messages) == pytest.approx(rate_hz * seconds, abs=2)
    gaps = np.diff([stamp for stamp, _ in messages])
    assert (gaps == 1_000_000_000 // rate_hz).all()


@pytest.mark.parametrize("topic", ["/imu/data", "/lidar/points", "/gnss/fix", "/ground_truth/odometry"])
def test_weather_changes_pictures_only(data: ReplayResult, topic: str) -> None:
    """Twins under two weathers carry the same bytes on every topic that light does not touch."""
    for level in ("static", "dynamic"):
        clear = _messages(_bag(data, f"ClearNoon_{level}"), topic)
        assert clear == _messages(_bag(data, f"FoggyNoon_{level}"), topic)
    pictures = "/camera/left/image_raw"
    clear = _messages(_bag(data, "ClearNoon_dynamic"), pictures)
    assert clear != _messages(_bag(data, "FoggyNoon_dynamic"), pictures)


def test_traffic_never_changes_the_ego(data: ReplayResult) -> None:
    """Static and dynamic twins share truth, IMU and GNSS; their clouds differ."""
    for topic in ("/imu/data", "/gnss/fix", "/ground_truth/odometry"):
        static = _messages(_bag(data, "ClearNoon_static"), topic)
        assert static == _messages(_bag(data, "ClearNoon_dynamic"), topic)
    static = _messages(_bag(data, "ClearNoon_static"), "/lidar/points")
    assert static != _messages(_bag(data, "ClearNoon_dynamic"), "/lidar/points")


def test_checksums_tell_every_file(data: ReplayResult) -> None:
    """SHA256SUMS lists every file, and nothing half-written stands about."""
    assert read_checksums(data.out) == checksums(data.out)
    assert not [path for path in data.out.rglob("*") if ".part" in path.name]
    listed = DatasetManifest.read(data.out).sequences
    assert list(listed) == sorted(str(path.relative_to(data.out)) for path in data.sequences)


def test_true_biases_explain_the_imu(data: ReplayResult) -> None:
    """EuRoC's IMU less the biases of its table of states is unbiased at rest, within its white noise."""
    mav0 = _sequence(data, "ClearNoon_static") / "mav0"
    imu = np.loadtxt(mav0 / "imu0" / "data.csv", delimiter=",", comments="#")
    state = np.loadtxt(mav0 / "state_groundtruth_estimate0" / "data.csv", delimiter=",", comments="#")
    assert np.abs(state[-1, 11:]).max() > 1e-4
    still = np.linalg.norm(state[:, 8:11], axis=1) < 1e-3
    still[400:] = False
    count = int(still.sum())
    assert count > 200
    force = imu[: len(state)][still, 4:7] - state[still, 14:17]
    rate = imu[: len(state)][still, 1:4] - state[still, 11:14]
    assert abs(np.linalg.norm(force.mean(axis=0)) - 9.81) < 5 * 0.0283 / np.sqrt(count)
    assert (np.abs(rate.mean(axis=0)) < 5 * 2.83e-3 / np.sqrt(count)).all()


def test_preview_is_a_film(data: ReplayResult) -> None:
    """The preview can be opened and has one picture per instant."""
    film = cv2.VideoCapture(str(_sequence(data, "ClearNoon_dynamic") / "preview.mp4"))
    count = 0
    while film.read()[0]:
        count += 1
    assert count == 4


def test_gicp_follows_the_truth(data: ReplayResult) -> None:
    """GICP, fed from the bag, stays within 0.2 m of the LiDAR's true path: data, stamps and truth agree."""
    pytest.importorskip("small_gicp")
    estimate = run_odometry(_bag(data, "ClearNoon_static"), "gicp", "/lidar/points")
    result = evaluate(read_tum(data.ground_truth / "lidar.tum"), estimate)
    assert result.coverage > 0.98
    assert result.statistics[Metric.APE_TRANSLATION].rmse < 0.2


def test_kiss_icp_follows_the_truth(data: ReplayResult) -> None:
    """KISS-ICP, fed from the bag, moves as the LiDAR did from scan to scan.

    Its point-to-point fit is slow to notice the first metres after a standstill on a flat street, so
    its absolute error says little here.
    """
    pytest.importorskip("kiss_icp")
    estimate = run_odometry(_bag(data, "ClearNoon_static"), "kiss_icp", "/lidar/points")
    result = evaluate(read_tum(data.ground_truth / "lidar.tum"), estimate)
    assert result.coverage > 0.98
    assert result.statistics[Metric.RPE_TRANSLATION].rmse < 0.06
    assert result.statistics[Metric.RPE_ROTATION].rmse < 0.2


def test_a_weather_can_be_added_to_a_dataset(short_drive: Path, tmp_path: Path) -> None:
    """A later replay adds its sequences and leaves the older ones as they are; another drive is refused."""

    def again(weather: str, **changes: Any) -> ReplayResult:
        settings: dict[str, Any] = {
            "episode": short_drive, "out": tmp_path / "set", "rig": "state", "formats": ("rosbag1",),
            "duration_s": 1.0, "weathers": (weather,),
        }  # fmt: skip
        return replay(ReplayConfig(**{**settings, **changes}))

    first = again("ClearNoon")
    before = checksums(first.out)
    again("FoggyNoon")
    after = checksums(first.out)
    assert {name: after[name] for name in before if name != "dataset.yaml"}.items() <= before.items()
    listed = DatasetManifest.read(first.out).sequences
    assert listed == ("Town03/ClearNoon_dynamic", "Town03/FoggyNoon_dynamic")
    assert read_checksums(first.out) == after
    for changes in ({"duration_s": 2.0}, {"rig": "lidar"}, {"seed": 99}):
        with pytest.raises(WriterError, match="dataset of another"):
            again("RainyNight", **changes)
    assert checksums(first.out) == after
