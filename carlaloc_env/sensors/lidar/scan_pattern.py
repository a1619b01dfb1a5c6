"""Settings of LiDARs, and the directions and times of their rays.

Scan pattern of a LiDAR: directions and times of the rays of one revolution, and their hits.

Configuration of spinning LiDARs, and the beams of those that have a name.

Beam divergence: several rays per beam, and the echo that their energies make.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from carlaloc_env.core import elementary, transforms
from carlaloc_env.core.array_types import F32, Array, Index
from carlaloc_env.core.errors import ConfigError, unknown_name
from carlaloc_env.raycast import Hits
from carlaloc_env.scene.materials import TAG_TABLES
from carlaloc_env.sensors.base import LIMITS, Mount, SensorConfig, World
from carlaloc_env.sensors.lidar.kernels import ColumnMotion, PatternRays, aim
from carlaloc_env.timeline.timeline import Timeline

PULSE_LENGTH_M = 0.6
"""Surfaces nearer to each other than this give one echo between them [m]."""
_RING = 0.35
"""Where the rays around the middle lie, in beam widths: the radius that halves the beam's energy."""


def sub_rays(directions: Array, divergence_rad: float) -> Iterator[Array]:
    """Unit directions of four rays around each of N, a beam of full width `divergence_rad`, each (N, 3)."""
    flat = np.stack([-directions[:, 1], directions[:, 0], np.zeros(len(directions))], axis=-1)
    size = np.sqrt(np.sum(flat * flat, axis=-1))[:, None]
    sideways = np.where(size > 1e-9, flat / np.maximum(size, 1e-9), np.array([0.0, 1.0, 0.0]))
    above = transforms.cross(directions, sideways)
    for right, up in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        moved = directions + _RING * divergence_rad * (right * sideways + up * above)
        yield moved / np.sqrt(np.sum(moved * moved, axis=-1))[:, None]


def weigh(beams: list[Hits], power: Callable[[Hits], Array]) -> Hits:
    """One hit per beam out of its rays: the strongest group of surfaces, at its energy's middle.

    Args:
        beams: Hits of S rays of each of N beams, the middle ray first.
        power: ρ·cosθ of hits; echoes fall with R⁻² beyond it.
    """
    ranges = np.stack([hits.range_m.astype(np.float64) for hits in beams])
    met = np.isfinite(ranges)
    safe = np.where(met, ranges, 1.0)
    energy = np.where(met, np.stack([power(hits) for hits in beams]) / (safe * safe), 0.0)
    total, middle = np.zeros_like(ranges), np.zeros_like(ranges)
    for k in range(len(beams)):
        near = met & met[k] & (np.abs(ranges - safe[k]) < PULSE_LENGTH_M)
        group = np.where(near, energy, 0.0)
        total[k] = np.sum(group, axis=0)
        middle[k] = np.sum(group * safe, axis=0) / np.where(total[k] > 0, total[k], 1.0)
    # The middle ray decides between equals, and where nothing reflects at all.
    best = np.argmax(np.where(met, total * (1 + 1e-9 * (np.arange(len(beams)) == 0)[:, None]), -1.0), axis=0)
    result = Hits.none(len(best))
    for k, hits in enumerate(beams):
        rows = np.flatnonzero((best == k) & met[k])
        result.put(rows, hits.take(rows))
        result.range_m[rows] = np.where(total[k, rows] > 0, middle[k, rows], ranges[k, rows])
    return result


