"""Measure a recorded drive with a sensor that the package does not have: `own_sensors/barometer.py`."""

import sys
from pathlib import Path

from carlaloc_env import SENSOR_KINDS, SensorRig, SensorStage, weather_by_name
from own_sensors.barometer import BarometerConfig, Pressure
from recorder import Episode, town_of

RIG = """
name: weather_station
sensors:
- {kind: barometer, rate_hz: 10, noise_pa: 2}
"""


def main(drive: Path, rig_yaml: str = RIG) -> list[Pressure]:
    """Register the sensor, build a rig that names it, and read it over the whole drive."""
    SENSOR_KINDS["barometer"] = BarometerConfig
    episode = Episode.load(drive)
    timeline = episode.timeline()
    stage = SensorStage(town_of(episode), seed=1, weather=weather_by_name("ClearNoon"))
    rig = SensorRig.from_yaml(rig_yaml).build(stage)
    readings = [s for s in rig.measure(timeline, -1, timeline.end_ns) if isinstance(s, Pressure)]
    for reading in readings[:: max(len(readings) // 5, 1)]:
        print(f"{reading.stamp_ns / 1e9:6.2f} s  {reading.pressure_pa:.1f} Pa")
    return readings


if __name__ == "__main__":
    main(Path(sys.argv[1]))
