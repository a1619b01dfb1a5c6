"""Spinning LiDAR: every ray cast at its own time from where the sensor then was.

A hit is given in the sensor's frame at the time of its own ray, as a real sensor reports it; the
plain and the semantic cloud come from the same rays and carry the same noise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env import geometry, materials, rng
from carlaloc_env.errors import ConfigError, unknown_name
from carlaloc_env.raycast import Hits
from carlaloc_env.samples import PointCloud, Sample
from carlaloc_env.semantics import TAG_TABLES, tags_in
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.lidar_air import GROUND_TAGS, air_at
from carlaloc_env.sensors.lidar_beam import sub_rays, weigh
from carlaloc_env.sensors.lidar_kernels import aim, points_of, strengths
from carlaloc_env.sensors.lidar_spray import spray_ranges
from carlaloc_env.sensors.lidar_weather import BEAM_MRAD, SolidEchoes, strongest_echoes
from carlaloc_env.sensors.noise import white
from carlaloc_env.timeline import Timeline
from carlaloc_env.weather import WeatherParameters

Array = NDArray[np.float64]
F32 = NDArray[np.float32]

PAPER_ELEVATIONS_DEG: tuple[float, ...] = tuple(round(-30.0 + 40.0 * i / 31, 9) for i in range(32))
"""32 beams evenly from −30° to +10°, as CARLA's LiDAR spaces them [deg]."""
HDL32E_ELEVATIONS_DEG: tuple[float, ...] = (
    -30.67, -29.33, -28.0, -26.67, -25.33, -24.0, -22.67, -21.33, -20.0, -18.67, -17.33, -16.0, -14.67,
    -13.33, -12.0, -10.67, -9.33, -8.0, -6.67, -5.33, -4.0, -2.67, -1.33, 0.0, 1.33, 2.67, 4.0, 5.33,
    6.67, 8.0, 9.33, 10.67,
)  # fmt: skip
"""Beams of the Velodyne HDL-32E [deg]; user manual, page 13."""
HDL32E_FIRING_NS: tuple[int, ...] = tuple(1152 * (2 * r if r < 16 else 2 * (r - 16) + 1) for r in range(32))
"""When each beam of the HDL-32E fires in its 46.08 µs cycle [ns]: lower and upper bank in turn."""
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
        self._T_base_lidar = config.mount.T_base_sensor
        self._column_ns = np.round(np.arange(config.columns) * config.sweep_ns / config.columns).astype(
            np.int64
        )
        firing = np.array(config.firing_ns or [0] * len(config.elevations_deg), dtype=np.int64)
        order = np.argsort(firing, kind="stable")
        self._firing_ns = firing[order]
        self._offset_ns = (self._column_ns[:, None] + self._firing_ns).reshape(-1).astype(np.uint32)
        self._later_s = np.tile(1e-9 * self._firing_ns, config.columns)
        if config.sectors:
            held = np.arange(config.columns) * config.sectors // config.columns
            self._column_ns = held * config.sweep_ns // config.sectors
            self._offset_ns = np.repeat(self._column_ns, len(firing)).astype(np.uint32)
            self._later_s[:] = 0.0
        self.depends_on_weather = config.weather
        self._ring = np.tile(order.astype(np.uint16), config.columns)
        self._column = np.repeat(np.arange(config.columns), len(firing))
        self._rays = self._make_directions(order)
        self._rays_base = geometry.apply(geometry.from_rotation(self._T_base_lidar[:3, :3]), self._rays)
        self._reflectance = materials.table("reflectance")
        self._retro = materials.table("retro")

    def _make_directions(self, order: NDArray[np.intp]) -> Array:
        """Unit directions of all rays in the sensor frame, shape (rays, 3)."""
        config = self.config
        elevation = np.radians(np.array(config.elevations_deg)[order] + config.elevation_offset_deg)
        turned = (
            np.arange(config.columns)[:, None] + 0.5
        ) / config.columns + self._firing_ns / config.sweep_ns
        azimuth = math.pi - 2 * math.pi * turned
        flat = np.cos(elevation)
        up = np.broadcast_to(np.sin(elevation), azimuth.shape)
        along: Array = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), up], axis=-1)
        return along.reshape(-1, 3)

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
            rays, hits = self._cast(timeline, stamp_ns)
            noise = drawn.result()
        if not config.weather:
            clouds = self._clouds(stamp_ns, noise, rays, hits, self._intensity(hits))
            return [clouds for _ in weathers]
        return [
            self._clouds(stamp_ns, noise, *self._felt(timeline, stamp_ns, rays, hits, w)) for w in weathers
        ]

    def _stream_names(self) -> dict[str, str]:
        names = {"cloud": self.config.name, "semantic": f"{self.config.name}_semantic"}
        return {output: names[output] for output in OUTPUTS if output in self.config.outputs}

    def _clouds(
        self, stamp_ns: int, noise: Array, rays: NDArray[np.intp], hits: Hits, intensity: F32
    ) -> list[Sample]:
        """Samples of what rays met, those out of range and dropped ones left out."""
        config, seed = self.config, self._world.seed
        kept = np.flatnonzero((hits.range_m >= config.range_min_m) & (hits.range_m <= config.range_max_m))
        if config.drop_weak and not config.weather:
            kept = kept[self._is_detected(hits.take(kept))]
        if config.dropoff_general or config.dropoff_zero_intensity:
            lots = rng.stream(seed, f"{config.name}/dropoff", stamp_ns).random((config.rays, 2))
            kept = kept[self._stays(hits.range_m[kept], lots[rays[kept]])]
        count = len(kept)
        points, strength, cosine = (np.empty(shape, np.float32) for shape in ((count, 3), count, count))
        ring, tag = np.empty(count, np.uint16), np.empty(count, np.uint8)
        offset_ns, instance = np.empty(count, np.uint32), np.empty(count, np.uint32)
        points_of(
            kept,
            (rays, self._rays, noise, self._ring, self._offset_ns),
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

    def _cast(self, timeline: Timeline, stamp_ns: int) -> tuple[NDArray[np.intp], Hits]:
        """Rays that may return something in a sweep, and their first hits."""
        config = self.config
        own, free = self._own_body
        world, aimed = self._world.rays(), self._aimed(timeline, stamp_ns, free)
        when = stamp_ns + self._offset_ns[free].astype(np.int64)
        found = world.trace(aimed, when, timeline, config.range_max_m)
        if config.divergence_mrad:
            beams = [found]
            for along in sub_rays(aimed[:, 3:].astype(np.float64), 1e-3 * config.divergence_mrad):
                aimed[:, 3:] = along
                beams.append(world.trace(aimed, when, timeline, config.range_max_m))
            found = weigh(beams, self._power)
        if not config.ego_returns:
            return free, found
        hits = dataclasses.replace(own, **{name: getattr(own, name).copy() for name in own.__slots__})
        hits.put(free, found)
        return np.arange(config.rays), hits

    @cached_property
    def _own_body(self) -> tuple[Hits, NDArray[np.intp]]:
        """Hits on the car's own body, and rays that pass it: the same in every sweep, both are rigid."""
        origins = np.broadcast_to(self._T_base_lidar[:3, 3], self._rays_base.shape)
        own = self._world.rays().cast_ego(origins, self._rays_base, self.config.range_max_m)
        return own, np.flatnonzero(~np.isfinite(own.range_m))

    def _aimed(self, timeline: Timeline, stamp_ns: int, rays: NDArray[np.intp]) -> F32:
        """Some rays at their own times, as `RayScene.trace` takes them, shape (N, 6).

        Poses are read at the start of each column; within its few microseconds the motion is
        continued with constant velocity and rate, which is exact to a nanometre.
        """
        motion = timeline.ego_motion(stamp_ns + self._column_ns)
        lever, omega = self._T_base_lidar[:3, 3], motion.omega_body_radps
        R = geometry.quat_to_matrix(motion.quat_xyzw)
        swing = geometry.cross(omega, np.broadcast_to(lever, omega.shape))
        aimed = np.empty((len(rays), 6), np.float32)
        aim(
            rays,
            (self._column, self._later_s, self._rays_base),
            R,
            motion.position_m + np.sum(R * lever, axis=-1) - self._world.rays().middle_m,
            motion.velocity_world_mps + np.sum(R * swing[:, None], axis=-1),
            omega,
            aimed,
        )
        return aimed

    def _intensity(self, hits: Hits) -> F32:
        """Return strength 0–255: diffuse surfaces up to 100, retro-reflectors above (Velodyne's scale)."""
        strength = np.empty(len(hits), np.float32)
        strengths(
            hits.range_m,
            hits.material,
            hits.cos_incidence,
            self._reflectance,
            self._retro,
            self.config.attenuation_per_m,
            strength,
        )
        return strength

    def _power(self, hits: Hits) -> Array:
        """Strength of echoes without their R⁻²: ρ·cosθ, and ten times as much for retro-reflectors."""
        diffuse = self._reflectance[hits.material] * hits.cos_incidence
        return (diffuse + 10.0 * self._retro[hits.material]).astype(np.float64)

    def _is_detected(self, hits: Hits) -> NDArray[np.bool_]:
        """Whether the echo ρ·cosθ/R² exceeds that of a 90 % target at the longest range (LISA)."""
        share = (hits.range_m / self.config.range_max_m).astype(np.float64)
        result: NDArray[np.bool_] = self._power(hits) >= 0.9 * share * share
        return result

    def _stays(self, range_m: F32, lots: Array) -> NDArray[np.bool_]:
        """Whether points survive CARLA's drop-off (RayCastLidar.cpp): some of all, more of the weak."""
        config = self.config
        intensity = np.exp(-config.attenuation_per_m * range_m.astype(np.float64))
        slope = config.dropoff_zero_intensity / config.dropoff_intensity_limit
        likely = slope * intensity + 1.0 - config.dropoff_zero_intensity
        strong = intensity > config.dropoff_intensity_limit
        result: NDArray[np.bool_] = (lots[:, 0] >= config.dropoff_general) & (strong | (lots[:, 1] < likely))
        return result

    def _felt(
        self,
        timeline: Timeline,
        stamp_ns: int,
        rays: NDArray[np.intp],
        hits: Hits,
        weather: WeatherParameters,
    ) -> tuple[NDArray[np.intp], Hits, F32]:
        """Rays, what they return under a weather, and how strongly: the strongest echo of each wins.

        Echoes of fog, drops and spray have no tag and no instance.
        """
        config = self.config
        air = air_at(weather, float(self._T_base_lidar[2, 3]))
        lots = 1.0 - rng.stream(self._world.seed, f"{config.name}/air", stamp_ns).random((config.rays, 6))
        lots = lots[rays]
        reach = np.minimum(hits.range_m, np.float32(config.range_max_m))
        spray = None
        if air.wetness > 0 and len(timeline.catalog):
            aimed, middle = self._aimed(timeline, stamp_ns, rays), stamp_ns + config.sweep_ns // 2
            spray = spray_ranges(
                aimed[:, :3] + self._world.rays().middle_m,
                aimed[:, 3:],
                reach,
                middle,
                timeline,
                wetness=air.wetness,
                uniform=lots[:, 5],
            )
        ground = np.isin(hits.tag, GROUND_TAGS)
        echoes = SolidEchoes(
            range_m=reach.astype(np.float64),
            power=np.where(np.isfinite(hits.range_m), self._power(hits), 0.0),
            intensity=self._intensity(hits).astype(np.float64),
            reflectance=np.where(ground, self._reflectance[hits.material], 0.0).astype(np.float64),
            cos_incidence=hits.cos_incidence.astype(np.float64),
        )
        place, intensity, airborne = strongest_echoes(
            air,
            echoes,
            beam_rad=1e-3 * (config.divergence_mrad or BEAM_MRAD),
            range_min_m=config.range_min_m,
            power_min=0.9 / config.range_max_m**2,
            spray_m=spray,
            lots=lots,
        )
        seen = np.flatnonzero(np.isfinite(place))
        found = hits.take(seen)
        soft = np.flatnonzero(airborne[seen])
        found.put(soft, Hits.none(len(soft)))
        found.range_m[:] = place[seen]
        found.cos_incidence[soft] = 1.0
        return rays[seen], found, intensity[seen]
