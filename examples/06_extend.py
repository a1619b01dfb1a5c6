"""Your own sensor in bags: the sensor's file, one message function, one profile of topics.

Workers of a replay import this file, too: `carlaloc replay drive.mcap --out bumper --rig bumper.yaml
--format rosbag1,rosbag2 --topics examples/06_extend.py:PROFILE` does the same.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from own_sensors.laser import Ranges
from recorder import ENCODERS, ReplayConfig, TopicProfile, TopicRule, replay

RIG = """
name: bumper
sensors:
- {kind: "own_sensors.laser:LaserConfig", rate_hz: 10, mount: {position_m: [3.8, 0, 0.6]}}
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


ENCODERS["laser_scan"] = ("sensor_msgs/msg/LaserScan", laser_scan)
PROFILE = TopicProfile(
    name="mine", rules=(TopicRule(sample=Ranges, stream="*", topic="/{}/scan", message="laser_scan"),)
)


def main(drive: Path, out: Path = Path("bumper")) -> Path:
    """Replay a drive with two workers; returns the folder of the dataset."""
    rig = out.with_name("bumper.yaml")
    rig.write_text(RIG, encoding="utf-8")
    replay(
        ReplayConfig(
            episode=drive,
            out=out,
            rig=str(rig),
            formats=("rosbag1", "rosbag2"),
            topics=f"{__file__}:PROFILE",
            workers=2,
            unit_s=1.0,
        )
    )
    return out


if __name__ == "__main__":
    print("scans in", main(Path(sys.argv[1])))
