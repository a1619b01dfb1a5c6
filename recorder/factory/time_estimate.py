"""How long a dataset takes to make, told before any of it is made: processor time by unit costs.

The figures are processor times of one core of a server without a GPU, which drew with llvmpipe, in Town03
among its traffic: `benchmarks/unit_costs.py` prints all but the spool's. Another machine is faster or slower
as a whole: a dataset that is being made corrects them by its own first unit (`dataset_clock`).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from carlaloc_env.rigs.rig import SensorRig
from carlaloc_env.weather.schedule import Weather
from recorder.factory.size_estimate import bytes_per_second
from recorder.replaying.conditions import Condition
from recorder.replaying.plan import ReplayOptions, without_unwritten

DRIVING_COST = 0.05
"""Processor time of a second that the scripted driver drives among a town's traffic [s/s]."""
OPENING_COST = 11.0
"""What a process takes before its first sample: imports, town, shaders, textures [s]."""
_GEOMETRY, _EVENTS = 0.11, 0.14
"""What all weathers of a picture share, and the events of one [s/Mpx]."""
_SHADING_DAY, _SHADING_NIGHT = 0.05, 0.10
"""A picture under one weather more [s/Mpx]."""
_RAYS, _RADAR = 0.33, 0.008
"""A LiDAR's rays [s/Mray] and a radar's scan [s]."""
_OTHERS = 0.1
"""IMU, truth, boxes and all else of a second of driving [s/s]."""
_SPOOL, _ZSTD = 6e-9, 4e-9
"""To serialise a byte, spool it, assemble it and take its checksums, and to compress it besides [s/byte]."""
_COMPRESSED = {"euroc": 0.018, "kitti": 0.054, "dsec": 0.014, "raw": 0.20}
"""Formats of pictures that are compressed one by one, with a LiDAR's share [s/Mpx]."""
_COMPACT = {"compact": 0.029, "compact_full": 0.058}
"""Topics whose pictures and clouds are compressed [s/Mpx]."""
_FILM = 0.026
"""Panels and film of an instant of a preview [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayCost:
    """Processor time of the replay of a drive."""

    per_second: float
    """A second of the drive under all its conditions [s/s]."""
    opening: float
    """What is done once, whatever the length [s]."""

    def seconds(self, length_s: float, processes: int) -> float:
        """Time that a replay of a length takes [s] if so many processes share it evenly."""
        return self.opening + self.per_second * length_s / processes


def processes_of(config: ReplayOptions) -> int:
    """How many processes can work at a time; those of a cluster are not known, and count as ours."""
    return min(config.workers or os.cpu_count() or 1, os.cpu_count() or 1)


def replay_cost(rig: SensorRig, config: ReplayOptions, conditions: Sequence[Condition]) -> ReplayCost:
    """Processor time of a replay under some conditions, by its rig, formats and weathers."""
    rig = without_unwritten(rig, config.formats, config.topics)
    levels = dict.fromkeys(condition.traffic for condition in conditions)
    cost = 0.0
    for level in levels:
        weathers = [condition.weather for condition in conditions if condition.traffic == level]
        cost += _OTHERS + sum(_sensor(sensor, weathers) for sensor in rig.sensors)
    size = bytes_per_second(rig, config.formats, config.topics)
    zstd = _ZSTD * bytes_per_second(rig, ("rosbag2",), config.topics) if "rosbag2" in config.formats else 0.0
    cost += len(conditions) * (_SPOOL * size + zstd + _formats(rig, config))
    return ReplayCost(per_second=cost, opening=OPENING_COST)


def _sensor(sensor: Any, weathers: Sequence[Weather]) -> float:
    """A second of a sensor under all weathers of a level."""
    if sensor.kind == "camera":
        shading = sum(_SHADING_NIGHT if weather.at(0).is_night else _SHADING_DAY for weather in weathers)
        events = _EVENTS * len(weathers) if "events" in sensor.outputs else 0.0
        return _megapixels(sensor) * float(sensor.rate_hz) * (_GEOMETRY + shading + events)
    if sensor.kind == "lidar":
        return _RAYS * float(sensor.rays) * float(sensor.rate_hz) / 1e6
    return _RADAR * float(sensor.rate_hz) if sensor.kind == "radar" else 0.0


def _formats(rig: SensorRig, config: ReplayOptions) -> float:
    """Compressing pictures and drawing a film, a second of one sequence."""
    cameras = [sensor for sensor in rig.sensors if sensor.kind == "camera"]
    pictures = sum(_megapixels(camera) * float(camera.rate_hz) for camera in cameras)
    compressed = sum(_COMPRESSED.get(name, 0.0) for name in config.formats)
    bags = sum(name.startswith("rosbag") for name in config.formats)
    compressed += bags * _COMPACT.get(config.topics, 0.0)
    filmed = cameras or [sensor for sensor in rig.sensors if sensor.kind == "lidar"]
    film = _FILM * float(filmed[0].rate_hz) if config.preview and filmed else 0.0
    return compressed * pictures + film


def _megapixels(camera: Any) -> float:
    return float(camera.pinhole.width_px * camera.pinhole.height_px) / 1e6
