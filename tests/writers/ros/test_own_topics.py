"""Topics, messages and sensors of a user's own files, by the names that options and rigs take."""

import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from carlaloc_env.core.errors import ConfigError, WriterError
from carlaloc_env.core.own_code import absolute_word
from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.samples import Speed
from recorder.replaying.code_digest import own_code_digest
from recorder.writers.rig_calibration import RigCalibration
from recorder.writers.ros.messages import ENCODERS
from recorder.writers.ros.rosbag1 import Ros1Encoder, Rosbag1Writer
from recorder.writers.ros.rosbag2 import Ros2Encoder, Rosbag2Writer
from recorder.writers.topic_profiles import profile_by_name

TOPICS = """
from carlaloc_env import Speed
from recorder import ENCODERS, TopicProfile, TopicRule

def knots(maker, header, sample):
    return maker.new("ship_msgs/Knots", header=header, knots=sample.speed_mps / 0.514444)

ENCODERS["knots"] = ("ship_msgs/msg/Knots", knots)
SHIP = TopicProfile(
    name="ship", rules=(TopicRule(Speed, "*", "/{}/knots", "knots"),),
    definitions={"ship_msgs/Knots": "std_msgs/Header header\\nfloat64 knots"},
)
NUMBER = 5
"""
SENSORS = """
from dataclasses import dataclass
from typing import ClassVar
from carlaloc_env import SensorConfig

@dataclass(frozen=True, slots=True, kw_only=True)
class SonarConfig(SensorConfig):
    kind: ClassVar[str] = "sonar"
    name: str = "sonar"
    reach_m: float = 5.0
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with topics and a sensor of a user's, which nothing names yet."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(sys, "modules", sys.modules)
    for name in ("ship_topics", "ship_sensors"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(ENCODERS, "knots", ("", lambda *_: None))
    (tmp_path / "ship_topics.py").write_text(TOPICS)
    (tmp_path / "ship_sensors.py").write_text(SENSORS)
    return tmp_path


@pytest.mark.parametrize("ros", [1, 2])
def test_a_message_type_of_ones_own(own: Path, ros: int) -> None:
    """A bag holds its definition, so that any reader knows it: 10 knots are 5.14444 m/s."""
    profile, calibration = f"{own / 'ship_topics.py'}:SHIP", RigCalibration()
    bag = own / ("a.bag" if ros == 1 else "a")
    sample = Speed(sensor="log", frame_id="log", stamp_ns=0, speed_mps=5.14444)
    if ros == 1:
        with Rosbag1Writer(bag, Ros1Encoder(calibration, profile=profile)) as writer:
            writer.write(sample)
    else:
        with Rosbag2Writer(bag, Ros2Encoder(calibration, profile=profile)) as writer2:
            writer2.write(sample)
    with AnyReader([bag]) as reader:
        ((connection, _, raw),) = list(reader.messages())
        assert (connection.topic, connection.msgtype) == ("/log/knots", "ship_msgs/msg/Knots")
        assert reader.deserialize(raw, connection.msgtype).knots == pytest.approx(10.0)


def test_a_kind_of_ones_own(own: Path) -> None:
    """By its file or its module; a rig's text names it so that it is found again; entries change it."""
    text = "name: boat\nsensors:\n- {kind: '%s', reach_m: 7, rate_hz: 10}"
    rig = SensorRig.from_yaml(text % f"{own / 'ship_sensors.py'}:SonarConfig")
    assert rig.to_mapping()["sensors"][0]["kind"] == "ship_sensors:SonarConfig"
    assert SensorRig.from_yaml(rig.to_yaml()) == rig
    longer = "name: b\nextends: boat\nsensors: [{kind: 'ship_sensors:SonarConfig', reach_m: 9}]"
    assert [s.reach_m for s in SensorRig.from_yaml(longer, bases={"boat": lambda: rig}).sensors] == [9.0]  # type: ignore[attr-defined]
    first = own_code_digest(rig, "standard")
    assert len(first) == 64
    (own / "ship_sensors.py").write_text(SENSORS + "\n")
    assert own_code_digest(rig, "standard") != first
    assert len(own_code_digest(rig, f"{own / 'ship_topics.py'}:SHIP").split()) == 2


def test_a_module_of_the_folder_of_work(own: Path) -> None:
    """A program that is not started in a folder of modules finds those where it is started."""
    code = (
        "import sys; sys.path.remove('') if '' in sys.path else None\n"
        "from carlaloc_env.rigs.rig import SensorRig\n"
        "rig = SensorRig.from_yaml(\"sensors: [{kind: 'ship_sensors:SonarConfig'}]\")\n"
        "print(rig.sensors[0].name)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=own, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "sonar"


def test_words_that_name_nothing(own: Path) -> None:
    topics = own / "ship_topics.py"
    for word, message in (
        (f"{topics}:BOAT", "has no attribute 'BOAT'; give FILE.py:NAME, or MODULE:NAME of PYTHONPATH"),
        (f"{topics}:NUMBER", "is no TopicProfile, but int; name another object"),
        ("no_such_file.py:SHIP", "No module named 'no_such_file'"),
        (f"{own / 'json.py'}:SHIP", "Python has another module 'json'"),
    ):
        (own / "json.py").write_text("SHIP = 1")
        with pytest.raises(ConfigError, match=message.replace("(", r"\(")):
            profile_by_name(word)
    with pytest.raises(WriterError, match=r"or FILE\.py:PROFILE"):
        profile_by_name("standart")
    with pytest.raises(ConfigError, match="is no SensorConfig"):
        SensorRig.from_yaml(f"sensors: [{{kind: '{topics}:Speed'}}]")
    with pytest.raises(ConfigError, match=r"did you mean 'lidar'.*or MODULE:CLASS"):
        SensorRig.from_yaml("sensors: [{kind: lidarr}]")
    assert absolute_word("mine.py:X") == f"{Path('mine.py').resolve()}:X"
    assert absolute_word("standard") == "standard"
