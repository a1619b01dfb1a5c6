"""Imaging radar at 77 GHz: detections of resolution cells, not rays.

Rays find the surfaces in view; each represents a part of a radar cross-section. Parts in one resolution cell
add up, and the cell's echo fluctuates. Echoes above the detector's threshold are reported with the errors of
their signal-to-noise ratio. One frame is one instant.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from carlaloc_env.samples import RadarScan, Sample
from carlaloc_env.sensors.base import Sensor, World
from carlaloc_env.sensors.radar_config import RadarConfig
from carlaloc_env.sensors.radar_detector import Detector
from carlaloc_env.sensors.radar_equation import RadarEchoes, merge_cells
from carlaloc_env.sensors.radar_targets import RadarView
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.parameters import WeatherParameters


class RadarSensor(Sensor):
    """Gives the detections of one frame per stamp; Doppler is positive when the distance grows.

    A detection of a thing at rest reads −û·v, with û towards it and v the radar's own velocity.
    """

    config: RadarConfig

    def __init__(self, config: RadarConfig, world: World) -> None:
        super().__init__(config)
        self._world = world
        self.padded_streams = (config.stream,)
        self.depends_on_weather = config.weather
        self._T_base_radar = config.mount.T_base_sensor
        self._view = RadarView(config, world)
        self._detector = Detector(config, world)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Padded rows: x, y, z [m], Doppler [m/s], SNR [dB], RCS [dBsm]."""
        limit = 1.1 * self.config.range_max_m
        low = np.array([-limit, -limit, -limit, -500.0, -100.0, -200.0], np.float32)
        shape = (self.config.detections_max, 1)
        return {self.config.stream: spaces.Box(np.tile(low, shape), np.tile(-low, shape))}

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """One `RadarScan` per stamp [ns]."""
        return [
            self._frame(timeline, int(stamp), [self._world.weather.at(int(stamp))])[0] for stamp in stamps_ns
        ]

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[list[Sample]]:
        """The frame of one instant under several weathers, one list per weather."""
        return [[scan] for scan in self._frame(timeline, int(stamp_ns), weathers)]

    def _frame(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[RadarScan]:
        motion = timeline.ego_motion([stamp_ns]).at_mount(self._T_base_radar)
        scenery, actors, mirrors = self._view.echoes(timeline, stamp_ns, motion)
        cells = merge_cells(RadarEchoes.joined([scenery, actors]), self._detector.cell)
        ghosts = merge_cells(mirrors, self._detector.cell)
        return [self._detector.detections(cells, ghosts, motion, stamp_ns, weather) for weather in weathers]
