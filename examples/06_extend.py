"""Your own sensor in a ROS bag: the sensor's file, one message function, one table line."""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from carlaloc_env import SENSOR_KINDS, SensorRig, SensorStage, weather_by_name
from own_sensors.laser import LaserConfig, Ranges
from recorder import (
    ENCODERS,
    PROFILES,
    Episode,
    RigCalibration,
    Ros1Encoder,
    Rosbag1Writer,
    TopicProfile,
    TopicRule,
    town_of,
)

RIG = """
name: bumper
sensors:
- {kind: laser, rate_hz: 10, mount: {position_m: [3.8, 0, 0.6]}}
"""


def laser_scan(maker: Any, header: Any, sample: Ranges) -> Any:
    """The message function: sensor_msgs/LaserScan."""
    step = 2 * np.pi / len(sample.range_m)
    angles = {"angle_min": -np.pi, "angle_max": np.pi - step, "angle_increment": step}
    limits = {"range_min": 0.0, "range_max": 60.0, "time_increment": 0.0, "scan_time": 0.1}
    return maker.new(
        "sensor_msgs/LaserScan",
        header=header,
        **{**angles, **limits, "ranges": sample.range_m, "intensities": np.zeros(0, np.float32)},
    )


def main(drive: Path, out: Path = Path("laser.bag")) -> int:
    """Register sensor, message and topic; measure a whole drive; returns the number of scans written."""
    SENSOR_KINDS["laser"] = LaserConfig
    ENCODERS["laser_scan"] = ("sensor_msgs/msg/LaserScan", laser_scan)
    rule = TopicRule(sample=Ranges, stream="*", topic="/{}/scan", message="laser_scan")
    PROFILES["mine"] = TopicProfile(name="mine", rules=(rule,))
    episode, config = Episode.load(drive), SensorRig.from_yaml(RIG)
    stage = SensorStage(town_of(episode), seed=1, weather=weather_by_name("ClearNoon"))
    scans = config.build(stage).measure(episode.timeline(), -1, episode.timeline().end_ns)
    with Rosbag1Writer(out, Ros1Encoder(RigCalibration.from_configs(config.sensors), profile="mine")) as bag:
        for scan in scans:
            bag.write(scan)
    return len(scans)


if __name__ == "__main__":
    print(main(Path(sys.argv[1])), "scans in laser.bag")
