"""A recorded drive as an environment: the samples of its replay, the views of its data set, its own end."""

import pickle
import warnings
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from shared_fixtures.drives.straight_drives import StraightDrive
from shared_fixtures.readings.bag_samples import write_all
from shared_fixtures.worlds.render_scenes import need_opengl

import carlaloc_env  # noqa: F401  registers the environments
from carlaloc_env.core.clock import STEP_NS
from carlaloc_env.core.errors import ActionError, ConfigError
from carlaloc_env.rigs.presets import rig_by_name
from carlaloc_env.samples import Sample
from recorder.cli.main import main
from recorder.episode.episode import Episode
from recorder.episode_env.replay_env import ReplayEnv
from recorder.writers.base import DEFAULT_EPOCH_NS
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer

START_S = 0.6
Messages = dict[str, list[tuple[int, bytes]]]


def _env(drive: StraightDrive, rig: str | Path = "state", **settings: Any) -> ReplayEnv:
    return ReplayEnv(drive.episode, rig, map=drive.town, **{"quality": "low", **settings})


def _samples(env: ReplayEnv, **reset: Any) -> list[Sample]:
    """All samples of a drive until its end."""
    samples = list(env.reset(**reset)[1]["samples"])
    over = False
    while not over:
        *_, over, info = env.step(None)
        samples += info["samples"]
    return samples


def _written(samples: Iterable[Sample], rig: Path, out: Path) -> Messages:
    """Samples as a bag holds them."""
    in_time = sorted(samples, key=lambda sample: sample.stamp_ns)
    calibration = RigCalibration.from_configs(rig_by_name(str(rig)).sensors)
    encoder = Ros1Encoder(calibration, streams={sample.sensor for sample in in_time})
    return _read(write_all(Rosbag1Writer(out, encoder), in_time))


def _read(bag: Path) -> Messages:
    """Stamps and bytes of all messages, by topic."""
    messages: Messages = defaultdict(list)
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
        for connection, stamp_ns, data in reader.messages():
            messages[connection.topic].append((stamp_ns, bytes(data)))
    return messages


@pytest.mark.parametrize("traffic", ["dynamic", "empty"])
def test_samples_are_the_bytes_of_a_replay_from_there(
    traffic: str, straight_drive: StraightDrive, tmp_path: Path
) -> None:
    """Cameras, events, LiDAR, IMU and GNSS from mid-drive in fog, as a bag has them; nothing more or less."""
    need_opengl()
    words = ["--start", str(START_S), "--weather", "FoggyNoon", "--traffic", traffic, "--format", "rosbag1"]
    words += ["--workers", "1", "--no-preview"]
    assert main(straight_drive.command(tmp_path / "set", *words, rig=straight_drive.rig)[3:]) == 0
    (bag,) = (tmp_path / "set").rglob("*.bag")
    env = _env(straight_drive, straight_drive.rig, weather="FoggyNoon", traffic=traffic, start_s=START_S)
    ours = _written(_samples(env), straight_drive.rig, tmp_path / "ours.bag")
    end_ns = DEFAULT_EPOCH_NS + env.world.now_ns
    env.close()
    theirs = _read(bag)
    assert (
        {"/imu/data", "/gnss/fix", "/lidar/points", "/camera/left/image_raw"} <= ours.keys() <= theirs.keys()
    )
    for topic, messages in ours.items():
        if "info" in topic or topic.startswith("/tf"):
            continue
        complete_ns = end_ns - (2 * STEP_NS if "lidar" in topic else 0)
        assert messages[0][0] >= DEFAULT_EPOCH_NS + round(START_S * 1e9)
        expected = [one for one in theirs[topic] if one[0] < complete_ns]
        assert len(expected) >= 5
        assert [one for one in messages if one[0] < complete_ns] == expected, topic


def test_views_are_those_of_its_data_set(straight_drive: StraightDrive, tmp_path: Path) -> None:
    """`state` and `bev`, actions, rewards and ends, in steps of two."""
    minari = pytest.importorskip("minari", reason="data sets need the extra `minari`")
    for rig in ("state", "bev"):
        out = tmp_path / f"{rig}-v0"
        words = ["--map", str(straight_drive.town), "--rig", rig, "--frame-skip", "2", "--action", "controls"]
        assert main(["minari", str(straight_drive.episode), "--out", str(out), *words]) == 0
        (told,) = minari.MinariDataset(out / "data").iterate_episodes()
        env = _env(straight_drive, rig, frame_skip=2)
        seen, _ = env.reset()
        for number in range(len(told)):
            for key in seen if isinstance(seen, dict) else [None]:
                expected = told.observations if key is None else told.observations[key]
                np.testing.assert_array_equal(expected[number], seen if key is None else seen[key])
            seen, reward, ended, over, info = env.step(env.action_space.sample())
            np.testing.assert_array_equal(told.actions[number], info["action"])
            assert (told.rewards[number], told.terminations[number]) == (reward, ended)
            assert over == told.truncations[number] == (number == len(told) - 1)
        env.close()