class ScanPattern:
    """Rays of one scan in the order of their time; those of one column, in that of firing."""

    ring: NDArray[np.uint16]
    """Beam of each ray, 0 = lowest, shape (rays,)."""
    offset_ns: NDArray[np.uint32]
    """Time of each ray after the sweep began [ns], shape (rays,)."""
    directions: Array
    """Unit directions in the sensor frame, shape (rays, 3)."""

    def __init__(self, config: LidarConfig, world: World) -> None:
        self._config, self._world = config, world
        self._T_base_lidar = config.mount.T_base_sensor
        columns = np.arange(config.columns)
        firing = np.array(config.firing_ns or [0] * len(config.elevations_deg), dtype=np.int64)
        order = np.argsort(firing, kind="stable")
        self._firing_ns = firing[order]
        self._column_ns = np.round(columns * config.sweep_ns / config.columns).astype(np.int64)
        self._column = np.repeat(columns, len(firing))
        self.ring = np.tile(order.astype(np.uint16), config.columns)
        self.directions = self._make_directions(order)
        self._directions_base = transforms.apply(
            transforms.from_rotation(self._T_base_lidar[:3, :3]), self.directions
        )
        if config.sectors:
            self._column_ns = columns * config.sectors // config.columns * config.sweep_ns // config.sectors
            self._firing_ns = np.zeros_like(self._firing_ns)
        self._later_s = np.tile(1e-9 * self._firing_ns, config.columns)
        self.offset_ns = (self._column_ns[:, None] + self._firing_ns).reshape(-1).astype(np.uint32)

    def cast(self, timeline: Timeline, stamp_ns: int, power: Callable[[Hits], Array]) -> tuple[Index, Hits]:
        """Rays that may return something in a scan (M,), and their first hits.

        Args:
            timeline: Where everything is.
            stamp_ns: When the sweep begins [ns].
            power: Strength of echoes, for beams of more than one ray.
        """
        config = self._config
        body, free, free_ns = self._own_body
        world, aimed = self._world.rays(), self.aimed(timeline, stamp_ns, free)
        stamps_ns = stamp_ns + free_ns
        found = world.trace(aimed, stamps_ns, timeline, config.range_max_m)
        if config.divergence_mrad:
            beams = [found]
            for along in sub_rays(aimed[:, 3:].astype(np.float64), 1e-3 * config.divergence_mrad):
                aimed[:, 3:] = along
                beams.append(world.trace(aimed, stamps_ns, timeline, config.range_max_m))
            found = weigh(beams, power)
        if not config.ego_returns:
            return free, found
        hits = dataclasses.replace(body, **{name: getattr(body, name).copy() for name in body.__slots__})
        hits.put(free, found)
        return np.arange(config.rays), hits

    @cached_property
    def _own_body(self) -> tuple[Hits, Index, NDArray[np.int64]]:
        """Hits on the car's own body, rays that pass it, and their times after the sweep began [ns].

        They are the same in every sweep, since body and LiDAR are rigid.
        """
        origins = np.broadcast_to(self._T_base_lidar[:3, 3], self._directions_base.shape)
        own = self._world.rays().cast_ego(origins, self._directions_base, self._config.range_max_m)
        free = np.flatnonzero(~np.isfinite(own.range_m))
        return own, free, self.offset_ns[free].astype(np.int64)

    def aimed(self, timeline: Timeline, stamp_ns: int, rays: Index) -> F32:
        """Some rays at their own times, as `RayScene.trace` takes them, shape (N, 6).

        Poses are read at the start of each column; within its few microseconds the motion is
        continued with constant velocity and rate, which is exact to a nanometre.
        """
        motion = timeline.ego_motion(stamp_ns + self._column_ns)
        aimed = np.empty((len(rays), 6), np.float32)
        aim(
            rays,
            PatternRays(self._column, self._later_s, self._directions_base),
            self._T_base_lidar[:3, 3],
            ColumnMotion(
                position_m=motion.position_m - self._world.rays().middle_m,
                quat_xyzw=motion.quat_xyzw,
                velocity_mps=motion.velocity_world_mps,
                omega_radps=motion.omega_body_radps,
            ),
            aimed,
        )
        return aimed

    def _make_directions(self, order: NDArray[np.intp]) -> Array:
        """Unit directions of all rays in the sensor frame, shape (rays, 3)."""
        config = self._config
        elevation = np.radians(np.array(config.elevations_deg)[order] + config.elevation_offset_deg)
        columns = (np.arange(config.columns)[:, None] + 0.5) / config.columns
        azimuth = math.pi - 2 * math.pi * (columns + self._firing_ns / config.sweep_ns)
        flat = elementary.cos(elevation)
        up = np.broadcast_to(elementary.sin(elevation), azimuth.shape)
        along: Array = np.stack([flat * elementary.cos(azimuth), flat * elementary.sin(azimuth), up], axis=-1)
        return along.reshape(-1, 3)


PAPER_ELEVATIONS_DEG: tuple[float, ...] = tuple(round(-30.0 + 40.0 * i / 31, 9) for i in range(32))
"""32 beams evenly from −30° to +10°, as CARLA's LiDAR spaces them [deg]."""


HDL32E_ELEVATIONS_DEG: tuple[float, ...] = (
    -30.67, -29.33, -28.0, -26.67, -25.33, -24.0, -22.67, -21.33, -20.0, -18.67, -17.33, -16.0, -14.67,
    -13.33, -12.0, -10.67, -9.33, -8.0, -6.67, -5.33, -4.0, -2.67, -1.33, 0.0, 1.33, 2.67, 4.0, 5.33,
    6.67, 8.0, 9.33, 10.67,
)  # fmt: skip
"""Beams of the Velodyne HDL-32E [deg]; user manual, page 13."""


