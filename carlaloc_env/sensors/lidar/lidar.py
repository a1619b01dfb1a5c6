"""LiDAR: every ray cast at its own time from where the sensor then was.

A hit is in the sensor's frame at the time of its own ray, as with a real sensor. The plain and the semantic
cloud come from the same rays and carry the same noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from threading import Thread
from typing import Any

import numpy as np
from gymnasium import spaces

from carlaloc_env.core import clock
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.raycast import Hits
from carlaloc_env.samples import PointCloud, Sample
from carlaloc_env.scene.semantic_tags import Tag
from carlaloc_env.sensors.base import Sensor, World
from carlaloc_env.sensors.lidar.atmosphere import GROUND_TAGS, atmosphere_at
from carlaloc_env.sensors.lidar.doppler import range_rates
from carlaloc_env.sensors.lidar.intensity import EchoModel
from carlaloc_env.sensors.lidar.kernels import (
    ScanHits,
    empty_points,
    points_of,
)
from carlaloc_env.sensors.lidar.receiver import Receiver
from carlaloc_env.sensors.lidar.scan_pattern import Cast, ScanPattern
from carlaloc_env.sensors.lidar.snow_cover import under_snow
from carlaloc_env.sensors.lidar.spray import spray_ranges
from carlaloc_env.sensors.lidar_config import OUTPUTS, LidarConfig
from carlaloc_env.sensors.stochastic_processes import white_noise
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.parameters import WeatherParameters


class LidarSensor(Sensor):
    """Casts one sweep per stamp; rays are ordered by their time, column by column.

    A spinning one turns clockwise seen from above; the seam lies straight behind, where the car's own body
    is.
    """

    config: LidarConfig

    def __init__(self, config: LidarConfig, world: World) -> None:
        super().__init__(config)
        self._world = world
        self.latency_ns = config.sweep_ns
        self.padded_streams = tuple(self._stream_names().values())
        self.depends_on_weather = config.weather
        self._pattern = ScanPattern(config, world)
        self._echoes = EchoModel(config)
        self._receiver: Receiver | None = None
        self._last_cast: tuple[Timeline, tuple[int, int], tuple[Cast, F32]] | None = None

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Padded rows: x, y, z [m], intensity; semantic: x, y, z [m], cos incidence, instance, tag."""
        limit = self.config.range_max_m + 10 * self.config.range_noise_m + 1.0
        low, high = [-limit] * 3, [limit] * 3
        rows = {
            "cloud": ([*low, 0.0], [*high, 255.0]),
            "semantic": ([*low, 0.0, 0.0, 0.0], [*high, 1.0, 2.0**32, 255.0]),
        }
        shape = (self.config.rays, 1)
        boxes: dict[str, spaces.Space[Any]] = {}
        for output, stream in self._stream_names().items():
            lowest, highest = (np.tile(np.array(row, np.float32), shape) for row in rows[output])
            boxes[stream] = spaces.Box(lowest, highest)
        return boxes

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """The clouds of the sweeps that begin at the given stamps [ns]."""
        clouds: list[Sample] = []
        for stamp in map(int, stamps_ns):
            clouds += self.measure_conditions(timeline, stamp, [self._world.weather.at(stamp)])[0]
        return clouds

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[list[Sample]]:
        """The clouds of one sweep under several weathers; rays are cast once."""
        config = self.config
        # One number for every ray that is fired, so that a car in the way of some rays does not change the
        # noise of the others. Drawn beside the casting, in a thread: an executor costs several times as much.
        noise, draw = np.empty(config.rays), clock.stream(self._world.seed, f"{config.name}/range", stamp_ns)
        beside = Thread(target=draw.standard_normal, kwargs={"out": noise})
        beside.start()
        cast, strength = self._cast(timeline, stamp_ns)
        beside.join()
        if not config.weather:
            clouds = self._clouds(timeline, stamp_ns, noise, cast, strength)
            return [clouds for _ in weathers]
        seen = (self._in_weather(timeline, stamp_ns, cast, weather) for weather in weathers)
        return [self._clouds(timeline, stamp_ns, noise, *echoes) for echoes in seen]

    def _cast(self, timeline: Timeline, stamp_ns: int) -> tuple[Cast, F32]:
        """Rays of a sweep, what they meet and how strong that is in clear air.

        Asked for again, as under another seed, they are not cast again; of a pattern the seed turns all rays.
        """
        last, key = self._last_cast, (stamp_ns, self._world.seed if self.config.pattern else 0)
        if last is None or last[0] is not timeline or last[1] != key:
            cast = self._pattern.cast(timeline, stamp_ns, self._echoes.power)
            # In weather, strengths are worked out together with the echoes.
            strength = np.empty(0, np.float32) if self.config.weather else self._echoes.strength(cast.hits)
            last = self._last_cast = timeline, key, (cast, strength)
        return last[2]

    def _stream_names(self) -> dict[str, str]:
        names = {"cloud": self.config.name, "semantic": f"{self.config.name}_semantic"}
        return {output: names[output] for output in OUTPUTS if output in self.config.outputs}

    def _clouds(
        self, timeline: Timeline, stamp_ns: int, noise: Array, cast: Cast, intensity: F32
    ) -> list[Sample]:
        """Samples of what rays met, those out of range and dropped ones left out."""
        config, sweep, seed = self.config, cast.sweep, self._world.seed
        rays, hits, noise_m = cast.rays, cast.hits, config.range_noise_m
        if config.receiver:
            hits, intensity = self._received(stamp_ns, noise, cast, intensity)
            noise_m = 0.0
        kept = np.flatnonzero((hits.range_m >= config.range_min_m) & (hits.range_m <= config.range_max_m))
        if config.drop_weak and not config.weather:
            kept = kept[self._echoes.is_detected(hits.take(kept))]
        if config.dropoff_general or config.dropoff_zero_intensity:
            uniform = clock.stream(seed, f"{config.name}/dropoff", stamp_ns).random((config.rays, 2))
            kept = kept[self._echoes.survives(hits.range_m[kept], uniform[rays[kept]])]
        points = empty_points(len(kept))
        scan = ScanHits(
            ray=rays,
            range_m=hits.range_m,
            intensity=intensity,
            tag=hits.tag,
            instance=hits.instance,
            cos_incidence=hits.cos_incidence,
            direction=sweep.directions,
            origin_m=sweep.origins_m,
            turn=sweep.turn,
            noise=noise,
            ring=sweep.ring,
            offset_ns=sweep.offset_ns,
        )
        points_of(kept, scan, noise_m, points)
        doppler_mps = self._dopplers(timeline, stamp_ns, cast, kept) if config.doppler else None
        clouds: list[Sample] = []
        for output, stream in self._stream_names().items():
            labelled = output == "semantic"
            clouds.append(
                PointCloud(
                    sensor=stream,
                    frame_id=config.frame_id,
                    stamp_ns=stamp_ns,
                    points_xyz_m=points.xyz_m,
                    intensity=points.intensity,
                    ring=points.ring,
                    offset_ns=points.offset_ns,
                    sweep_ns=config.sweep_ns,
                    tag=points.tag if labelled else None,
                    instance=points.instance if labelled else None,
                    cos_incidence=points.cos_incidence if labelled else None,
                    doppler_mps=doppler_mps,
                )
            )
        return clouds

    def _dopplers(self, timeline: Timeline, stamp_ns: int, cast: Cast, kept: Index) -> F32:
        """Measured rates of range of N kept hits [m/s], shape (N,)."""
        config, sweep, rays, hits = self.config, cast.sweep, cast.rays[kept], cast.hits.take(kept)
        aimed = self._pattern.aimed(timeline, stamp_ns, sweep, rays)
        points_m = aimed[:, :3] + self._world.rays().middle_m
        points_m += aimed[:, 3:] * hits.range_m[:, None].astype(np.float64)
        motion = timeline.ego_motion(stamp_ns + sweep.knot_ns).at_mount(config.mount.T_base_sensor)
        rates = range_rates(
            aimed[:, 3:],
            points_m,
            hits.instance,
            stamp_ns + self._pattern.after_ns(sweep, rays),
            motion.velocity_world_mps[sweep.knot[rays]],
            timeline,
        )
        noise = white_noise(self._world.seed, f"{config.name}/doppler", stamp_ns, config.rays)
        return (rates + config.doppler_noise_mps * noise[rays]).astype(np.float32)

    def _received(self, stamp_ns: int, noise: Array, cast: Cast, intensity: F32) -> tuple[Hits, F32]:
        """Hits at their measured ranges, those without an echo at infinity, and measured intensities."""
        config, seed = self.config, self._world.seed
        assert config.receiver
        if self._receiver is None or self._receiver.seed != seed:
            self._receiver = Receiver(config, config.receiver, seed)
        # A flake fills too little of the beam for its echo to decide on the power of the next shot.
        solid = np.flatnonzero(cast.hits.tag != Tag.SNOW)
        rays = cast.rays[solid]
        hiss = white_noise(seed, f"{config.name}/echo", stamp_ns, config.rays)
        drawn = np.stack([noise[rays], hiss[rays]])
        surfaces = cast.hits.take(solid), cast.share[solid], cast.relief_m[solid]
        range_m = (cast.hits.range_m + config.receiver.weak_noise_m * noise[cast.rays]).astype(np.float32)
        measured = np.zeros(len(range_m), np.float32)
        range_m[solid], measured[solid] = self._receiver.measure(cast.sweep.ring[rays], *surfaces, drawn)
        # Weather has decided on intensities already.
        seen = np.rint(intensity) if config.weather else measured
        return dataclasses.replace(cast.hits, range_m=range_m), seen

    def _under_snow(self, timeline: Timeline, stamp_ns: int, cast: Cast, weather: WeatherParameters) -> Hits:
        """What rays meet, with snow on the ground."""
        hits = cast.hits
        rows = np.flatnonzero(np.isin(hits.tag, GROUND_TAGS) & np.isfinite(hits.range_m))
        aimed = self._pattern.aimed(timeline, stamp_ns, cast.sweep, cast.rays[rows])
        points_m = aimed[:, :3] + hits.range_m[rows, None] * aimed[:, 3:] + self._world.rays().middle_m
        return under_snow(hits, rows, points_m, self._world.wheel_tracks(), weather.snow_cover)

    def _in_weather(
        self, timeline: Timeline, stamp_ns: int, cast: Cast, weather: WeatherParameters
    ) -> tuple[Cast, F32]:
        """Rays, what they return under a weather, and how strongly."""
        config, rays, hits = self.config, cast.rays, cast.hits
        air = atmosphere_at(weather, float(config.mount.T_base_sensor[2, 3]))
        drawn = clock.stream(self._world.seed, f"{config.name}/air", stamp_ns).random((config.rays, 6))
        uniform = (1.0 - drawn)[rays]
        if weather.snow_cover > 0.0:
            hits = self._under_snow(timeline, stamp_ns, cast, weather)
        spray = None
        if air.wetness > 0 and len(timeline.catalog):
            aimed = self._pattern.aimed(timeline, stamp_ns, cast.sweep, rays)
            spray = spray_ranges(
                aimed[:, :3] + self._world.rays().middle_m,
                aimed[:, 3:],
                np.minimum(hits.range_m, np.float32(config.range_max_m)),
                stamp_ns + config.sweep_ns // 2,
                timeline,
                wetness=air.wetness,
                uniform=uniform[:, 5],
            )
        seen, echo_hits, intensity = self._echoes.in_weather(hits, air, spray, uniform)
        share, relief_m = cast.share[seen], cast.relief_m[seen]
        return Cast(
            rays=rays[seen], sweep=cast.sweep, hits=echo_hits, share=share, relief_m=relief_m
        ), intensity