def test_a_reset_begins_anywhere_in_any_weather_for_one_episode(straight_drive: StraightDrive) -> None:
    """The motion is the drive's at every start; the drive ends as it did; a step after it is refused."""
    env = _env(straight_drive, info=("ego",))
    drive, last = Episode.load(straight_drive.episode), env.world.step_count
    _, usual = env.reset()
    assert (usual["weather"], usual["stamp_ns"], usual["drive_seed"]) == ("ClearNoon", 0, drive.header.seed)
    first, way_m = [], {}
    for _ in range(last):
        seen, _, _, over, info = env.step(None)
        first.append(seen)
        way_m[info["stamp_ns"]] = info["route_s_m"]
    assert over
    with pytest.raises(ActionError, match="call reset"):
        env.step(None)
    _, info = env.reset(options={"weather": "HardRainNoon", "start_s": 1.234})
    assert (info["weather"], info["stamp_ns"]) == ("HardRainNoon", 1_200_000_000)
    step = info["stamp_ns"] // STEP_NS
    row = drive.ego[step * 10 + 1]
    np.testing.assert_array_equal(info["ego"].position_m, row["position_m"])
    for number in range(step, last):
        seen, _, _, over, info = env.step(env.action_space.sample())
        # The first step after a start knows no speed before it, and standing begins to count.
        if number > step:
            np.testing.assert_array_equal(np.delete(seen, (3, 10)), np.delete(first[number], (3, 10)))
        assert info["route_s_m"] == way_m[info["stamp_ns"]]
        assert over == (number == last - 1)
    _, info = env.reset()
    assert (info["weather"], info["stamp_ns"]) == ("ClearNoon", 0)
    env.close()


def test_the_seed_is_that_of_noise(straight_drive: StraightDrive, tmp_path: Path) -> None:
    """None is the drive's, as a replay has it."""
    env = _env(straight_drive, straight_drive.state_rig)
    seed = Episode.load(straight_drive.episode).header.seed
    drawn = [
        _written(_samples(env, seed=one), straight_drive.state_rig, tmp_path / f"{k}.bag")["/imu/data"]
        for k, one in enumerate((None, seed, seed + 1, None))
    ]
    env.close()
    assert drawn[0] == drawn[1] == drawn[3]
    assert drawn[0] != drawn[2]


@pytest.mark.parametrize("rig", ["state", "bev", "sensors"])
def test_gymnasium_finds_nothing_wrong(rig: str, straight_drive: StraightDrive) -> None:
    """Its checks with fatal warnings, from the specification as JSON and as a pickled environment."""
    if rig == "sensors":
        need_opengl()
    used = str(straight_drive.rig) if rig == "sensors" else rig
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(
            "CarlaLoc-Replay-v0", episode=straight_drive.episode, map=straight_drive.town, rig=used,
            quality="low", traffic="0.5",
        )  # fmt: skip
        check_env(env.unwrapped, skip_render_check=True)
        assert env.spec is not None
        same = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
        other = pickle.loads(pickle.dumps(env.unwrapped))
        for one in (same, other):
            assert one.observation_space == env.observation_space
            _, info = one.reset(seed=0)
            assert info["traffic"] == "0.5"
            one.close()
    env.close()


@pytest.mark.parametrize(
    ("settings", "options", "why"),
    [
        ({"weather": "Fogy"}, {}, "did you mean"),
        ({"action": "discrete"}, {}, "Known: continuous, controls"),
        ({"start_s": 99.0}, {}, "below the"),
        ({}, {"start_s": -1.0}, "below the"),
        ({}, {"start": 0.5}, "start_s"),
        ({}, {"weather": "RainyNigt"}, "RainyNight"),
    ],
)
def test_what_does_not_fit_is_one_line(
    straight_drive: StraightDrive, settings: dict[str, Any], options: dict[str, Any], why: str
) -> None:
    with pytest.raises(ConfigError, match=why) as caught:
        _env(straight_drive, **settings).reset(options=options)
    assert "\n" not in str(caught.value)
