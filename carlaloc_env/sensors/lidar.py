"""Spinning LiDAR: every ray cast at its own time from where the sensor then was.

A hit is given in the sensor's frame at the time of its own ray, as a real sensor reports it; the
plain and the semantic cloud come from the same rays and carry the same noise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from carlaloc_env import geometry, materials
from carlaloc_env.errors import ConfigError
from carlaloc_env.raycast import Hits
from carlaloc_env.samples import PointCloud, Sample
from carlaloc_env.sensors.base import Mount, Sensor, SensorConfig, World
from carlaloc_env.sensors.noise import white
from carlaloc_env.timeline import Timeline

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
    """A spinning LiDAR; the defaults are the CARLA-Loc paper's."""

    kind: ClassVar[str] = "lidar"

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
    ego_returns: bool = False
    """Whether hits on the ego's own body are reported; they always throw a shadow."""
    outputs: tuple[str, ...] = OUTPUTS
    """Streams: ``cloud`` (named as the sensor) and ``semantic`` (with ``_semantic`` behind)."""

    def __post_init__(self) -> None:
        SensorConfig.__post_init__(self)
        what = f"LiDAR '{self.name}'"
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
        self._offset_ns = (self._column_ns[:, None] + self._firing_ns).reshape(-1)
        self._ring = np.tile(order.astype(np.uint16), config.columns)
        self._directions = self._make_directions(order)
        self._rays = self._directions.reshape(3, -1).T
        self._reflectance = materials.table("reflectance")
        self._retro = materials.table("retro")
        self._own_body: Hits | None = None

    def _make_directions(self, order: NDArray[np.intp]) -> Array:
        """Unit directions of all rays in the sensor frame, shape (3, columns, beams)."""
        config = self.config
        elevation = np.radians(np.array(config.elevations_deg)[order] + config.elevation_offset_deg)
        turned = (
            np.arange(config.columns)[:, None] + 0.5
        ) / config.columns + self._firing_ns / config.sweep_ns
        azimuth = math.pi - 2 * math.pi * turned
        flat = np.cos(elevation)
        return np.stack(
            [
                flat * np.cos(azimuth),
                flat * np.sin(azimuth),
                np.broadcast_to(np.sin(elevation), azimuth.shape),
            ]
        )

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
        return [cloud for stamp in stamps_ns for cloud in self._sweep(timeline, int(stamp))]

    def _stream_names(self) -> dict[str, str]:
        names = {"cloud": self.config.name, "semantic": f"{self.config.name}_semantic"}
        return {output: names[output] for output in OUTPUTS if output in self.config.outputs}

    def _sweep(self, timeline: Timeline, stamp_ns: int) -> list[Sample]:
        config = self.config
        rays, hits = self._cast(timeline, stamp_ns)
        # One number for every ray that is fired, so that a car in the way of some rays does not
        # change the noise of the others.
        noise = white(self._world.seed, f"{config.name}/range", stamp_ns, config.rays)
        kept = np.flatnonzero((hits.range_m >= config.range_min_m) & (hits.range_m <= config.range_max_m))
        if config.drop_weak:
            kept = kept[self._is_detected(hits.take(kept))]
        hits, seen = hits.take(kept), rays[kept]
        distance = hits.range_m + config.range_noise_m * noise[seen]
        points = np.empty((len(seen), 3), np.float32)
        for axis in range(3):
            points[:, axis] = self._rays[:, axis][seen] * distance
        intensity = self._intensity(hits)
        clouds: list[Sample] = []
        for output, stream in self._stream_names().items():
            labelled = output == "semantic"
            clouds.append(
                PointCloud(
                    sensor=stream,
                    frame_id=config.frame_id,
                    stamp_ns=stamp_ns,
                    points_xyz_m=points,
                    intensity=intensity,
                    ring=self._ring[seen],
                    offset_ns=self._offset_ns[seen].astype(np.uint32),
                    sweep_ns=config.sweep_ns,
                    tag=hits.tag if labelled else None,
                    instance=hits.instance if labelled else None,
                    cos_incidence=hits.cos_incidence if labelled else None,
                )
            )
        return clouds

    def _cast(self, timeline: Timeline, stamp_ns: int) -> tuple[NDArray[np.intp], Hits]:
        """Rays that may return something in a sweep, and their first hits."""
        config = self.config
        own = self._own_body_hits()
        free = np.flatnonzero(~np.isfinite(own.range_m))
        origins, directions = self._world_rays(timeline, stamp_ns)
        found = self._world.rays().cast(
            np.take(origins, free, axis=1).T,
            np.take(directions, free, axis=1).T,
            stamp_ns + self._offset_ns[free],
            timeline,
            config.range_max_m,
            ego=False,
        )
        if not config.ego_returns:
            return free, found
        hits = dataclasses.replace(own, **{name: getattr(own, name).copy() for name in own.__slots__})
        hits.put(free, found)
        return np.arange(config.rays), hits

    def _own_body_hits(self) -> Hits:
        """Hits on the car's own body, the same in every sweep since both are rigid."""
        if self._own_body is None:
            T = self._T_base_lidar
            directions = geometry.apply(geometry.from_rotation(T[:3, :3]), self._rays)
            origins = np.broadcast_to(T[:3, 3], directions.shape)
            self._own_body = self._world.rays().cast_ego(origins, directions, self.config.range_max_m)
        return self._own_body

    def _world_rays(self, timeline: Timeline, stamp_ns: int) -> tuple[Array, Array]:
        """Origins [m] and directions in the world of all rays at their own times, each (3, rays).

        Poses are read at the start of each column; within its few microseconds the motion is
        continued with constant velocity and rate, which is exact to a nanometre.
        """
        motion = timeline.ego_motion(stamp_ns + self._column_ns).at_mount(self._T_base_lidar)
        local = self._directions
        origins = np.broadcast_to(motion.position_m.T[:, :, None], local.shape)
        if self._firing_ns.any():
            later = self._firing_ns * 1e-9
            w, d = motion.omega_body_radps.T[:, :, None], local
            turning = (w[1] * d[2] - w[2] * d[1], w[2] * d[0] - w[0] * d[2], w[0] * d[1] - w[1] * d[0])
            local = local + later * np.stack(turning)
            origins = origins + later * motion.velocity_world_mps.T[:, :, None]
        R = geometry.quat_to_matrix(motion.quat_xyzw)[..., None]
        x, y, z = local
        directions = np.stack([R[:, k, 0] * x + R[:, k, 1] * y + R[:, k, 2] * z for k in range(3)])
        return origins.reshape(3, -1), directions.reshape(3, -1)

    def _intensity(self, hits: Hits) -> F32:
        """Return strength 0–255: diffuse surfaces up to 100, retro-reflectors above (Velodyne's scale)."""
        diffuse = 100.0 * self._reflectance[hits.material] * hits.cos_incidence
        retro = 155.0 * self._retro[hits.material] * np.sqrt(hits.cos_incidence)
        fade = np.exp(-self.config.attenuation_per_m * hits.range_m.astype(np.float64))
        strength: F32 = np.clip((diffuse + retro) * fade, 0.0, 255.0).astype(np.float32)
        return strength

    def _is_detected(self, hits: Hits) -> NDArray[np.bool_]:
        """Whether the echo ρ·cosθ/R² exceeds that of a 90 % target at the longest range (LISA)."""
        power = self._reflectance[hits.material] * hits.cos_incidence + 10.0 * self._retro[hits.material]
        result: NDArray[np.bool_] = power >= 0.9 * (hits.range_m / self.config.range_max_m) ** 2
        return result