HDL32E_FIRING_NS: tuple[int, ...] = tuple(1152 * (2 * r if r < 16 else 2 * (r - 16) + 1) for r in range(32))
"""When each beam of the HDL-32E fires in its 46.08 µs cycle [ns]: lower and upper bank alternate."""
OUTPUTS = ("cloud", "semantic")
"""Streams that a LiDAR can give."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarConfig(SensorConfig):
    """A spinning LiDAR; the defaults are the CARLA-Loc paper's.

    ``preset: hdl32e`` has the angles, firing order and timing of the Velodyne HDL-32E, its elevations
    0.02° higher so that none lies on the edge of A-LOAM's ring bins.
    """

    kind: ClassVar[str] = "lidar"
    sensor: ClassVar[str] = "carlaloc_env.sensors.lidar.lidar:LidarSensor"
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
    """Loss of intensity over distance, exp(−a·R) [1/m]; CARLA's default."""
    drop_weak: bool = False
    """Whether surfaces too dark for their distance give no return."""
    sectors: int = 0
    """Parts of a revolution, each measured at one instant, 10 = CARLA at 200 Hz; 0: one time per column."""
    divergence_mrad: float = 0.0
    """Width of the beam [mrad]; above 0 five rays per beam are weighed, which mixes near edges."""
    dropoff_general: float = 0.0
    """Fraction of points lost at random, as CARLA's, 0.45 = its default."""
    dropoff_intensity_limit: float = 0.8
    """Intensity exp(−a·R) above which no point is lost for weakness, 1 = at the sensor."""
    dropoff_zero_intensity: float = 0.0
    """Fraction of points of no intensity that are lost, as CARLA's, 0.4 = its default."""
    weather: bool = False
    """Whether fog, rain, spray and wet ground have effect; weak returns are dropped then."""
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
        column_ns = 1e9 / (self.rate_hz * max(self.columns, 1))
        if self.firing_ns and not 0 <= min(self.firing_ns) <= max(self.firing_ns) < column_ns:
            raise ConfigError(f"{what}: firing_ns must lie within one column")
        if self.columns < 1 or not 0 <= self.range_min_m < self.range_max_m or self.range_noise_m < 0:
            raise ConfigError(f"{what}: needs columns ≥ 1, 0 ≤ range_min_m < range_max_m, range_noise_m ≥ 0")
        fractions = (self.dropoff_general, self.dropoff_intensity_limit, self.dropoff_zero_intensity)
        if not all(0.0 <= fraction <= 1.0 for fraction in fractions) or self.dropoff_intensity_limit == 0.0:
            raise ConfigError(f"{what}: drop-off figures must lie in 0…1, the intensity limit above 0")
        if self.sectors < 0 or self.divergence_mrad < 0:
            raise ConfigError(f"{what}: sectors and divergence_mrad must not be negative")
        if not self.outputs or set(self.outputs) - set(OUTPUTS):
            raise ConfigError(f"{what}: outputs {list(self.outputs)}; choose from {', '.join(OUTPUTS)}")

    @classmethod
    def file_values(cls, values: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
        """As for any sensor; ``beams: 64`` spaces that many beams evenly from the lowest to the highest.

        Raises:
            ConfigError: `beams` is no whole number, out of range, or beside `elevations_deg`.
        """
        found = super(LidarConfig, cls).file_values(values, base)
        if "beams" not in found:
            return found
        beams, most = found.pop("beams"), int(LIMITS["lidar"]["elevations_deg"].high)
        if not isinstance(beams, int) or not 2 <= beams <= most:
            raise ConfigError(f"beams: {beams!r}; give a whole number from 2 to {most}")
        if "elevations_deg" in values:
            raise ConfigError("beams and elevations_deg exclude each other; give one of them")
        span_deg = found.get("elevations_deg", PAPER_ELEVATIONS_DEG)
        found["elevations_deg"] = np.linspace(span_deg[0], span_deg[-1], beams).round(9).tolist()
        if "firing_ns" not in values:
            found["firing_ns"] = ()  # those of another number of beams
        return found

    @property
    def sweep_ns(self) -> int:
        """Length of a revolution [ns]."""
        return round(1e9 / self.rate_hz)

    @property
    def rays(self) -> int:
        """Rays in one revolution, the most points a cloud can have."""
        return self.columns * len(self.elevations_deg)
