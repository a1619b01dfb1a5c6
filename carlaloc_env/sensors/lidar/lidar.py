"""Spinning LiDAR: every ray cast at its own time from where the sensor then was.

A hit is given in the sensor's frame at the time of its own ray, as a real sensor reports it; the
plain and the semantic cloud come from the same rays and carry the same noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env.core import rng
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.raycast import Hits
from carlaloc_env.samples import PointCloud, Sample
from carlaloc_env.scene.semantic_tags import TAG_TABLES, tags_in
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.inertial.stochastic_processes import white
from carlaloc_env.sensors.lidar.atmosphere import air_at
from carlaloc_env.sensors.lidar.intensity import Echoes
from carlaloc_env.sensors.lidar.kernels import points_of
from carlaloc_env.sensors.lidar.road_spray import spray_ranges
from carlaloc_env.sensors.lidar.scan_pattern import Revolution
from carlaloc_env.sensors.lidar_models import HDL32E_ELEVATIONS_DEG, HDL32E_FIRING_NS, PAPER_ELEVATIONS_DEG
from carlaloc_env.timeline.timeline import Timeline
from carlaloc_env.weather.parameters import WeatherParameters

Array = NDArray[np.float64]
F32 = NDArray[np.float32]
Index = NDArray[np.intp]

OUTPUTS = ("cloud", "semantic")
"""Streams that a LiDAR can give."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarConfig(SensorConfig):
    """A spinning LiDAR; the defaults are the CARLA-Loc paper's.

    ``preset: hdl32e`` has the angles, firing order and timing of the Velodyne HDL-32E, its elevations
    0.02° higher so that none lies on the edge of A-LOAM's ring bins.
    """

    kind: ClassVar[str] = "lidar"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "paper": {},
        "hdl32e": {
            "elevations_deg": HDL32E_ELEVATIONS_DEG,
            "elevation_offset_deg": 0.02,
            "firing_ns": HDL32E_FIRING_NS,
            "columns": 1085,
        },
    }

    name: str = "lidar"
    """Name of the sensor, its first stream and its frame."""
    mount: Mount = field(default_factory=Mount)
    """Where it sits on the car."""
    rate_hz: float = 20.0
    """Revolutions per second [Hz]."""
    elevations_deg: tuple[float, ...] = PAPER_ELEVATIONS_DEG
    """Elevation of each beam, lowest first [deg]."""
    elevation_offset_deg: float = 0.0
    """Added to every elevation [deg]; +0.02 keeps A-LOAM's ring formula off its bin edges."""
    firing_ns: tuple[int, ...] = ()
    """When each beam fires after its column began [ns]; none = all at once."""
    columns: int = 2078
    """Firings of all beams in one revolution."""
    range_min_m: float = 1.0
    """Nearest return [m]."""
    range_max_m: float = 120.0
    """Farthest return [m]."""
    range_noise_m: float = 0.02
    """Standard deviation along the ray [m]."""
    attenuation_per_m: float = 0.004
    """Loss of intensity on the way there, exp(−a·R) [1/m]; CARLA's default."""
    drop_weak: bool = False
    """Whether surfaces too dark for their distance give no return."""
    sectors: int = 0
    """Parts of a revolution in which time stands still, 10 = CARLA at 200 Hz; 0: time runs on."""
    divergence_mrad: float = 0.0
    """Width of the beam [mrad]; above 0 five rays per beam are weighed, which mixes near edges."""
    dropoff_general: float = 0.0
    """Share of points lost at random, as CARLA's, 0.45 = its default."""
    dropoff_intensity_limit: float = 0.8
    """Intensity exp(−a·R) above which no point is lost for weakness, 1 = at the sensor."""
    dropoff_zero_intensity: float = 0.0
    """Share of points of no intensity that are lost, as CARLA's, 0.4 = its default."""
    weather: bool = False
    """Whether fog, rain, spray and wet ground are felt; weak returns are dropped then."""
    ego_returns: bool = False
    """Whether hits on the ego's own body are reported; they always throw a shadow."""
    outputs: tuple[str, ...] = OUTPUTS
    """Streams: ``cloud`` (named as the sensor) and ``semantic`` (with ``_semantic`` behind)."""
    tag_table: str = TAG_TABLES[0]
    """Numbers of the semantic tags: as in CARLA ``0.9.14`` and later, or up to ``0.9.13``."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        what = f"LiDAR '{self.name}'"
        if self.tag_table not in TAG_TABLES:
            raise ConfigError(unknown_name("tag table", self.tag_table, TAG_TABLES))
        if not self.elevations_deg or any(abs(e) > 90 for e in self.elevations_deg):
            raise ConfigError(f"{what}: elevations_deg needs angles from −90 to 90")
        if list(self.elevations_deg) != sorted(self.elevations_deg):
            raise ConfigError(f"{what}: list elevations_deg from the lowest to the highest")
        if self.firing_ns and len(self.firing_ns) != len(self.elevations_deg):
            raise ConfigError(f"{what}: {len(self.firing_ns)} firing_ns for {len(self.elevations_deg)} beams")
        if self.firing_ns and not 0 <= min(self.firing_ns) <= max(self.firing_ns) < 1e9 / (
            self.rate_hz * max(self.columns, 1)
        ):
            raise ConfigError(f"{what}: firing_ns must lie within one column")
        if self.columns < 1 or not 0 <= self.range_min_m < self.range_max_m or self.range_noise_m < 0:
            raise ConfigError(f"{what}: needs columns ≥ 1, 0 ≤ range_min_m < range_max_m, range_noise_m ≥ 0")
        shares = (self.dropoff_general, self.dropoff_intensity_limit, self.dropoff_zero_intensity)
        if not all(0.0 <= share <= 1.0 for share in shares) or self.dropoff_intensity_limit == 0.0:
            raise ConfigError(f"{what}: drop-off figures must lie in 0…1, the intensity limit above 0")
        if self.sectors < 0 or self.divergence_mrad < 0:
            raise ConfigError(f"{what}: sectors and divergence_mrad must not be negative")
        if not self.outputs or set(self.outputs) - set(OUTPUTS):
            raise ConfigError(f"{what}: outputs {list(self.outputs)}; choose from {', '.join(OUTPUTS)}")

    @property
    def sweep_ns(self) -> int:
        """Length of a revolution [ns]."""
        return round(1e9 / self.rate_hz)

    @property
    def rays(self) -> int:
        """Rays in one revolution, the most points a cloud can have."""
        return self.columns * len(self.elevations_deg)

    def build(self, world: World) -> LidarSensor:
        """The LiDAR in a world."""
        return LidarSensor(self, world)


class LidarSensor(Sensor):
    """Casts one revolution per stamp; rays are ordered by their time, column by column.

    It turns clockwise seen from above; the seam lies straight behind, where the car's own body is.
    """

    config: LidarConfig

    def __init__(self, config: LidarConfig, world: World) -> None:
        super().__init__(config)
        self._world = world
        self.latency_ns = config.sweep_ns
        self.padded_streams = tuple(self._stream_names().values())
        self.depends_on_weather = config.weather
        self._turn = Revolution(config, world)
        self._echoes = Echoes(config)

    def streams(self) -> dict[str, spaces.Space[Any]]:
        """Padded rows: x, y, z [m], intensity; semantic: x, y, z [m], cos incidence, instance, tag."""
        reach = self.config.range_max_m + 10 * self.config.range_noise_m + 1.0
        low, high = [-reach] * 3, [reach] * 3
        rows = {
            "cloud": (np.array([*low, 0.0], np.float32), np.array([*high, 255.0], np.float32)),
            "semantic": (
                np.array([*low, 0.0, 0.0, 0.0], np.float32),
                np.array([*high, 1.0, 2.0**32, 255.0], np.float32),
            ),
        }
        shape = (self.config.rays, 1)
        return {
            stream: spaces.Box(np.tile(rows[output][0], shape), np.tile(rows[output][1], shape))
            for output, stream in self._stream_names().items()
        }

    def measure(self, timeline: Timeline, stamps_ns: Sequence[int]) -> list[Sample]:
        """The clouds of the sweeps that begin at the given stamps [ns]."""
        return [
            cloud
            for stamp in stamps_ns
            for cloud in self.measure_conditions(timeline, int(stamp), [self._world.weather.at(int(stamp))])[
                0
            ]
        ]

    def measure_conditions(
        self, timeline: Timeline, stamp_ns: int, weathers: Sequence[WeatherParameters]
    ) -> list[list[Sample]]:
        """The clouds of one sweep under several weathers; rays are cast once."""
        config = self.config
        with ThreadPoolExecutor(1) as beside:
            # One number for every ray that is fired, so that a car in the way of some rays does not
            # change the noise of the others.
            drawn = beside.submit(white, self._world.seed, f"{config.name}/range", stamp_ns, config.rays)
            rays, hits = self._turn.cast(timeline, stamp_ns, self._echoes.power)
            noise = drawn.result()
        if not config.weather:
            clouds = self._clouds(stamp_ns, noise, rays, hits, self._echoes.strength(hits))
            return [clouds for _ in weathers]
        return [
            self._clouds(stamp_ns, noise, *self._felt(timeline, stamp_ns, rays, hits, w)) for w in weathers
        ]

    def _stream_names(self) -> dict[str, str]:
        names = {"cloud": self.config.name, "semantic": f"{self.config.name}_semantic"}
        return {output: names[output] for output in OUTPUTS if output in self.config.outputs}

    def _clouds(self, stamp_ns: int, noise: Array, rays: Index, hits: Hits, intensity: F32) -> list[Sample]:
        """Samples of what rays met, those out of range and dropped ones left out."""
        config, turn, seed = self.config, self._turn, self._world.seed
        kept = np.flatnonzero((hits.range_m >= config.range_min_m) & (hits.range_m <= config.range_max_m))
        if config.drop_weak and not config.weather:
            kept = kept[self._echoes.is_detected(hits.take(kept))]
        if config.dropoff_general or config.dropoff_zero_intensity:
            lots = rng.stream(seed, f"{config.name}/dropoff", stamp_ns).random((config.rays, 2))
            kept = kept[self._echoes.stays(hits.range_m[kept], lots[rays[kept]])]
        count = len(kept)
        points, strength, cosine = (np.empty(shape, np.float32) for shape in ((count, 3), count, count))
        ring, tag = np.empty(count, np.uint16), np.empty(count, np.uint8)
        offset_ns, instance = np.empty(count, np.uint32), np.empty(count, np.uint32)
        points_of(
            kept,
            (rays, turn.directions, noise, turn.ring, turn.offset_ns),
            config.range_noise_m,
            (hits.range_m, intensity, hits.tag, hits.instance, hits.cos_incidence),
            points,
            (strength, ring, offset_ns, tag, instance, cosine),
        )
        clouds: list[Sample] = []
        for output, stream in self._stream_names().items():
            labelled = output == "semantic"
            clouds.append(
                PointCloud(
                    sensor=stream,
                    frame_id=config.frame_id,
                    stamp_ns=stamp_ns,
                    points_xyz_m=points,
                    intensity=strength,
                    ring=ring,
                    offset_ns=offset_ns,
                    sweep_ns=config.sweep_ns,
                    tag=tags_in(config.tag_table, tag) if labelled else None,
                    instance=instance if labelled else None,
                    cos_incidence=cosine if labelled else None,
                )
            )
        return clouds

    def _felt(
        self, timeline: Timeline, stamp_ns: int, rays: Index, hits: Hits, weather: WeatherParameters
    ) -> tuple[Index, Hits, F32]:
        """Rays, what they return under a weather, and how strongly."""
        config = self.config
        air = air_at(weather, float(config.mount.T_base_sensor[2, 3]))
        lots = 1.0 - rng.stream(self._world.seed, f"{config.name}/air", stamp_ns).random((config.rays, 6))
        lots = lots[rays]
        spray = None
        if air.wetness > 0 and len(timeline.catalog):
            aimed = self._turn.aimed(timeline, stamp_ns, rays)
            spray = spray_ranges(
                aimed[:, :3] + self._world.rays().middle_m,
                aimed[:, 3:],
                np.minimum(hits.range_m, np.float32(config.range_max_m)),
                stamp_ns + config.sweep_ns // 2,
                timeline,
                wetness=air.wetness,
                uniform=lots[:, 5],
            )
        seen, found, intensity = self._echoes.in_weather(hits, air, spray, lots)
        return rays[seen], found, intensity
